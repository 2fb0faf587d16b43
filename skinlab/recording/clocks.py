"""The instrument's clock held against the host's, curve by curve, from the recorded bytes.

Samples come late by a link that is slow now and then, and never early. So of every stretch of a
curve only the sample that came soonest counts, and a robust line through those tells when the
instrument's clock stood at zero and how fast it goes (V. Paxson, On calibrating measurements of
packet transit times, SIGMETRICS 1998).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.events import Pace, TimedEvent
from skinlab.errors import InputError
from skinlab.recording.assembler import CurveAssembler
from skinlab.recording.recorded_items import dialect_of, numbered_items
from skinlab.recording.records import Record
from skinlab.recording.stream import CurveCompleted, Planned, Sampled

Array = NDArray[np.float64]

_STRETCHES = 20
_FEWEST = 10  # samples, to tell a rate
_SHORTEST_S = 0.5
_MAD = 1.4826  # standard deviations of a normal distribution in its median absolute deviation
_EXPECTED = 2.0  # standard deviations


@dataclass(frozen=True)
class ClockReading:
    """How the instrument's clock stood to the host's during one curve.

    At `host_time_s` (monotonic; `utc_s` is the time of day) the instrument's clock stood at zero;
    from then on it went `rate` seconds in one of the host's, known to ± `rate_uncertainty`.
    `wander_s` is by how much it usually was off an even pace; the jitter of the link is in it.
    """

    host_time_s: float
    utc_s: float
    rate: float
    rate_uncertainty: float
    wander_s: float

    def to_json(self) -> dict[str, float]:
        """Return the reading as plain data."""
        return asdict(self)

    def agrees_with(self, other: ClockReading) -> bool:
        """Return whether both say the same, but for the last digits of other machines."""
        return bool(np.allclose(astuple(self), astuple(other), rtol=1e-9, atol=1e-9))


def clock_from_json(data: Mapping[str, Any]) -> ClockReading:
    """Return the reading that `to_json` wrote.

    Raises:
        InputError: a field is missing, or no finite number.
    """
    names = tuple(ClockReading.__dataclass_fields__)
    values = [data.get(name) for name in names]
    for name, value in zip(names, values, strict=True):
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise InputError(f"clock.{name} is {value!r}; expected a number")
    return ClockReading(*(float(value) for value in values if value is not None))


def compare_clocks(device_s: Array, host_s: Array) -> tuple[float, float, float, float] | None:
    """Return zero (s of the host), rate, its uncertainty and the wander (s) of a clock.

    `device_s` (n,) are times by that clock, `host_s` (n,) those at which they came. None where
    they are too few, or too close together, to tell.
    """
    if len(device_s) < _FEWEST or not np.ptp(device_s) >= _SHORTEST_S:
        return None
    begin, length = float(device_s.min()), float(np.ptp(device_s))
    count = min(_STRETCHES, len(device_s) // 2)
    with np.errstate(all="ignore"):  # a damaged record may hold any number
        behind = host_s - device_s
        share = np.clip((device_s - begin) / length, 0.0, 1.0)
        stretch = np.minimum((share * count).astype(int), count - 1)
        order = np.lexsort((behind, stretch))
        soonest = order[np.unique(stretch[order], return_index=True)[1]]
        x, y = device_s[soonest], behind[soonest]
        # The median of the slopes between all pairs: some stretches have late samples only
        i, j = np.triu_indices(len(x), 1)
        slope = float(np.median((y[j] - y[i]) / (x[j] - x[i])))
        zero_s = float(np.median(y - slope * x))
        wander_s = _MAD * float(np.median(np.abs(y - (zero_s + slope * x))))
        spread = wander_s / float(np.sqrt(np.sum((x - x.mean()) ** 2)))
    rate = 1.0 / (1.0 + slope) if slope > -1.0 else math.nan
    found = zero_s, rate, _EXPECTED * spread * rate**2, wander_s
    return found if all(map(math.isfinite, found)) else None


def clock_readings(
    meta: Mapping[str, Any], records: Sequence[Record]
) -> tuple[ClockReading | None, ...]:
    """Return the clock of each curve of these records, None where it cannot be told.

    A simulated instrument's time is taken at the pace that it states.

    Raises:
        InputError: the dialect of the records is not known here.
    """
    assembler = CurveAssembler()
    times: dict[int, list[tuple[float, float, float]]] = {}
    completed: list[int] = []
    pace = 1.0
    for index, item in numbered_items(records, dialect_of(meta)):
        if isinstance(item, Planned):
            assembler.plan(item.setup)
            continue
        if isinstance(item.event, Pace):
            pace = item.event.speed
        running = assembler.running
        for message in assembler.feed(item.event):
            match message:
                case Sampled(curve, sample) if running and isinstance(item, TimedEvent):
                    moment = (sample.device_time_s / pace, item.host_time_s, records[index].utc_s)
                    times.setdefault(curve, []).append(moment)
                case CurveCompleted(curve):
                    completed.append(curve)
    completed += [m.index for m in assembler.end("") if isinstance(m, CurveCompleted)]
    return tuple(_reading(times.get(curve, [])) for curve in completed)


def _reading(times: list[tuple[float, float, float]]) -> ClockReading | None:
    if not times:
        return None
    device_s, host_s, utc_s = np.array(times).T
    found = compare_clocks(device_s, host_s)
    if found is None:
        return None
    zero_s, rate, uncertainty, wander_s = found
    ahead_s = float(np.median(utc_s - host_s))
    return ClockReading(zero_s, zero_s + ahead_s, rate, uncertainty, wander_s)
