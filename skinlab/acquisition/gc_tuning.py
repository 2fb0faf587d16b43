"""Keeps the pauses short in which no thread runs: the probe's keep-alive must go out in them."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_TURN_S = 0.001  # how long a thread keeps the interpreter while another one waits


def shorten_pauses() -> None:
    """Call once all is imported and loaded, before there is suction; may take 0.1 s itself.

    A full garbage collection goes through everything that was ever imported and stops all threads
    meanwhile: up to a second on a busy machine, where the instrument vents after half of one
    without keep-alive. What is here now is here to stay, and is set apart from collections; what a
    process loads after it has done so once is little.
    """
    if not gc.get_freeze_count():
        gc.collect()
        gc.freeze()
    sys.setswitchinterval(_TURN_S)


@contextmanager
def short_pauses() -> Iterator[None]:
    """Do the same for a while, in a program that is somebody else's."""
    before = sys.getswitchinterval()
    shorten_pauses()
    try:
        yield
    finally:
        sys.setswitchinterval(before)
        gc.unfreeze()
