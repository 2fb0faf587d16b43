"""Vents and saves where the screen no longer can: on signals, and when the terminal is gone.

A screen whose terminal went away can block for ever in a write, and with it every handler that it
would run. So a thread of its own waits for the end, and does what must be done.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from functools import partial
from types import FrameType, TracebackType
from typing import Any, Self

from skinlab.io.log import log_exception

INTERRUPTED = 130
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_GRACE_S = 3.0  # for the screen to restore the terminal


class HeldInterrupt:
    """While open: a signal that would interrupt vents at once, and raises only where it is asked.

    KeyboardInterrupt can fall between any two instructions, so that an item that has just left its
    queue, or a file that is being written, is lost. Only signals with a handler of Python's are
    held, and in the main thread only. Without `vent` nothing is done but to hold them.
    """

    def __init__(self, vent: Callable[[str], None] | None = None) -> None:
        self._vent = vent
        self._came = False
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for name in _SIGNALS:
                number = getattr(signal, name, None)
                if number is not None and callable(signal.getsignal(number)):
                    self._handlers[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def check(self) -> None:
        """Raise what was held.

        Raises:
            KeyboardInterrupt: a signal came.
        """
        if self._came:
            raise KeyboardInterrupt

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._came:  # an impatient second one must not interrupt the vent and the saving
            return
        self._came = True
        if self._vent is None:
            return
        # By a thread: the one that was interrupted may hold the lock that a vent needs
        threading.Thread(target=self._vent, args=("interrupted",), daemon=True).start()


class Lifeline:
    """While open: a signal, or an error that a thread did not handle, ends the program safely.

    `vent` is called first, then `leave` (it asks the screen to end), then `close` (vents, and
    finishes the session); last, `end_process` if the screen has not ended by then.
    """

    def __init__(
        self,
        vent: Callable[[str], None],
        leave: Callable[[], None],
        close: Callable[[], None],
        end_process: Callable[[int], object] = os._exit,
        grace_s: float = _GRACE_S,
    ) -> None:
        self._vent = vent
        self._leave = leave
        self._close = close
        self._end_process = end_process
        self._grace_s = grace_s
        self._pulled = threading.Event()
        self._over = threading.Event()
        self._reason = ""
        self._handlers: dict[int, Any] = {}
        self._thread = threading.Thread(target=self._wait, name="lifeline", daemon=True)

    def pull(self, reason: str) -> None:
        """Begin to end; from a signal handler or any thread."""
        self._reason = self._reason or reason
        self._pulled.set()

    def __enter__(self) -> Self:
        self._hook = threading.excepthook
        threading.excepthook = self._on_thread_error
        for name in _SIGNALS:
            number = getattr(signal, name, None)
            if number is not None:
                self._handlers[number] = signal.signal(number, self._on_signal)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._over.set()
        self._pulled.set()
        self._thread.join()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        threading.excepthook = self._hook

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.pull(signal.Signals(number).name)

    def _on_thread_error(self, arguments: threading.ExceptHookArgs) -> None:
        # Where the terminal is gone, it is the thread that writes to it.
        if arguments.exc_value is not None:
            log_exception(arguments.exc_value)
        self.pull("a thread failed")

    def _wait(self) -> None:
        self._pulled.wait()
        if self._over.is_set():
            return
        # Whatever goes wrong in one of them, the next must be done
        steps: list[Callable[[], None]] = [partial(self._vent, self._reason), self._leave]
        for step in [*steps, self._close]:
            try:
                step()
            except Exception as error:  # noqa: BLE001 -- logged: nobody is left to be told
                log_exception(error)
        if not self._over.wait(self._grace_s):
            self._end_process(INTERRUPTED)
