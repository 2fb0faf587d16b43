"""The samples that are fitted, grouped by geometry: one model answers for a group."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.placement import placements_of
from skinlab.curves.pressure_glitches import pressure_glitches
from skinlab.curves.settings import SAMPLES
from skinlab.curves.suction import check_height, check_outward, check_suction
from skinlab.errors import InputError
from skinlab.inference.noise import pressure_noise_mbar
from skinlab.inference.pressure_course import smooth_course
from skinlab.inference.settings import STARTS
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.tables.base import CurveModel, Database
from skinlab.text import counted

Array = NDArray[np.float64]

EVERYTHING = ("load", "hold", "unload", "rest")  # what laws with a memory are fitted to


@dataclass(frozen=True, eq=False)
class Fitted:
    """One curve and which of its samples (n,) are fitted."""

    curve: Curve
    mask: NDArray[np.bool_]
    every: int = 1  # of those that could be: of a very long curve one in so many
    beyond: int = 0  # samples that the database does not speak of
    placement: int = 0  # among curves that are fitted together
    glitches: NDArray[np.bool_] | None = None  # (n,) left out: their pressure is none

    @property
    def count(self) -> int:
        """Number of samples that are fitted."""
        return int(self.mask.sum())

    @property
    def samples(self) -> Curve:
        """Those alone, as a curve."""
        return self.curve.only(self.mask)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of several curves, end to end: what is known of them without any model.

    `curve`, `placement` and `condition` (u,) number what each sample belongs to: its curve, the
    putting-on of the probe, and the geometry.
    """

    time_s: Array  # (u,) since each curve began
    pressure_mbar: Array
    deflection_mm: Array
    phase: NDArray[np.str_]
    curve: NDArray[np.intp]
    placement: NDArray[np.intp]
    condition: NDArray[np.intp]
    relative_noise: Array  # (u,) of each curve's sensor noise to that of all, about 1

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def curves(self) -> int:
        """Number of curves."""
        return int(self.curve[-1]) + 1 if len(self) else 0

    @property
    def placements(self) -> int:
        """Number of placements."""
        return len(np.unique(self.placement))

    @property
    def ends(self) -> tuple[int, ...]:
        """Ends of the curves."""
        return tuple(int(e) for e in np.searchsorted(self.curve, np.arange(self.curves), "right"))

    @property
    def longest_s(self) -> float:
        """How long the longest curve lasts."""
        return max(
            (float(t[-1] - t[0]) for t in np.split(self.time_s, self.ends[:-1]) if len(t)),
            default=0.0,
        )

    def only(self, kept: NDArray[np.bool_]) -> Samples:
        """Return some of the samples (u,); curves keep their numbers."""
        return Samples(*(getattr(self, f.name)[kept] for f in fields(self)))


