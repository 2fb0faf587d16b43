"""Looks for what the model misses, in a process of its own: `python -m skinlab.tui.explainer`.

It computes for minutes; in a thread it would hold up keys and keep-alives. The process can be
ended at any time, and ends by itself where this one is gone. Both sides are the same program, so
pickles go between them: (campaign, model) in, ("stage" | "error" | "outcome", content) out.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import IO, TYPE_CHECKING, Any

from skinlab.errors import SkinlabError
from skinlab.io.log import log_exception

if TYPE_CHECKING:
    from skinlab.curves.campaign import Campaign
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.mechanics.model_file import Model

_LESS = 5  # by so much the process is less urgent than the one that keeps the probe alive
_COMMAND = (sys.executable, "-m", "skinlab.tui.explainer")


class ExplainError(SkinlabError):
    """The search came to no answer."""


class Explainer:
    """One search at a time, by a process that `command` starts."""

    def __init__(self, command: Sequence[str] = _COMMAND) -> None:
        self._command = command
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._cancelled = False

    def __call__(
        self, campaign: Campaign, model: Model, tell: Callable[[str], None]
    ) -> Outcome | None:
        """Return the answer; None: it was cancelled. `tell` hears of each stage.

        Raises:
            SkinlabError: there is none, a sentence; or another search is under way.
        """
        with self._lock:
            if self._process is not None:
                raise ExplainError("what is missing is being looked for already")
            self._cancelled = False
            process = self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C in the terminal is not meant for it
            )
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            pickle.dump((campaign, model), process.stdin)
            process.stdin.flush()  # and left open: its end means that nobody listens any more
            return _listen(process.stdout, tell)
        except (EOFError, OSError, pickle.UnpicklingError):
            if self._cancelled:
                return None
            raise ExplainError("the search ended without an answer; try again") from None
        finally:
            with self._lock:
                self._process = None
            process.kill()
            process.communicate()

    def cancel(self) -> None:
        """End the search, if there is one; from any thread."""
        with self._lock:
            if self._process is not None:
                self._cancelled = True
                self._process.kill()


def _listen(answers: IO[bytes], tell: Callable[[str], None]) -> Outcome:
    while True:
        kind, content = pickle.load(answers)
        if kind == "outcome":
            found: Outcome = content
            return found
        if kind == "error":
            raise ExplainError(content)
        tell(content)


# ---- the other process ------------------------------------------------------------------------


def main() -> None:
    """Read what is to be explained, look, and answer."""
    if hasattr(os, "nice"):
        os.nice(_LESS)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is no answer

    def say(kind: str, content: Any) -> None:
        pickle.dump((kind, content), answers)
        answers.flush()

    campaign, model = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with, args=(sys.stdin.buffer,), daemon=True).start()
    try:
        say("outcome", _look(campaign, model, lambda text: say("stage", text)))
    except BrokenPipeError:
        return
    except SkinlabError as error:
        say("error", str(error))
    except Exception as error:  # noqa: BLE001 -- told in a sentence; details are logged
        where = log_exception(error)
        say("error", f"the search failed ({error!r}); details are in {where}")


def _look(campaign: Campaign, model: Model, tell: Callable[[str], None]) -> Outcome:
    tell("loading the database")
    from skinlab.discrepancy.workflow import explain
    from skinlab.tables.store import shipped_table

    return explain(campaign, shipped_table(), model=model, progress=tell)


def _end_with(asking: IO[bytes]) -> None:
    asking.read()
    os._exit(1)


if __name__ == "__main__":
    main()
