"""The curves of a campaign, ready to be explained: path of the pressure, noise, places to look."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.campaign import Campaign
from skinlab.curves.corrected import corrected
from skinlab.curves.curve import Curve
from skinlab.curves.placement import placements_of
from skinlab.curves.pressure_glitches import pressure_glitches
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.settings import SUCTION
from skinlab.curves.suction import check_dome, check_height, check_outward, check_suction
from skinlab.discrepancy.settings import ERRORS
from skinlab.errors import InputError
from skinlab.inference.batch import noise_from_repeats_um
from skinlab.inference.error_models.quantised import step_of, step_um
from skinlab.inference.noise import pressure_noise_mbar, roughness
from skinlab.inference.pressure_course import smooth_course
from skinlab.inference.samples import alike
from skinlab.mechanics.effects.regulator_lag import RegulatorLag
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.model_errors import SeenErrors

Array = NDArray[np.float64]

_RIG = RegulatorLag()  # between what is asked for and what the pressure sensor sees
_LAGS_S = (0.0, *np.geomspace(0.01, 2.0, 12).tolist())
_TRIMMED = 0.572  # what `_usual_there` gives of a Gaussian of deviation 1


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
    placement: int = 0  # which putting-on of the probe
    coarse: int = 1  # samples that each one is the mean of,
    step_um: float = 0.0  # and of what step their lattice was: means have none
    glitches: int = 0  # samples that are in none of these means
    left_out_s: tuple[float, ...] = ()  # when a sample or a mean was left out
    noisier: Array | float = 1.0  # (n,) by this factor: about a jump fewer are averaged
    thickness_sd_mm: float = 0.0  # as stated
    creases_mbar: float = math.inf  # from where on the model's skin has no dome of its own
    table_errors: SeenErrors | None = None  # of its opening, along suctions; None: not known
    bend_mm: Array | float = 0.0  # (n,) of its placement, beyond slopes: see `placement_curves`
    off_path_mm: Array | float = 0.0  # (n,) what noise off the path does: see `Fitter.on_paths`
    first_s: float | None = None  # when the curve as recorded began; None: with what is here

    @property
    def name(self) -> str:
        """The curve's file."""
        return self.curve.name

    @property
    def at_pressure_mm(self) -> Array:
        """The deflections (n,) that belong to `pressure_mbar`, mm."""
        return self.curve.deflection_mm - self.off_path_mm

    @property
    def straight_mm(self) -> Array:
        """The same as they would be if placements moved curves along slopes, mm."""
        return self.at_pressure_mm - self.bend_mm

    @property
    def began_s(self) -> float:
        """Time of the curve's first sample as recorded, from which sensor effects count."""
        return float(self.curve.time_s[0]) if self.first_s is None else self.first_s

    @cached_property
    def on_path_mbar(self) -> Array:
        """The path's pressures (n,) at the samples."""
        return self.path(self.curve.time_s)

    @cached_property
    def off_path_mbar(self) -> Array:
        """By how much the pressures (n,) are off the path."""
        return self.pressure_mbar - self.on_path_mbar

    @cached_property
    def segment(self) -> NDArray[np.generic]:
        """Which segment of its program each sample (n,) is of; without one, its phase."""
        found = self.curve.segments
        return self.curve.phase if found is None else found

    def each(self, size: float) -> Array:
        """Return an error's size of each sample (n,); `size` is that of most."""
        return np.asarray(np.full(len(self.curve), size) * self.noisier)

    @property
    def condition(self) -> tuple[float, str, bool]:
        """What is held out as a whole: aperture, program, and whether it is the first cycle."""
        setup = self.curve.setup
        return (setup.aperture_mm, str(setup.program or ""), setup.cycle == 1)


