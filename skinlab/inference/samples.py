"""The samples that are fitted, grouped by geometry: one model answers for a group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import FEWEST_POINTS, Curve
from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.tables.base import CurveModel, Database

Array = NDArray[np.float64]

EVERYTHING = ("load", "hold", "unload", "rest")  # what laws with a memory are fitted to


@dataclass(frozen=True, eq=False)
class Fitted:
    """One curve and which of its samples (n,) are fitted."""

    curve: Curve
    mask: NDArray[np.bool_]

    @property
    def count(self) -> int:
        """Number of samples that are fitted."""
        return int(self.mask.sum())

    @property
    def samples(self) -> Curve:
        """Those alone, as a curve."""
        curve, mask = self.curve, self.mask
        return replace(
            curve,
            time_s=curve.time_s[mask],
            pressure_mbar=curve.pressure_mbar[mask],
            deflection_mm=curve.deflection_mm[mask],
            segment=None if curve.segment is None else curve.segment[mask],
        )


def choose(curve: Curve, phases: tuple[str, ...], database: Database) -> Fitted:
    """Return the samples of the phases that the database speaks of.

    Raises:
        InputError: they are too few.
        NotTrustworthyError: it does not speak of such a curve at all.
    """
    mask = curve.in_phases(phases) & database.covers(curve)
    if int(mask.sum()) < FEWEST_POINTS:
        raise InputError(
            f"{curve.name}: {int(mask.sum())} samples to fit in phases {','.join(phases)}; "
            f"expected at least {FEWEST_POINTS}"
        )
    return Fitted(curve, mask)


@dataclass(frozen=True, eq=False)
class Group:
    """Curves of one geometry, end to end."""

    members: tuple[Fitted, ...]
    geometry: Geometry
    thickness_sd_mm: float
    pressure_mbar: Array  # (u,)
    deflection_mm: Array  # (u,)
    time_s: Array  # (u,) since each curve began

    def split(self, values: Array) -> list[Array]:
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


def group(fitted: Sequence[Fitted]) -> list[Group]:
    """Return the curves grouped by geometry, in the order in which these first occur."""
    keys: dict[tuple[float, float, float], list[Fitted]] = {}
    for one in fitted:
        setup = one.curve.setup
        sd = setup.thickness_sd_mm or 0.0
        keys.setdefault((setup.aperture_mm, setup.thickness_mm, sd), []).append(one)
    return [
        Group(
            tuple(members),
            Geometry(aperture, thickness),
            sd,
            np.concatenate([m.curve.pressure_mbar[m.mask] for m in members]),
            np.concatenate([m.curve.deflection_mm[m.mask] for m in members]),
            np.concatenate([m.curve.time_s[m.mask] - m.curve.time_s[0] for m in members]),
        )
        for (aperture, thickness, sd), members in keys.items()
    ]
