"""Many curves at once: what is stated of their noise, and several processes, the same answers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from skinlab.curves.curve import Curve
from skinlab.inference.identify import Identifier
from skinlab.inference.noise import roughness
from skinlab.inference.result import Identification
from skinlab.inference.settings import NOISE
from skinlab.quality.gates import all_gates, judge
from skinlab.quality.gates.base import whole


def fitted_together(identifier: Identifier, curves: Sequence[Curve]) -> Sequence[Curve]:
    """Return which curves answer together: first cycles, where there are any.

    The law means those. A model with effects of rate or cycle means all; where it is that of a
    database of its own, this holds for one cycle.
    """
    if identifier.model.needs_history and identifier.database.fixed_geometry is None:
        return curves
    return [curve for curve in curves if curve.setup.cycle == 1] or curves


def with_stated_noise(
    identifier: Identifier, noise_um: float | None = None, pressure_mbar: float | None = None
) -> Identifier:
    """Return the identifier with what is stated of the sensors' noise.

    The identifier's own statement comes first, then that of the file the curves are from. None is
    left to the residual of each curve: what repeats show is no statement, and the residuals show it
    again.
    """
    sensor = identifier.sensor
    pressure = sensor.pressure_noise_mbar
    pressure = pressure_mbar if pressure is None else pressure
    deflection = noise_um if sensor.noise_um is None else sensor.noise_um
    known = replace(sensor, noise_um=deflection, pressure_noise_mbar=pressure)
    return replace(identifier, sensor=known)


def scatter_of(said: float | str | None, stated: float | None) -> float | None:
    """Return the scatter of placements that is asked for, else what a campaign states.

    A text is "auto". None: it is learned.
    """
    if said is None:
        return stated
    return None if isinstance(said, str) else said


def with_scatter(identifier: Identifier, scatter: float | None) -> Identifier:
    """Return the identifier with this scatter of placements; None: it is learned."""
    return replace(identifier, sensor=replace(identifier.sensor, placement_scatter=scatter))


def noise_from_repeats_um(curves: Sequence[Curve]) -> float | None:
    """Return the noise of one deflection sample, µm, from repeats; None where there are none.

    Repeats have the same aperture, thickness and program, and were sampled at the same times. Only
    the rough part of their differences counts: skin and placement differ smoothly.
    """
    kinds: dict[tuple[float, float, str], list[Curve]] = {}
    for curve in curves:
        setup = curve.setup
        if setup.program is not None and not curve.partial:
            key = (setup.aperture_mm, setup.thickness_mm, str(setup.program))
            kinds.setdefault(key, []).append(curve)
    total, weight = 0.0, 0
    for repeats in kinds.values():
        for first, second in pairwise(repeats):
            found = _rough_variance_mm2(first, second)
            if found is not None:
                total += found[0] * found[1]
                weight += found[1]
    if not weight:
        return None
    return 1e3 * float(np.sqrt(max(total / weight, 1e-10)))


def _rough_variance_mm2(first: Curve, second: Curve) -> tuple[float, int] | None:
    n = min(len(first), len(second))
    if n < NOISE.fewest_common:
        return None
    interval = float(np.median(np.diff(first.time_s[:n])))
    at = [c.time_s[:n] - c.time_s[0] for c in (first, second)]
    if np.abs(at[0] - at[1]).max() > 0.1 * interval:
        return None
    # At the same times: the noise of the pressure channel is in neither deflection.
    return 0.5 * roughness(first.deflection_mm[:n] - second.deflection_mm[:n]) ** 2, n


def identify_all(
    identifier: Identifier, curves: Sequence[Curve], workers: int = 1
) -> Iterator[Identification]:
    """Yield the answers in the order of the curves, the same bits for any number of workers."""
    if min(workers, len(curves)) <= 1:
        yield from (judged(identifier, curve) for curve in curves)
        return
    from skinlab.workers import Pool  # slow to import

    with Pool(min(workers, len(curves)), identifier) as pool:
        yield from pool.map(judged, curves)


def judged(identifier: Identifier, curve: Curve) -> Identification:
    """Return the answer of a whole curve; the quality gates that it fails are among its flags."""
    result, view = identifier(curve), whole(curve)
    names = [gate.name for gate in all_gates() if judge(gate, view) is not None]
    new = tuple(name for name in names if name not in result.flags)
    return replace(result, flags=(*result.flags, *new))