def records_of(campaign: Campaign, *, every: bool = False) -> list[Record]:
    """Return the curves with their noise: stated, else from repeats, else from each curve.

    Errors that the calibration of a curve's probe knows are taken off. Where the pressure channel
    follows the program to within its noise, the skin felt the program; else what the channel says,
    with its noise. Samples whose pressure is a glitch of the channel are left out, unless
    `every` one has been chosen already.

    Raises:
        InputError: a curve is too short, its suction or dome is recorded as negative, or none, its
            deflection is the same at every suction, or higher than its opening is wide; names it.
    """
    found = []
    for curve, placement in zip(campaign.curves, placements_of(campaign.curves), strict=True):
        if (count := len(curve)) < ERRORS.fewest:
            raise InputError(f"{curve.name}: {count} samples; expected {ERRORS.fewest} or more")
        check_suction(curve)
        check_dome(curve)
        check_height(curve)
        check_outward(curve)
        true = curve if curve.probe is None else corrected(curve, curve.probe)
        noise_mbar = pressure_noise_mbar(true.time_s, true.pressure_mbar)
        bad = pressure_glitches(true, noise_mbar) & (not every)
        when = tuple(true.time_s[bad].tolist())
        true = true.only(~bad) if bad.any() else true
        one = _record(true, campaign.noise_um, campaign.pressure_noise_mbar)
        first_s = float(curve.time_s[0])
        found.append(
            replace(one, placement=placement, glitches=len(when), left_out_s=when, first_s=first_s)
        )
    _check_sucked(found)
    if campaign.noise_um is None:
        # A lone curve's roughness is known to a tenth only: one instrument, one noise.
        weights = [float(len(r.curve)) for r in found]
        squares = [r.noise_um**2 for r in found]
        repeats = noise_from_repeats_um(campaign.curves)
        if repeats is not None:
            squares.append(repeats**2)
            weights.append(0.5 * sum(weights) / len(found))
        noise = max(float(np.sqrt(np.average(squares, weights=weights))), ERRORS.rounding_um)
        found = [replace(r, noise_um=noise) for r in found]
    return found


def _check_sucked(records: Sequence[Record]) -> None:
    """Refuse a curve without suction, unless its program is a rest of what others suck at.

    Raises:
        InputError: so it is, as of a pressure channel that is dead; names the curve.
    """
    sucked = {r.geometry for r in records if r.path.top_mbar > SUCTION.about_zero_mbar}
    for record in records:
        curve, program = record.curve, record.curve.setup.program
        rests = program is not None and program.max_pressure_mbar <= 0
        if record.path.top_mbar > SUCTION.about_zero_mbar or (rests and record.geometry in sucked):
            continue
        raise InputError(
            f"{curve.name}: pressure_mbar goes no higher than {curve.pressure_mbar.max() + 0.0:g}; "
            "expected a suction"
        )


def _record(curve: Curve, noise_um: float | None, pressure_noise: float | None) -> Record:
    time, measured = curve.time_s, curve.pressure_mbar
    noise = pressure_noise_mbar(time, measured) if pressure_noise is None else pressure_noise
    # A channel that reads in whole mbar looks silent, and is off by up to half of one.
    noise = float(np.hypot(noise, step_of(measured, ERRORS.rounding_mbar) / np.sqrt(12.0)))
    program = curve.program_as_run
    path, course = None, PressurePath((float(time[0]), float(time[-1])), (0.0, 0.0))
    if program is not None:
        asked = PressurePath.of_program(program)
        path = behind(asked, time, measured, 0.0)
        off = float(np.sqrt(np.mean((measured - path(time)) ** 2)))
        if off <= ERRORS.as_asked * max(noise, 0.05):
            pressure, sd = path(time), 0.0
        else:
            course = behind(asked, time, measured, fitted_lag_s(asked, time, measured))
            path = None
    if path is None:
        # Each sample keeps its own reading: what smoothing leaves of the noise goes up and down
        # together, and through dw/dp it would look like a missing effect.
        pressure, sd = measured, noise
        # What a rig does to a program has no corners left, so that it can be smoothed far.
        rest = measured - course(time)
        lags = float(np.sqrt(np.mean(rest**2))) <= ERRORS.as_lagging * noise
        apart = ERRORS.course_apart[1 if lags else 0]
        rest = smooth_course(time, rest, noise, apart=apart)
        # Between samples the suction bends as the rig makes it: a chord is off by millibars.
        inside = [t for t in course.time_s if time[0] < t < time[-1]]
        knots = np.union1d(time, inside)
        share, least = ERRORS.corners
        smooth = course(knots) + np.interp(knots, time, rest)
        path = PressurePath.of_samples(knots, smooth, max(share * noise, least))
    own = noise_um
    if own is None:
        own = max(1e3 * roughness(curve.deflection_mm), ERRORS.rounding_um)
    return Record(
        curve,
        Geometry(curve.setup.aperture_mm, curve.setup.thickness_mm),
        path,
        pressure,
        sd,
        float(own),
        noise_um is not None,
        thickness_sd_mm=curve.setup.thickness_sd_mm or 0.0,
    )


