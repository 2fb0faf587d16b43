"""Watches a stream of messages, and says when a curve fails a gate: as soon as it is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.events import Gap, Loaded, Sample
from skinlab.curves.curve import Curve, Setup
from skinlab.quality.gates import all_gates, judge
from skinlab.quality.gates.base import CurveSoFar, Finding, Gate, beginnings
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
        self._growing: _Growing | None = None
        self._found: dict[int, tuple[Finding, ...]] = {}

    def findings(self, index: int) -> tuple[Finding, ...]:
        """Return what was found about curve number `index`, in the order in which it was known."""
        return self._found.get(index, ())

    def see(self, message: Message) -> list[Flagged]:
        """Return what this message makes known."""
        match message:
            case CurveStarted(index, setup):
                self._growing = _Growing(index, setup)
                self._found[index] = ()
            case Happened(Loaded(rate_hz=rate_hz)):
                self._rate_hz = rate_hz
            case Happened(Gap(expected, received)) if self._growing is not None:
                self._growing.lost += received - expected
            case Sampled(index, sample) if self._growing is not None:
                if self._growing.take(sample):
                    return self._judge(index, self._growing.view(self._rate_hz, self._earlier))
            case CurveCompleted(index, curve, _, lost):
                return self._complete(index, curve, lost)
            case _:
                pass
        return []

    def _complete(self, index: int, curve: Curve, lost: int) -> list[Flagged]:
        view = CurveSoFar(
            curve.setup,
            curve.time_s,
            curve.pressure_mbar,
            curve.deflection_mm,
            curve.segment,
            beginnings(curve),
            cut=curve.partial,
            rate_hz=self._rate_hz,
            lost_samples=lost,
            steps_back=0 if self._growing is None else self._growing.steps_back,
            earlier=self._earlier,
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


class _Growing:
    """The samples of the running curve, in arrays that grow."""

    def __init__(self, index: int, setup: Setup) -> None:
        self.index = index
        self.setup = setup
        self.lost = 0
        self.steps_back = 0
        self._n = 0
        self._values = np.empty((3, 1024))
        self._segment = np.empty(1024, dtype=np.intp)
        self._began: list[tuple[int, float]] = []
        self._look_at_s = 0.0

    def take(self, sample: Sample) -> bool:
        """Take a sample; say whether it is time for a look."""
        n = self._n
        time_s = sample.device_time_s
        if n and time_s <= self._values[0, n - 1]:
            self.steps_back += 1
            return True
        if n == len(self._segment):
            self._values = np.concatenate([self._values, np.empty_like(self._values)], axis=1)
            self._segment = np.concatenate([self._segment, np.empty_like(self._segment)])
        self._values[:, n] = time_s, sample.pressure_mbar, sample.deflection_mm
        if not n or sample.segment != self._segment[n - 1]:
            self._began.append((sample.segment, time_s))
        self._segment[n] = sample.segment
        self._n = n + 1
        due = time_s >= self._look_at_s
        if due:
            self._look_at_s = time_s + _EVERY_S
        return due

    def view(self, rate_hz: float | None, earlier: tuple[Curve, ...]) -> CurveSoFar:
        """Return what there is; of arrays that grow, and are not to be kept."""
        n = self._n
        time_s, pressure_mbar, deflection_mm = self._values[:, :n]
        return CurveSoFar(
            self.setup,
            time_s,
            pressure_mbar,
            deflection_mm,
            self._segment[:n],
            tuple(self._began),
            complete=False,
            rate_hz=rate_hz,
            lost_samples=self.lost,
            steps_back=self.steps_back,
            earlier=earlier,
        )
