"""Single keys from a terminal, while something else goes on."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

_LOOK_S = 0.1


def on_terminal() -> bool:
    """Whether there is a terminal whose keys can be read one by one."""
    try:
        import termios  # noqa: F401
    except ImportError:  # Windows: its consoles cannot be waited for
        return False
    return sys.stdin.isatty() and sys.stderr.isatty()


def drop_typed() -> None:
    """Forget what was typed at the terminal and not read yet."""
    if not sys.stdin.isatty():
        return
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            msvcrt.getwch()
    else:
        import termios

        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


@contextmanager
def keys(actions: Mapping[str, Callable[[], None]]) -> Iterator[None]:
    """Do what the pressed keys mean, in a thread; the terminal is as before when this ends."""
    import termios
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    over = threading.Event()

    def read() -> None:
        while not over.is_set():
            if select.select([number], [], [], _LOOK_S)[0]:
                pressed = os.read(number, 64).decode(errors="replace")
                if not pressed:
                    return
                for key in pressed:
                    actions.get(key, lambda: None)()

    thread = threading.Thread(target=read, name="keys", daemon=True)
    try:
        tty.setcbreak(number)
        thread.start()
        yield
    finally:
        over.set()
        thread.join()
        termios.tcsetattr(number, termios.TCSADRAIN, before)
