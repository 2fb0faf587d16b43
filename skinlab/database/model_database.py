"""A database of one's own: a law with effects on the axes of a SPEC.toml, a curve in every node."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline

from skinlab.curve import Curve
from skinlab.database.axes import Interpolant
from skinlab.database.build import HERE
from skinlab.database.course import Course, course_of
from skinlab.database.filled import filled
from skinlab.database.rows import How, compute_rows
from skinlab.database.spec_file import ModelSpec
from skinlab.effects.model import Effects
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.fem.suction import SOLVER_VERSION, Geometry
from skinlab.materials.compressibility import KappaConvention
from skinlab.parameters import AxisSpace
from skinlab.versions import versions

if TYPE_CHECKING:
    from skinlab.database.tensor_model import TensorModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModelDatabase:
    """What was built of a spec.

    `curves` (axes…, width) are the rows of the course; `holds_to` (axes…) is the pressure in mbar,
    or the time in s, to which an entry holds, -inf where it does not at all. Beyond it a curve
    supports the interpolation of neighbours, and is no answer in itself. `errors` (m, width) is
    what interpolation errs by at `check_points`; zero where there is nothing to compare.
    """

    spec: ModelSpec
    curves: Array
    holds_to: Array
    errors: Array
    solver_version: str
    versions: dict[str, str]  # what it was built with; not part of its content

    @cached_property
    def content_hash(self) -> str:
        """`sha256:…` over what is computed from what, and the numbers themselves."""
        digest = hashlib.sha256(f"{self.spec.to_json()} {self.solver_version}".encode())
        for array in (self.curves, self.holds_to, self.errors):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return f"sha256:{digest.hexdigest()}"

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        return self.spec.model.model.law

    @property
    def mesh_name(self) -> str:
        """Name of the discretisation that computed it."""
        return self.spec.mesh.name

    @cached_property
    def course(self) -> Course:
        """Along what it holds its curves."""
        return course_of(self.spec)

    @cached_property
    def interpolants(self) -> tuple[Interpolant, ...]:
        """How its curves run along each axis."""
        kappa = self.spec.model.model.kappa
        return tuple(
            Interpolant(axis, kappa=kappa if name == "nu" else None)
            for name, axis in self.spec.axis.items()
        )

    @cached_property
    def space(self) -> AxisSpace:
        """Where it holds at all: even as the model's priors say, else as the axes are spaced."""
        axes, model = self.spec.axis, self.spec.model
        priors = {name: own.prior for name, own in model.parameters.items()}
        logarithmic = tuple(
            axis.low > 0 and priors.get(name, _AS_SPACED[axis.spacing]) == "log-uniform"
            for name, axis in axes.items()
        )
        low, high = (tuple(getattr(a, end) for a in axes.values()) for end in ("low", "high"))
        return AxisSpace(tuple(axes), low, high, logarithmic)

    def point(self, base: Mapping[str, float], effects: Effects) -> Array:
        """Return the parameters (k,) of X1, X2 and ν, by name, and effects' values.

        What `effects` do not give is the model's own value.

        Raises:
            InputError: a value is none of this database's; says which.
        """
        at = dict(base)
        own = self.spec.model.values
        for effect, values in effects.items():
            for parameter, value in values.items():
                name = f"{effect}.{parameter}"
                if name not in self.spec.axis and own.get(effect, {}).get(parameter) != value:
                    raise InputError(f"{name} {value:g} is none of this database's")
        for name, axis in self.spec.axis.items():
            effect, _, parameter = name.rpartition(".")
            if effect:
                at[name] = effects.get(effect, {}).get(parameter, own[effect][parameter])
            if not axis.low <= at[name] <= axis.high:
                raise InputError(
                    f"{name} {at[name]:g} is outside the database ({axis.low:g}–{axis.high:g})"
                )
        return np.array([at[name] for name in self.spec.axis])

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: it does not speak of such a curve at all; says why.
        """
        setup, own = curve.setup, self.spec.measurement
        self._check(Geometry(setup.aperture_mm, setup.thickness_mm), setup.thickness_sd_mm or 0.0)
        if self.spec.has_history and setup.cycle != own.cycle:
            raise NotTrustworthyError(
                f"{curve.name}: cycle {setup.cycle}, and this database holds for cycle "
                f"{own.cycle} only"
            )
        return self.course.covered(curve)

    def model(
        self,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
        thickness_sd_mm: float = 0.0,
        time_s: Array | None = None,
    ) -> TensorModel:
        """Return it at these pressures (u,) and times since the program's start (u,).

        Raises:
            NotTrustworthyError: it does not speak of this geometry, uncertainty or convention.
        """
        from skinlab.database.tensor_model import TensorModel

        self._check(geometry, thickness_sd_mm)
        stated = self.spec.model.model.kappa
        if kappa != stated:
            raise NotTrustworthyError(f"kappa {kappa!r}, and this database holds for {stated!r}")
        return TensorModel(self, pressure_mbar, time_s)

    def _check(self, geometry: Geometry, thickness_sd_mm: float) -> None:
        own = self.spec.geometry
        for name in ("aperture_mm", "thickness_mm"):
            asked, stored = getattr(geometry, name), getattr(own, name)
            if not math.isclose(asked, stored, rel_tol=1e-9):
                raise NotTrustworthyError(
                    f"{name} {asked:g}, and this database holds for {stored:g} only"
                )
        if thickness_sd_mm > 0.0:
            raise NotTrustworthyError(
                "this database holds one thickness: give no thickness_sd_mm, or build one with the "
                "axis thickness_error.ratio"
            )


_CHECKS = 12  # points at which the interpolation is compared with finite elements
_AS_SPACED = {"log": "log-uniform", "linear": "uniform", "chebyshev": "uniform"}


def node(spec: ModelSpec, entry: int) -> tuple[float, ...]:
    """Return the values along the axes of the entry with this flat number."""
    at = np.unravel_index(entry, spec.shape)
    return tuple(float(axis.values()[i]) for axis, i in zip(spec.axis.values(), at, strict=True))


def check_points(spec: ModelSpec) -> Array:
    """Return the points (m, k) between the nodes at which the interpolation is checked."""
    share = np.random.default_rng(0).random((_CHECKS, len(spec.axis)))
    columns = []
    for axis, u in zip(spec.axis.values(), share.T, strict=True):
        log = axis.spacing == "log"
        even = axis.low + (axis.high - axis.low) * u
        columns.append(axis.low * (axis.high / axis.low) ** u if log else even)
    return np.stack(columns, axis=1)


def compute_curve(spec: ModelSpec, entry: int) -> Array:
    """Return one entry's row (width,) by finite elements, NaN where the skin does not hold.

    The check points are entries behind those of the grid.
    """
    between = entry - spec.entries
    point = node(spec, entry) if between < 0 else check_points(spec)[between]
    skin, effects = spec.skin(point)
    return course_of(spec).row(skin, effects)


def build_model(spec: ModelSpec, how: How = HERE) -> ModelDatabase:
    """Return the built database.

    Raises:
        InputError: see `compute_rows`.
    """
    course = course_of(spec)
    what = f"{spec.to_json()} {SOLVER_VERSION}"
    entries = spec.entries + _CHECKS
    rows = compute_rows(partial(compute_curve, spec), what, entries, course.width, how)
    count = len(course.nodes)
    held: NDArray[np.bool_] = np.all(np.isfinite(rows).reshape(len(rows), -1, count), axis=1)
    first_lost = np.where(np.all(held, axis=1), count, np.argmin(held, axis=1))
    holds_to = np.where(first_lost > 0, course.nodes[first_lost - 1], -np.inf)
    # Later samples that seem to hold again are of a skin that did not get there.
    lost = np.arange(count) >= first_lost[:, None]
    rows[np.tile(lost, course.width // count)] = np.nan
    grid, between = np.split(rows, [spec.entries])
    built = ModelDatabase(
        spec,
        filled(grid.reshape(*spec.shape, -1)),
        holds_to[: spec.entries].reshape(spec.shape),
        np.zeros((_CHECKS, course.width)),
        SOLVER_VERSION,
        versions(),
    )
    return replace(built, errors=_errors(built, between))


def _errors(database: ModelDatabase, computed: Array) -> Array:
    """Return interpolated less computed rows (m, width); zero where either ends."""
    points = check_points(database.spec)
    nodes, axes = database.course.nodes, database.interpolants
    coefficients = database.curves
    for d, axis in enumerate(axes):
        coefficients = axis.coefficients(coefficients, d)
    spline = NdBSpline(
        tuple(a.knots for a in axes),
        np.ascontiguousarray(coefficients),
        tuple(a.degree for a in axes),
    )
    found = spline(np.stack([a.coordinate(p) for p, a in zip(points.T, axes, strict=True)], axis=1))
    errors = np.nan_to_num(found - computed)
    for error, point in zip(errors, points, strict=True):  # as far as the point's cell holds
        cell = [int(axis.cell(point[[d]])[0]) for d, axis in enumerate(axes)]
        corners = database.holds_to[tuple(slice(i, i + 2) for i in cell)]
        error[np.tile(nodes > corners.min(), len(error) // len(nodes))] = 0.0
    return np.asarray(errors)