def samples_of(groups: Sequence[Group]) -> Samples:
    """Return the samples of groups, in their order, at the pressures of these.

    At readings a placement's stiffness would be p dw/dp with their noise, and explain it.
    """
    rows: list[tuple[NDArray[np.generic], ...]] = []
    members = [
        (k, *one)
        for k, g in enumerate(groups)
        for one in zip(g.members, g.split(g.pressure_mbar), strict=True)
    ]
    for number, (condition, member, pressure) in enumerate(members):
        c, mask, n = member.curve, member.mask, member.count
        numbers = (np.full(n, i) for i in (number, member.placement, condition))
        time = c.time_s[mask] - c.time_s[0]
        rows.append((time, pressure, c.deflection_mm[mask], c.phase[mask], *numbers, np.ones(n)))
    return Samples(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def choose(
    curve: Curve,
    phases: tuple[str, ...],
    database: Database,
    most_samples: int = STARTS.most_fitted,
) -> Fitted:
    """Return the samples of the phases that the database speaks of, evenly some of very many.

    Raises:
        InputError: they are too few, the suction or the dome is recorded as negative, or the dome
            is higher than its opening is wide.
        NotTrustworthyError: it does not speak of such a curve at all.
    """
    check_suction(curve)
    check_height(curve)
    check_outward(curve)
    asked = curve.in_phases(phases)
    noise_mbar = pressure_noise_mbar(curve.time_s, curve.pressure_mbar)
    glitches = asked & pressure_glitches(curve, noise_mbar)
    mask = asked & ~glitches & database.covers(curve)
    if int(mask.sum()) < SAMPLES.fewest:
        raise InputError(
            f"{curve.name}: {counted(int(mask.sum()), 'sample')} to fit "
            f"in phases {','.join(phases)}; expected at least {SAMPLES.fewest}"
        )
    beyond = int(asked.sum()) - int((mask | glitches).sum())
    every = math.ceil(int(mask.sum()) / most_samples)
    if every > 1:
        at = np.flatnonzero(mask)[::every]
        mask = np.zeros(len(mask), dtype=bool)
        mask[at] = True
    return Fitted(curve, mask, every, beyond, glitches=glitches)


def glitches_of(members: Sequence[Fitted]) -> int:
    """Return how many samples of some curves are left out since their pressure is none."""
    return sum(0 if m.glitches is None else int(m.glitches.sum()) for m in members)


def outliers_by_file(
    members: Sequence[Fitted], kept: Sequence[NDArray[np.bool_]]
) -> dict[str, list[int]]:
    """Return which samples of each curve are left out, of its chosen ones (count,) those kept."""
    found: dict[str, list[int]] = {}
    for member, belong in zip(members, kept, strict=True):
        out = np.flatnonzero(member.mask)[~belong].tolist()
        if member.glitches is not None:
            out += np.flatnonzero(member.glitches).tolist()
        if out:
            found[member.curve.name] = sorted(out)
    return found


@dataclass(frozen=True, eq=False)
class Group:
    """Curves of one geometry, end to end."""

    members: tuple[Fitted, ...]
    geometry: Geometry
    thickness_sd_mm: float
    pressure_mbar: Array  # (u,)
    deflection_mm: Array  # (u,)
    time_s: Array  # (u,) since each curve began

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Return values (u, …) by curve."""
        return np.split(values, np.cumsum([m.count for m in self.members])[:-1])

    def model(
        self, database: Database, kappa: KappaConvention, relative_sd: float = 0.0
    ) -> CurveModel:
        """Return the database at the group's geometry and samples.

        With a relative standard deviation of the thickness, that is a parameter too.

        Raises:
            NotTrustworthyError: it does not speak of this geometry.
        """
        sd = relative_sd * self.geometry.thickness_mm
        return database.model(self.geometry, self.pressure_mbar, kappa, sd, self.time_s)

    def smoothed(self, sd_mbar: Array) -> Group:
        """Return the group at its curves' smooth pressures, given their noises (u,).

        None is beyond what was read: a skin that creases there would have no answer.
        """
        parts = zip(*map(self.split, (self.time_s, self.pressure_mbar, sd_mbar)), strict=True)
        smooth = [
            np.clip(smooth_course(t, p, float(sd.max())), p.min(), p.max()) for t, p, sd in parts
        ]
        return replace(self, pressure_mbar=np.concatenate(smooth))

    def moved(self, by_mm: Array) -> Group:
        """Return the group with so much (u,) added to the deflections that are fitted."""
        return replace(self, deflection_mm=self.deflection_mm + by_mm)


def alike(keys: Sequence[Hashable]) -> list[list[int]]:
    """Return indices by equal keys, in the order in which these first occur."""
    groups: dict[Hashable, list[int]] = {}
    for i, key in enumerate(keys):
        groups.setdefault(key, []).append(i)
    return list(groups.values())


def group(fitted: Sequence[Fitted]) -> list[Group]:
    """Return the curves grouped by geometry, in the order in which these first occur.

    Which are of one placement is told by the order in which they are given.
    """
    setups = [one.curve.setup for one in fitted]
    placements = placements_of([one.curve for one in fitted])
    fitted = [replace(one, placement=n) for one, n in zip(fitted, placements, strict=True)]
    keys = [(s.aperture_mm, s.thickness_mm, s.thickness_sd_mm or 0.0) for s in setups]
    return [_group([fitted[i] for i in members]) for members in alike(keys)]


def _group(members: Sequence[Fitted]) -> Group:
    setup = members[0].curve.setup
    return Group(
        tuple(members),
        Geometry(setup.aperture_mm, setup.thickness_mm),
        setup.thickness_sd_mm or 0.0,
        np.concatenate([m.curve.pressure_mbar[m.mask] for m in members]),
        np.concatenate([m.curve.deflection_mm[m.mask] for m in members]),
        np.concatenate([m.curve.time_s[m.mask] - m.curve.time_s[0] for m in members]),
    )
