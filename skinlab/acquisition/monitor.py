"""Watches a stream of messages, and says when a curve fails a gate: as soon as it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivers.events import Loaded
from skinlab.curves.curve import Curve
from skinlab.curves.growing import GrowingCurve
from skinlab.quality.gates import all_gates, judge
from skinlab.quality.gates.base import CurveSoFar, Finding, Gate, as_run, whole
from skinlab.recording.stream import (
    CurveCompleted,
    CurveStarted,
    Flagged,
    Happened,
    Message,
    Sampled,
)

_EVERY_S = 0.25  # of the device's time: how often a growing curve is looked at
_MOST_EARLIER = 20  # completed curves that are kept for comparison


class Monitor:
    """Fed with all messages of a pipeline in order; only what the instrument said decides."""

    def __init__(self, gates: Sequence[Gate] | None = None) -> None:
        """None: all gates that there are."""
        self._gates = all_gates() if gates is None else tuple(gates)
        self._earlier: tuple[Curve, ...] = ()
        self._rate_hz: float | None = None
        self._index = 0
        self._growing: GrowingCurve | None = None
        self._look_at_s = 0.0
        self._steps_seen = 0
        self._found: dict[int, tuple[Finding, ...]] = {}

    def findings(self, index: int) -> tuple[Finding, ...]:
        """Return what was found about curve number `index`, in the order in which it was known."""
        return self._found.get(index, ())

    def see(self, message: Message) -> list[Flagged]:
        """Return what this message makes known."""
        match message:
            case CurveStarted(index, curve):
                self._index, self._growing = index, curve
                self._look_at_s, self._steps_seen = 0.0, 0
                self._found[index] = ()
            case Happened(Loaded(rate_hz=rate_hz)):
                self._rate_hz = rate_hz
            case Sampled(index, sample) if self._growing and index == self._index:
                if self._is_due(self._growing, sample.device_time_s):
                    return self._judge(index, self._so_far(self._growing))
            case CurveCompleted(index, curve, _, lost):
                return self._complete(index, curve, lost)
            case _:
                pass
        return []

    def _is_due(self, growing: GrowingCurve, time_s: float) -> bool:
        if growing.steps_back != self._steps_seen:
            self._steps_seen = growing.steps_back
            return True
        if time_s < self._look_at_s:
            return False
        self._look_at_s = time_s + _EVERY_S
        return True

    def _so_far(self, growing: GrowingCurve) -> CurveSoFar:
        """Return what there is; of arrays that grow, and are not to be kept."""
        time_s, pressure_mbar, deflection_mm, segment = growing.columns
        return CurveSoFar(
            as_run(growing.setup, segment, pressure_mbar),
            time_s,
            pressure_mbar,
            deflection_mm,
            segment,
            growing.began_s,
            complete=False,
            rate_hz=self._rate_hz,
            lost_samples=growing.lost,
            steps_back=growing.steps_back,
            earlier=self._earlier,
        )

    def _complete(self, index: int, curve: Curve, lost: int) -> list[Flagged]:
        view = replace(
            whole(curve, self._earlier),
            rate_hz=self._rate_hz,
            lost_samples=lost,
            steps_back=0 if self._growing is None else self._growing.steps_back,
        )
        self._growing = None
        self._earlier = (*self._earlier, curve)[-_MOST_EARLIER:]
        return self._judge(index, view)

    def _judge(self, index: int, view: CurveSoFar) -> list[Flagged]:
        before = self._found.get(index, ())
        known = {finding.gate for finding in before}
        new = [
            finding
            for gate in self._gates
            if gate.name not in known and (finding := judge(gate, view)) is not None
        ]
        self._found[index] = (*before, *new)
        return [Flagged(index, finding) for finding in new]
