"""What pressure was asked for at each sample, as far as a pump can be expected to be on time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.program import Program, Ramp, Release, Rest, Until
from skinlab.quality.settings import ASKED

Array = NDArray[np.float64]


def asked_band_mbar(
    program: Program,
    time_s: Array,
    segment: NDArray[np.intp] | None,
    began_s: tuple[tuple[int, float], ...],
    interval_s: float,
) -> tuple[Array, Array, Array]:
    """Return the least, the most, and the most within a vent's time, that was asked for (n,) each.

    At about each sample (n,): between the lag of a pump before and a sample's interval after, each
    segment counted from its own first sample.
    """
    times, pressures = _corners(program, began_s, float(time_s[0]), interval_s)
    after = time_s + 1.5 * interval_s
    lags = _lags(program, segment, len(time_s))
    low, high = _range(times, pressures, time_s - lags, after)
    _, high_before = _range(times, pressures, time_s - ASKED.vent_s, after)
    return low, high, high_before


def _range(times: Array, pressures: Array, before: Array, after: Array) -> tuple[Array, Array]:
    """Return the least and the most (n,) of a polyline between two times (n,) each."""
    ends = np.interp(np.stack([before, after]), times, pressures)
    low, high = ends.min(axis=0), ends.max(axis=0)
    near = (times >= before.min()) & (times <= after[-1])
    for time, pressure in zip(times[near], pressures[near], strict=True):
        inside = (before <= time) & (time <= after)
        low[inside] = np.minimum(low[inside], pressure)
        high[inside] = np.maximum(high[inside], pressure)
    return low, high


def _corners(
    program: Program, began_s: tuple[tuple[int, float], ...], first_s: float, interval_s: float
) -> tuple[Array, Array]:
    """Return times and pressures of the corners of what was asked for, by the device's clock."""
    begins = dict(began_s)
    durations = np.diff(program.boundaries_s())
    times: list[float] = []
    pressures: list[float] = []
    present, now = 0.0, begins.get(0, first_s)
    for k, segment in enumerate(program.segments):
        seen = begins.get(k)
        # It began somewhere between the sample before and its own first one.
        now = now if seen is None else min(max(now, seen - interval_s), seen)
        begin = 0.0 if isinstance(segment, Release | Rest) else present
        end = begin
        if isinstance(segment, Ramp | Until):
            end = segment.target_mbar if isinstance(segment, Ramp) else segment.most_mbar
        times += [now, now + float(durations[k])]
        pressures += [begin, end]
        present, now = end, times[-1]
    return np.maximum.accumulate(np.array(times)), np.array(pressures)


def _lags(program: Program, segment: NDArray[np.intp] | None, n: int) -> Array:
    """Return how late (n,) the pressure may be: steps take longer than ramps."""
    steps = [
        isinstance(s, Ramp | Until) and s.rate_mbar_per_s > ASKED.step_mbar_per_s
        for s in program.segments
    ]
    if segment is None or not any(steps):
        return np.full(n, ASKED.lag_of_steps_s if any(steps) else ASKED.lag_s)
    late = np.array([*steps, False]) | np.array([False, *steps])  # a step, and what follows it
    return np.where(late[np.minimum(segment, len(steps))], ASKED.lag_of_steps_s, ASKED.lag_s)