def behind(asked: PressurePath, time_s: Array, measured_mbar: Array, lag_s: float) -> PressurePath:
    """Return the path of a rig that follows a program by a lag of the first order.

    It began with the first sample, or that is lost and the clock tells: what is nearer.
    """
    made = _RIG.felt(asked, {"tau_s": lag_s})
    starts = sorted({float(time_s[0]), 0.0})
    each = [replace(made, time_s=tuple(t + start for t in made.time_s)) for start in starts]
    left = [float(np.square(measured_mbar - one(time_s)).sum()) for one in each]
    return each[int(np.argmin(left))]


def fitted_lag_s(asked: PressurePath, time_s: Array, measured_mbar: Array) -> float:
    """Return the lag of the first order with which readings (n,) are nearest to a program."""
    from scipy.optimize import minimize_scalar  # slow to import

    def left(lag: float) -> float:
        path = behind(asked, time_s, measured_mbar, lag)
        return float(np.square(measured_mbar - path(time_s)).sum())

    tried = [left(lag) for lag in _LAGS_S]
    best = int(np.argmin(tried))
    near = _LAGS_S[max(best - 1, 0)], _LAGS_S[min(best + 1, len(_LAGS_S) - 1)]
    found = minimize_scalar(left, bounds=near, method="bounded", options={"xatol": 1e-4})
    return float(found.x) if found.fun < tried[best] else _LAGS_S[best]


