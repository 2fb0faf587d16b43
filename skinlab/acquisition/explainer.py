"""Looks for what the model misses, in a process of its own that can be ended at any time.

It computes for minutes; in a thread it would hold up keys and keep-alives.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.errors import SkinlabError
from skinlab.io.log import log_exception
from skinlab.workers import COMMAND, Worker, WorkerDiedError

if TYPE_CHECKING:
    from skinlab.curves.campaign import Campaign
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.mechanics.model_file import Model

_LESS = 5  # by so much the process is less urgent than the one that keeps the probe alive


class ExplainError(SkinlabError):
    """The search came to no answer."""


class Explainer:
    """One search at a time, by a worker that `command` starts."""

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        self._command = command
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._cancelled = False

    def __call__(
        self,
        campaign: Campaign,
        model: Model,
        tell: Callable[[str], None],
        database_path: Path | None = None,
    ) -> Outcome | None:
        """Return the answer; None: it was cancelled. `tell` hears of each stage.

        `database_path`: of the model's law; None: the shipped one.

        Raises:
            SkinlabError: there is none, a sentence; or another search is under way.
        """
        with self._lock:
            if self._worker is not None:
                raise ExplainError("what is missing is being looked for already")
            self._cancelled = False
            worker = self._worker = Worker(
                (campaign, model, database_path), nice=_LESS, here=False, command=self._command
            )
        try:
            found: Outcome = worker.call(look, tell=tell)
        except WorkerDiedError:
            if self._cancelled:
                return None
            raise ExplainError("the search ended without an answer; try again") from None
        except SkinlabError as error:
            raise ExplainError(str(error)) from error
        except Exception as error:
            where = log_exception(error)
            raise ExplainError(f"the search failed ({error!r}); details are in {where}") from error
        finally:
            with self._lock:
                self._worker = None
            worker.close()
        return found

    def cancel(self) -> None:
        """End the search, if there is one; from any thread."""
        with self._lock:
            if self._worker is not None:
                self._cancelled = True
                self._worker.kill()


def look(asked: tuple[Campaign, Model, Path | None], tell: Callable[[str], None]) -> Outcome:
    """Return what these curves miss in this model; for a worker process."""
    tell("loading the database")
    from skinlab.discrepancy.workflow import explain
    from skinlab.tables.store import read, shipped_table

    campaign, model, path = asked
    database = shipped_table() if path is None else read(path)
    return explain(campaign, database, model=model, progress=tell)
