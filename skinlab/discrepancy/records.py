"""The curves of a campaign, ready to be explained: path of the pressure, noise, places to look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve
from skinlab.curves.pressure_path import PressurePath
from skinlab.errors import InputError
from skinlab.inference.batch import noise_from_repeats_um
from skinlab.inference.noise import pressure_noise_mbar, roughness
from skinlab.inference.samples import alike
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]

_FEWEST = 20  # samples of a curve that can be looked at
_WINDOW = 7  # samples over which the path of a measured pressure is smoothed, by parabolas
_SMOOTHED = 0.58  # of the noise is left by that: sqrt(1/3)
_AS_ASKED = 1.25  # a channel within so many times its noise of the program followed it
_ROUNDING_UM = 0.3


@dataclass(frozen=True, eq=False)
class Record:
    """One curve with the pressure that the skin felt, as well as that is known."""

    curve: Curve
    geometry: Geometry  # as stated
    path: PressurePath
    pressure_mbar: Array  # (n,) on the path, or near it
    pressure_sd_mbar: float  # how well that is known
    noise_um: float  # of one deflection sample
    noise_is_stated: bool = False

    @property
    def name(self) -> str:
        """The curve's file."""
        return self.curve.name

    @property
    def condition(self) -> tuple[float, str, bool]:
        """What is held out as a whole: aperture, program, and whether it is the first cycle."""
        setup = self.curve.setup
        return (setup.aperture_mm, str(setup.program or ""), setup.cycle == 1)


def records_of(campaign: Campaign) -> list[Record]:
    """Return the curves with their noise: stated, else from repeats, else from each curve.

    Where the pressure channel follows the program to within its noise, the skin felt the program;
    else what the channel says, with its noise.

    Raises:
        InputError: a curve is too short; names it.
    """
    found = []
    for curve in campaign.curves:
        if len(curve) < _FEWEST:
            raise InputError(f"{curve.name}: {len(curve)} samples; expected {_FEWEST} or more")
        found.append(_record(curve, campaign.noise_um, campaign.pressure_noise_mbar))
    if campaign.noise_um is None:
        # A lone curve's roughness is known to a tenth only: one instrument, one noise.
        weights = [float(len(r.curve)) for r in found]
        squares = [r.noise_um**2 for r in found]
        repeats = noise_from_repeats_um(campaign.curves, ("load", "hold", "unload", "rest"))
        if repeats is not None:
            squares.append(repeats**2)
            weights.append(0.5 * sum(weights) / len(found))
        noise = max(float(np.sqrt(np.average(squares, weights=weights))), _ROUNDING_UM)
        found = [replace(r, noise_um=noise) for r in found]
    return found


def _record(curve: Curve, noise_um: float | None, pressure_noise: float | None) -> Record:
    time, measured = curve.time_s, curve.pressure_mbar
    noise = pressure_noise_mbar(time, measured) if pressure_noise is None else pressure_noise
    program = curve.setup.program
    path = None
    if program is not None:
        t, p = program.knots()
        asked = PressurePath(tuple(np.asarray(t) + time[0]), tuple(np.asarray(p)))
        off = float(np.sqrt(np.mean((measured - asked(time)) ** 2)))
        if off <= _AS_ASKED * max(noise, 0.05):
            path, pressure, sd = asked, asked(time), 0.0
    if path is None:
        # Each sample keeps its own reading: what smoothing leaves of the noise goes up and down
        # together, and through dw/dp it would look like a missing effect.
        pressure, sd = measured, noise
        smooth = savgol_filter(measured, _WINDOW, 2, mode="interp")
        path = PressurePath.of_samples(time, smooth, max(2.5 * _SMOOTHED * noise, 0.2))
    own = noise_um
    if own is None:
        own = max(1e3 * roughness(curve.deflection_mm), _ROUNDING_UM)
    return Record(
        curve,
        Geometry(curve.setup.aperture_mm, curve.setup.thickness_mm),
        path,
        pressure,
        sd,
        float(own),
        noise_um is not None,
    )


def by_geometry(records: Sequence[Record]) -> list[list[int]]:
    """Return indices of the records by geometry, in the order in which these first occur."""
    return alike([record.geometry for record in records])
