"""Looks for what the model misses, in a process of its own.

It computes for minutes; in a thread it would hold up keys and keep-alives. The process can be
ended at any time, and ends by itself where this one is gone.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from skinlab.errors import SkinlabError
from skinlab.log import log_exception

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from skinlab.campaign import Campaign
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.model_file import Model

_LESS = 5  # by so much the process is less urgent than the one that keeps the probe alive

Work = Callable[["Connection", "Campaign", "Model"], None]


class ExplainError(SkinlabError):
    """The search came to no answer."""


class Explainer:
    """One search at a time; `work` sends ("stage" | "error", text) or ("outcome", Outcome)."""

    def __init__(self, work: Work | None = None) -> None:
        self._work = work or look_for_it
        self._lock = threading.Lock()
        self._process: Any = None
        self._cancelled = False

    def __call__(
        self, campaign: Campaign, model: Model, tell: Callable[[str], None]
    ) -> Outcome | None:
        """Return the answer; None: it was cancelled. `tell` hears of each stage.

        Raises:
            SkinlabError: there is none, a sentence; or another search is under way.
        """
        context = multiprocessing.get_context("spawn")  # a fork would inherit threads and the port
        ours, theirs = context.Pipe(duplex=False)
        with self._lock:
            if self._process is not None:
                raise ExplainError("what is missing is being looked for already")
            self._cancelled = False
            self._process = context.Process(
                target=self._work, args=(theirs, campaign, model), daemon=True
            )
            self._process.start()
        theirs.close()
        try:
            return self._listen(ours, tell)
        finally:
            ours.close()
            with self._lock:
                process, self._process = self._process, None
                process.kill()
            process.join()
            process.close()

    def cancel(self) -> None:
        """End the search, if there is one; from any thread."""
        with self._lock:
            if self._process is not None:
                self._cancelled = True
                self._process.kill()

    def _listen(self, ours: Connection, tell: Callable[[str], None]) -> Outcome | None:
        while True:
            try:
                kind, content = ours.recv()
            except (EOFError, OSError):
                if self._cancelled:
                    return None
                raise ExplainError("the search ended without an answer; try again") from None
            if kind == "outcome":
                found: Outcome = content
                return found
            if kind == "error":
                raise ExplainError(content)
            tell(content)


def look_for_it(theirs: Connection, campaign: Campaign, model: Model) -> None:
    """Do the work, in the other process."""
    _stay_behind()
    try:
        theirs.send(("stage", "loading the database"))
        from skinlab.database.store import shipped_table
        from skinlab.discrepancy.workflow import explain

        outcome = explain(
            campaign,
            shipped_table(),
            model=model,
            progress=lambda text: theirs.send(("stage", text)),
        )
        theirs.send(("outcome", outcome))
    except SkinlabError as error:
        theirs.send(("error", str(error)))
    except BrokenPipeError:
        return  # nobody listens any more
    except Exception as error:  # noqa: BLE001 -- told in a sentence; details are logged
        where = log_exception(error)
        theirs.send(("error", f"the search failed ({error!r}); details are in {where}"))


def _stay_behind() -> None:
    """Write nothing to the screen, leave signals to the other process, and end with it."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nowhere, number)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(_LESS)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
