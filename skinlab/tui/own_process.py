"""Identification in a process of its own: `python -m skinlab.tui.own_process`.

In a thread it would hold the interpreter that draws, reads keys and keeps the probe alive: at
160x50 every frame took twice as long. Both sides are the same program, so pickles go between them:
an identifier first, then (method's name, arguments) in and ("result" | "error", content) out. The
process ends by itself where this one is gone.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

from skinlab.io.log import log_exception

if TYPE_CHECKING:
    from skinlab.curves.curve import Curve
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Identification

_COMMAND = (sys.executable, "-m", "skinlab.tui.own_process")
_GONE = (EOFError, OSError, ValueError, pickle.PickleError)


class OwnProcess:
    """Answers as an identifier does; where its process is gone, this one does the work."""

    def __init__(self, identifier: Identifier, command: Sequence[str] = _COMMAND) -> None:
        self.identifier = identifier
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C in the terminal is not meant for it
            )
            self._process = process
            self._send(process, identifier)
        except (*_GONE, TypeError, AttributeError) as error:  # the last two: not to be pickled
            self._give_up(error)

    @property
    def phases(self) -> tuple[str, ...]:
        """What of a curve is fitted."""
        return self.identifier.phases

    def __call__(self, curve: Curve) -> Identification:
        """Return the answer for a curve."""
        return self._ask("__call__", curve)  # type: ignore[no-any-return]

    def growing(self, curve: Curve, before: Identification | None = None) -> Identification:
        """Return an estimate of a curve that is not complete."""
        return self._ask("growing", curve, before)  # type: ignore[no-any-return]

    def close(self) -> None:
        """Let the process end."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()  # whoever waits for its answer hears of it
        with self._lock:
            self._end()

    def _ask(self, method: str, *arguments: Any) -> Any:
        with self._lock:
            process = self._process
            if process is not None:
                try:
                    self._send(process, (method, arguments))
                    assert process.stdout is not None
                    kind, content = pickle.load(process.stdout)
                except _GONE as error:
                    self._give_up(error)
                else:
                    if kind == "error":
                        raise content
                    return content
        return getattr(self.identifier, method)(*arguments)

    @staticmethod
    def _send(process: subprocess.Popen[bytes], what: object) -> None:
        assert process.stdin is not None
        process.stdin.write(pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL))
        process.stdin.flush()

    def _give_up(self, error: BaseException) -> None:
        if not self._closed:
            log_exception(error)
        self._end()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            try:
                if pipe is not None:
                    pipe.close()
            except OSError:
                pass  # it was gone before
        process.kill()
        process.wait()


def answer(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer what is asked of the identifier that comes first, until nobody asks any more."""
    try:
        identifier = pickle.load(requests)
        while True:
            method, arguments = pickle.load(requests)
            try:
                reply = ("result", getattr(identifier, method)(*arguments))
            except Exception as error:  # noqa: BLE001 -- raised where it was asked for
                reply = ("error", error)
            answers.write(pickle.dumps(reply, protocol=pickle.HIGHEST_PROTOCOL))
            answers.flush()
    except (EOFError, BrokenPipeError):
        return


def main() -> None:
    """Serve the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What anything prints must not come between the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    answer(sys.stdin.buffer, answers)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
