"""Where the process begins: thin, so that Ctrl-C and closed streams are met from the first moment.

Only what every Python has loaded already is imported at the top.
"""

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

INTERRUPTED = 130
_SENTENCE = b"skinlab: interrupted\n"
_PROCESS = os.getpid()


def main() -> None:
    """Run the command line and exit with the status of contracts: 0, 1, 2, 3, 4, 5 or 130."""
    try:
        import gc
        import signal

        # Imports make much that stays: garbage is looked for a tenth as often.
        gc.set_threshold(10_000, 20, 20)

        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else `nohup`, `&`
            signal.signal(signal.SIGINT, _interrupt)
        for name in ("SIGTERM", "SIGHUP"):  # Windows has no HUP
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _end)
        _open_closed_streams()
        # Sums shared out among threads differ in the last bit from run to run; matrices are small.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        from skinlab.cli.main import run

        status = run()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # nothing is left to interrupt
        gc.freeze()  # what the process ends with need not be searched for garbage
    except KeyboardInterrupt:
        _say_interrupted()
        status = INTERRUPTED
    _flush_or_forget()
    sys.exit(status)


def _interrupt(number: int, frame: "FrameType | None") -> None:
    """Raise KeyboardInterrupt; but in the middle of an import, leave.

    There is nothing to put in order then, and many libraries do not expect to be interrupted while
    they are imported: they print a traceback, or fail in another way.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _say_interrupted()
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


def _say_interrupted() -> None:
    try:
        os.write(2, _SENTENCE)
    except OSError:
        return  # the terminal is gone


def _end(number: int, frame: "FrameType | None") -> None:
    """End like an interrupted command; a process that was forked from it just ends."""
    if os.getpid() != _PROCESS:
        os._exit(INTERRUPTED)
    _interrupt(number, frame)


def _open_closed_streams() -> None:
    """Give what the caller closed (`>&-`) to the null device.

    Else the next file that is opened, a session, would be standard output.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
        if getattr(sys, name) is None:
            null = open(os.devnull, "w" if number else "r", encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, null)


def _flush_or_forget() -> None:
    """Leave nothing that fails to be written at exit: that it failed was told, where it could."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
