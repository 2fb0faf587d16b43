"""A curve while it is measured: one, for the assembler, the gates, the estimates and the screen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.events import Sample
from skinlab.curves.curve import Curve, Setup

Array = NDArray[np.float64]

_FIRST = 1024  # samples that there is room for at first


class GrowingCurve:
    """The samples of a run, in arrays that grow. One thread appends, any may read.

    Time only goes on: a sample that is not later than the one before is no point of the curve. It
    stays in the record, and is counted in `steps_back`. The final vent is not part of the curve
    either: who appends ends there.
    """

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.lost = 0  # samples that never came
        self.steps_back = 0
        self.began_s: tuple[tuple[int, float], ...] = ()  # each segment: index, first sample
        self._n = 0
        self._values = np.empty((3, _FIRST))
        self._segment = np.empty(_FIRST, dtype=np.intp)

    def __len__(self) -> int:
        return self._n

    def append(self, sample: Sample) -> bool:
        """Take a sample; False: it is no point of the curve."""
        n, time_s = self._n, sample.device_time_s
        if n and time_s <= self._values[0, n - 1]:
            self.steps_back += 1
            return False
        if n == len(self._segment):  # readers keep the arrays that they have
            self._values = np.concatenate([self._values, np.empty_like(self._values)], axis=1)
            self._segment = np.concatenate([self._segment, np.empty_like(self._segment)])
        self._values[:, n] = time_s, sample.pressure_mbar, sample.deflection_mm
        self._segment[n] = sample.segment
        if not n or sample.segment != self._segment[n - 1]:
            self.began_s = (*self.began_s, (sample.segment, time_s))
        self._n = n + 1  # last: what is counted is there
        return True

    @property
    def columns(self) -> tuple[Array, Array, Array, NDArray[np.intp]]:
        """Time in s, pressure in mbar, deflection in mm, segment: (n,) each, read only."""
        n = self._n
        values, segment = self._values[:, :n], self._segment[:n]
        values.flags.writeable = segment.flags.writeable = False
        time_s, pressure_mbar, deflection_mm = values
        return time_s, pressure_mbar, deflection_mm, segment

    @property
    def time_s(self) -> Array:
        """By the instrument's clock, since its start (n,)."""
        return self.columns[0]

    @property
    def pressure_mbar(self) -> Array:
        """Suction (n,)."""
        return self.columns[1]

    @property
    def deflection_mm(self) -> Array:
        """Of the skin's apex (n,)."""
        return self.columns[2]

    @property
    def segment(self) -> NDArray[np.intp]:
        """Index of the program's segment (n,)."""
        return self.columns[3]

    def curve(self, name: str, *, partial: bool = False) -> Curve:
        """Return what there is as a curve of its own.

        Raises:
            InputError: a value is not finite.
        """
        return Curve(name, self.setup, *self.columns, partial=partial)
