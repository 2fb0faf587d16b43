"""From driver events to curves. No clock, no thread: the same events give the same curves.

Only what the instrument said decides, not what the driver added, so that a replay of the bytes
cuts a curve where the live run did.
"""

from __future__ import annotations

import math

from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Event,
    Gap,
    Hello,
    InstrumentState,
    LinkLost,
    Refused,
    Sample,
    State,
)
from skinlab.curves.curve import Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.settings import SAMPLES
from skinlab.recording.stream import CurveCompleted, CurveStarted, Happened, Message, Sampled


class CurveAssembler:
    """Collects the samples of each run into a curve; the final vent is not part of it."""

    def __init__(self) -> None:
        self._next: Setup | None = None  # of the next run
        self._curve: GrowingCurve | None = None  # the present one, or the last
        self._index = 0
        self._running = False
        self._found = False  # the link is new, and what the instrument runs is no run of ours
        self._cut: str | None = None

    def plan(self, setup: Setup | None) -> None:
        """Say what the next run belongs to; None: no curve can be made of it."""
        self._next = setup

    @property
    def running(self) -> bool:
        """Whether a curve is being collected."""
        return self._running

    def feed(self, event: Event) -> list[Message]:
        """Return what this event means, in order."""
        messages: list[Message] = []
        match event:
            case Hello():
                # In the midst of a run: the link was lost. The bytes of a record say no more.
                messages += self.end("the link was lost")
                self._found = True
            case State(InstrumentState.RUNNING) if self._found:
                pass
            case State(InstrumentState.RUNNING) if not self._running and self._next is not None:
                messages.append(self._begin())
            case State(state, reason) if self._running and state is not InstrumentState.RUNNING:
                if reason not in {PROGRAM_END, PROGRAM_DONE}:
                    self._cut = self._cut or reason
                messages += self._finish()
            case Sample() if self._running and self._curve is not None:
                count = self._segments() or math.inf
                if event.segment > count:  # the one behind the last is the vent
                    self._cut = self._cut or f"segment {event.segment}, past the end"
                if event.segment >= count:
                    messages += self._finish()
                else:
                    self._curve.append(event)
            case Gap() if self._running and self._curve is not None:
                self._curve.lost += event.received - event.expected
            case Refused(_, reason) if self._running and event.of_vent:
                self._cut = self._cut or f"the instrument refused to vent ({reason})"
            case LinkLost(reason) if self._running:
                self._cut = self._cut or reason
                messages += self._finish()
            case _:
                pass
        if isinstance(event, State) and event.state is not InstrumentState.RUNNING:
            self._found = False
        if isinstance(event, Sample) and self._index:
            messages.append(Sampled(self._index, event))
        else:
            messages.append(Happened(event))
        return messages

    def end(self, reason: str) -> list[Message]:
        """Return the cut curve where the stream ends in the middle of one."""
        if not self._running:
            return []
        self._cut = self._cut or reason
        return self._finish()

    def _segments(self) -> int:
        """Return the program's length; 0: nobody says what the instrument does."""
        program = None if self._curve is None else self._curve.setup.program
        return len(program.segments) if program else 0

    def _begin(self) -> CurveStarted:
        assert self._next is not None
        self._curve = GrowingCurve(self._next)
        self._index += 1
        self._running, self._cut = True, None
        return CurveStarted(self._index, self._curve)

    def _finish(self) -> list[Message]:
        assert self._curve is not None
        self._running = False
        grown = self._curve
        if not len(grown) or grown.segment[-1] < self._segments() - 1:
            self._cut = self._cut or "the program did not reach its end"
        if len(grown) < SAMPLES.fewest:
            return []  # nothing that could be called a curve; the samples stay in the record
        curve = grown.curve(f"curve {self._index}", partial=self._cut is not None)
        return [CurveCompleted(self._index, curve, self._cut, grown.lost)]
