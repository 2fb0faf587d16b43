"""What `skinlab measure` says of an instrument that only streams: what is waited for."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from drivers.capabilities import CANNOT_VENT, READ_ONLY
from drivers.events import Damaged, InstrumentState, Sample, State
from drivers.line_dialect import IGNORED
from skinlab.cli.output import echo

if TYPE_CHECKING:
    from skinlab.recording.stream import Message

_NOT_UNDERSTOOD = 10  # lines, after which it is said
_SILENT_S = 10.0  # without a reading, after which it is said: these instruments never rest


class Awaited:
    """Says on standard error what is waited for, where somebody else starts the instrument."""

    def __init__(
        self, repeats: int, dialect: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._repeats = repeats
        self._dialect = dialect
        self._clock = clock
        self._silent_till_s: float | None = None  # None: nothing is waited for
        self._curves = 0
        self._readings = self._damaged = 0

    def begin(self) -> None:
        """Say what this is."""
        echo(f"skinlab: read-only: {READ_ONLY}; {CANNOT_VENT}", err=True)
        self._silent_till_s = self._clock() + _SILENT_S

    def wait(self) -> None:
        """Say it, once, where nothing that can be read has come for long; to be called often."""
        till_s = self._silent_till_s
        if till_s is None or self._clock() < till_s:
            return
        self._silent_till_s = None
        if not self._readings:
            echo(
                f"skinlab: no reading of dialect {self._dialect!r} has come for {_SILENT_S:g} s: "
                "is the instrument on, and are port, speed and dialect right?",
                err=True,
            )

    def __call__(self, message: Message) -> None:
        """Say what this message means for whoever waits."""
        from skinlab.recording.stream import (  # slow to import
            CurveCompleted,
            CurveStarted,
            Happened,
            Sampled,
        )

        match message:
            case Sampled() | Happened(Sample()):
                self._readings += 1
            case Happened(Damaged(reason, data)) if reason != IGNORED:
                self._damaged += 1
                if self._damaged == _NOT_UNDERSTOOD and not self._readings:
                    what = (
                        f"{_NOT_UNDERSTOOD} lines came, and dialect {self._dialect!r} understands"
                    )
                    echo(f"skinlab: {what} none ({reason}), the last one {data[:60]!r}", err=True)
            case CurveStarted(index):
                echo(f"skinlab: curve {index}: the pressure left zero", err=True)
            case CurveCompleted(_, _, None):
                self._curves += 1
            case Happened(State(InstrumentState.ARMED)):
                of = f"curve {self._curves + 1} of {self._repeats}"
                echo(f"skinlab: {of}: start the instrument; Ctrl-C ends and saves", err=True)
            case _:
                pass
