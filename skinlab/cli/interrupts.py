"""A terminated command ends like an interrupted one: it vents, saves, and says so."""

from __future__ import annotations

import signal
from types import FrameType

_SIGNALS = [s for s in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, s)]  # Windows: no HUP


def interrupt_on_signals() -> None:
    """Let the first of these signals, a closed terminal's too, raise KeyboardInterrupt."""
    for name in _SIGNALS:
        signal.signal(getattr(signal, name), _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    # Once: an impatient second one must not interrupt the vent and the saving.
    for name in _SIGNALS:
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    raise KeyboardInterrupt