def coarsened(record: Record, rate_hz: float) -> Record:
    """Return the record with samples averaged to about this rate, glitches left out.

    Only within a phase; what is left over at the end of one is averaged as well. While the suction
    jumps none are averaged, and after it few: the mean of a bend does not lie on it.
    """
    curve = record.curve
    step = float(np.median(np.diff(curve.time_s)))
    size = int(1.0 / (rate_hz * step) + 0.15)  # clocks jitter, and samples are lost
    if size < 2:
        return record
    w, phase = curve.deflection_mm, curve.phase
    from scipy.ndimage import median_filter  # slow to import

    usual = median_filter(w, ERRORS.glitch_window, mode="nearest")
    off = np.abs(w - usual)
    kept = off <= np.maximum(ERRORS.glitch * _usual_there(off), ERRORS.glitch_mm)
    begins = np.concatenate([[True], phase[1:] != phase[:-1]])
    run = np.cumsum(begins) - 1
    inside = np.arange(len(w)) - np.flatnonzero(begins)[run]
    length = np.bincount(run)[run]
    blocks = np.maximum(length // size, 1)
    regular = run * len(w) + np.minimum(inside // size, blocks - 1)
    jumps = _about_jumps(record, step, size)
    cut = jumps[1:] | (regular[1:] != regular[:-1])
    block = np.concatenate([[0], np.cumsum(cut)])
    count = np.bincount(block, kept)
    held = count > 0

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(block, kept * values)[held] / count[held])

    segment = curve.segments
    first = np.unique(block, return_index=True)[1][held]
    coarse = Curve(
        curve.name, curve.setup, mean(curve.time_s), mean(curve.pressure_mbar), mean(w),
        None if segment is None else segment[first], curve.partial,
        corrected_by=curve.corrected_by,
    )  # fmt: skip
    if len(coarse) < ERRORS.fewest:
        return record
    each = float(size if jumps.any() else np.mean(count[held]))
    by = each**-0.5
    return replace(
        record, curve=coarse, pressure_mbar=mean(record.pressure_mbar), coarse=size,
        pressure_sd_mbar=record.pressure_sd_mbar * by, noise_um=record.noise_um * by,
        glitches=record.glitches + int((~kept).sum()), step_um=step_um(w),
        noisier=np.sqrt(each / count[held]) if jumps.any() else 1.0,
        left_out_s=(*record.left_out_s, *curve.time_s[~kept].tolist()),
    )  # fmt: skip


def _usual_there(off: Array) -> Array:
    """Return usual deviations (n,) at each sample's place, of deviations (n,) from a median.

    Noise in proportion to the dome is larger on top. Of readings in steps more than half may lie on
    the median; so it is the mean, without the largest.
    """
    parts = np.array_split(off, max(1, round(len(off) / ERRORS.glitch_part)))
    each = [
        float(np.mean(np.sort(part)[: int(ERRORS.glitch_trimmed * len(part)) + 1])) / _TRIMMED
        for part in parts
    ]
    return np.repeat(each, [len(part) for part in parts])


def _about_jumps(record: Record, step_s: float, size: int) -> NDArray[np.bool_]:
    """Return whether another mean begins with a sample (n,) for the sake of a jump of the suction.

    Within one each sample is alone; after it a mean lasts a fifth of the time that is over since,
    up to its usual length: of what fades by then, whatever its time, a mean is off by 0.3 %.
    """
    time = record.curve.time_s
    knots, length, slope, jump = record.path.pieces
    fast = (np.abs(slope) > ERRORS.jump_mbar_per_s) & (np.abs(slope) * length > ERRORS.jump_mbar)
    fast |= np.abs(jump) > ERRORS.jump_mbar
    if not fast.any():
        return np.zeros(len(time), dtype=bool)
    begins, ends = knots[:-1][fast], (knots[:-1] + length)[fast]
    last = np.searchsorted(begins, time, side="right") - 1
    since = (time - ends[last]) / step_s
    near = (last >= 0) & (since < 5.0 * size)
    alone = near & (since < 1.0)
    number = np.where(near, np.floor(np.log(np.maximum(since, 1.0)) / np.log(1.2)), -1.0)
    number[alone] = len(time) + np.flatnonzero(alone)
    changed = (np.diff(number) != 0) | ((np.diff(last) != 0) & near[1:])
    return np.concatenate([[False], changed])


def without(records: Sequence[Record], kept: Sequence[NDArray[np.bool_]]) -> list[Record]:
    """Return the records with those of their samples (n,) that are kept."""
    found = []
    for record, mask in zip(records, kept, strict=True):
        if mask.all():
            found.append(record)
            continue
        noisier = np.broadcast_to(record.noisier, mask.shape)[mask]
        off_mm = np.broadcast_to(record.off_path_mm, mask.shape)[mask]
        pressure = record.pressure_mbar[mask]
        when = record.curve.time_s[~mask].tolist()
        found.append(
            replace(
                record, curve=record.curve.only(mask), pressure_mbar=pressure, noisier=noisier,
                off_path_mm=off_mm, left_out_s=(*record.left_out_s, *when),
            )
        )  # fmt: skip
    return found


def by_condition(records: Sequence[Record]) -> list[list[int]]:
    """Return indices of the records by what was measured: repeats of a program are together.

    Without a program a curve is alone: nobody said that its pressure was that of another.
    """
    keys = [
        (r.geometry, r.curve.setup.cycle, str(r.curve.setup.program or f"curve {i}"))
        for i, r in enumerate(records)
    ]
    return alike(keys)


def by_geometry(records: Sequence[Record]) -> list[list[int]]:
    """Return indices of the records by geometry, in the order in which these first occur."""
    return alike([record.geometry for record in records])
