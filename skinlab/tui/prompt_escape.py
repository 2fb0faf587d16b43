"""Textual 8's terminal driver, mended: a lone Esc vents soon, and no byte ends the screen."""

from __future__ import annotations

import codecs
import selectors
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any

_LOOK_S = 0.01


class PromptSelector(selectors.SelectSelector):
    """Waits no longer than a hundredth of a second, so that the driver looks at its clock."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready; perhaps nothing, sooner than `timeout` (s)."""
        return super().select(_LOOK_S if timeout is None else min(timeout, _LOOK_S))


def look_sooner() -> None:
    """Let the terminal driver notice within 10 ms that nothing followed an Esc, and end with us.

    Bytes that are no UTF-8, of a terminal that is set otherwise or of a disturbed line, are left
    out: the driver's own decoder would end the program.
    """
    try:
        from textual.drivers import linux_driver
    except ImportError:
        return  # another system, another driver
    module: Any = linux_driver
    module.selectors = SimpleNamespace(
        SelectSelector=PromptSelector, EVENT_READ=selectors.EVENT_READ
    )
    module.getincrementaldecoder = lambda encoding: partial(
        codecs.getincrementaldecoder(encoding), errors="ignore"
    )
    # Hung up twice, the app never tells what reads the keys to end: it would keep the process
    module.Thread = partial(threading.Thread, daemon=True)
