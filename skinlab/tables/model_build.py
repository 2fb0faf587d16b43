"""Build a database of one's own: a curve in every node, and a few between for comparison."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline

from skinlab.mechanics.fem.suction import SOLVER_VERSION
from skinlab.tables.abscissa import course_of
from skinlab.tables.build import HERE
from skinlab.tables.extrapolate import filled
from skinlab.tables.model_database import ModelDatabase
from skinlab.tables.model_spec import ModelSpec
from skinlab.tables.parallel_build import How, compute_rows
from skinlab.versions import versions

Array = NDArray[np.float64]

_CHECKS = 12  # points at which the interpolation is compared with finite elements


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
