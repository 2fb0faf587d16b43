"""One table for every aperture, thickness and pressure.

By dimensional analysis w/R = f(q, …, κ/(μ/2), h/R) with q = p/scale, the law's stiffness scale, and
… its other parameters, those in MPa by their ratio to the scale (for the paper's law q = p/X1,
X2/X1, κ/X1). The table holds log(f/q), the logarithm of the secant compliance, on coordinates in
which it is smooth: the logarithms of the ratios and of h/R, and asinh(c(h/R) q / y0), where c(h/R)
is about the compliance of a skin of that thickness under a small load. With it the bends of the
curves, from plate to membrane and to stiffening, stand at the same place for all thicknesses;
without it the interpolation along h/R is fifty times worse. Each entry knows the q up to which it
holds.

At given pressures and h/R the table becomes a function of the law's parameters, which is tabulated
on a small grid. Where the thickness is uncertain, its ratio to the stated one is one more parameter
and axis. A curve of more samples than `CURVE.most_samples` is tabulated at `CURVE.pressures`,
between which it is a cubic spline.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.compliance import small_load_compliance
from skinlab.curves.curve import Curve
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.fem.suction import (
    BLUNT_MESHES,
    EXTENSION_ABOVE,
    EXTENSION_BELOW_MBAR,
    MBAR,
    MESH_OF_RECORD,
    Geometry,
    SuctionCurve,
    solve,
)
from skinlab.mechanics.materials import DEFAULT_LAW, Law, get_law
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio, nu_from_ratio
from skinlab.mechanics.model_file import Model
from skinlab.mechanics.model_plugins import plugins_of, warn_of_table
from skinlab.parameters import Parameter, Space, stem
from skinlab.tables.any_geometry import AnyGeometry
from skinlab.tables.axes import Coordinate, TableAxis
from skinlab.tables.evaluator import Evaluator, tensor_spline
from skinlab.tables.extrapolate import fill_ratios
from skinlab.tables.meshes import MESHES
from skinlab.tables.model_errors import SeenErrors
from skinlab.tables.settings import CURVE, INTERPOLATION, VERIFY
from skinlab.tables.splines import (
    TensorBSpline,
    basis,
    coefficients,
    inverse,
    knots,
    knots_through,
)
from skinlab.tables.svd_basis import chosen, components
from skinlab.tables.table import NOT_MEASURED, Asked, Dataset, Table, plain_point

Array = NDArray[np.float64]

_GOES_ON = "goes_on_to_load"
_ERRORS = "interpolation_error"
_BLUNT = BLUNT_MESHES[1]  # does not crease where a soft surface does, and is cheap

THICKNESS = "thickness_over_radius"
# κ/(μ/2) for ν of 0 to 0.499 in both conventions. Below 2.66 only `consistent` has skins. Close
# together where curves bend; towards incompressibility they hardly do.
_DILATATION = (1.33, 1.68, 2.12, *np.geomspace(2.66, 100.2, 18).tolist(), 220.0, 1010.0)


@dataclass(frozen=True)
class Axis:
    """Nodes of one coordinate, evenly spaced in its logarithm, or as `spacing` says.

    With `values` these are the nodes, the ends among them, and the spacing is theirs.
    """

    low: float
    high: float
    nodes: int
    spacing: Literal["log", "linear"] = field(default="log", repr=False)
    values: tuple[float, ...] = field(default=(), repr=False)

    @classmethod
    def at(cls, *values: float) -> Axis:
        """Return the axis with these nodes, in the coordinate's logarithm."""
        return cls(values[0], values[-1], len(values), values=values)

    @property
    def stored(self) -> tuple[float, ...]:
        """What a file says of it."""
        return (self.low, self.high, self.nodes, *self.values)

    def coordinates(self) -> Array:
        """Return the nodes, in the coordinate: their logarithms."""
        if self.values:
            return np.log(self.values)
        if self.spacing == "linear":
            return np.linspace(self.low, self.high, self.nodes)
        return np.linspace(np.log(self.low), np.log(self.high), self.nodes)

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate."""
        return float(coordinate if self.spacing == "linear" else np.exp(coordinate))


def axis_name(law: Law, parameter: Parameter) -> str:
    """Return the name of the table's axis along a parameter: X2_over_X1, kappa_over_X1, C2."""
    if parameter.name == law.poisson:
        return law.dilatation_scale
    scale = law.parameters[0]
    if parameter.unit != scale.unit:
        return parameter.name
    return f"{stem(parameter.name, parameter.unit)}_over_{stem(scale.name, scale.unit)}"


def default_axes(law: Law) -> tuple[tuple[str, Axis], ...]:
    """Return the axes of what ships, for any law: h/R, then those of its parameters."""
    found = [(THICKNESS, Axis(0.125, 3.0, 18))]  # 0.5 mm under 8 mm … 3 mm under 2 mm
    for parameter, search in zip(law.parameters[1:], law.search[1:], strict=True):
        if parameter.name == law.poisson:
            axis = Axis.at(*_DILATATION)
        else:
            linear = search.transform == "linear"
            axis = Axis(search.low, search.high, 26, "linear" if linear else "log")
        found.append((axis_name(law, parameter), axis))
    return tuple(found)


@dataclass(frozen=True)
class DimensionlessSpec:
    """What is computed; the defaults are what ships.

    `scale_mpa` is the range of the law's scale, along which it is exact: it only scales. None: as
    the law says; so with `axis`.
    """

    law: str = DEFAULT_LAW
    scale_mpa: tuple[float, float] = (0.0, 0.0)
    axis: tuple[tuple[str, Axis], ...] = ()
    pressure_mbar: float = 500.0
    load_nodes: int = 84  # along asinh(c q / y0)
    load_scale: float = 0.03  # y0
    least_load: float = -0.05  # a noisy channel goes below zero
    mesh_name: str = MESH_OF_RECORD.name

    kind: ClassVar[str] = "dimensionless"
    model: ClassVar[Model | None] = None
    fixed_geometry: ClassVar[Geometry | None] = None

    def __post_init__(self) -> None:
        """Fill in what the law says."""
        law = get_law(self.law)
        if not any(self.scale_mpa):
            object.__setattr__(self, "scale_mpa", (law.search[0].low, law.search[0].high))
        given = dict(self.axis)
        expected = default_axes(law)
        for name in given:
            if name not in dict(expected):
                raise InputError(
                    f"axis.{name} is not known; expected one of: {', '.join(dict(expected))}"
                )
        axes = tuple((name, given.get(name, axis)) for name, axis in expected)
        object.__setattr__(self, "axis", axes)

    @property
    def axes(self) -> dict[str, Axis]:
        """The axes by name, in the order of the arrays."""
        return dict(self.axis)

    @property
    def thickness(self) -> Axis:
        """The axis of h/R."""
        return self.axis[0][1]

    @property
    def most_load(self) -> float:
        """Largest q: the softest skin at the highest pressure, its small extension included."""
        return self.pressure_mbar * MBAR * (1 + EXTENSION_ABOVE) / self.scale_mpa[0]

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes along h/R and the ratios."""
        return tuple(axis.nodes for _, axis in self.axis)

    @property
    def entries(self) -> int:
        """Number of curves."""
        return int(np.prod(self.shape))

    def coordinate(self, load: Array, thickness_over_radius: float | Array) -> Array:
        """Return asinh(c q / y0) of loads q."""
        return np.asarray(
            np.arcsinh(small_load_compliance(thickness_over_radius) * load / self.load_scale)
        )

    def load(self, coordinate: Array, thickness_over_radius: float) -> Array:
        """Return the loads q at coordinates: the inverse of `coordinate`."""
        return np.asarray(
            self.load_scale * np.sinh(coordinate) / small_load_compliance(thickness_over_radius)
        )

    def load_coordinates(self) -> Array:
        """Return the nodes along asinh(c q / y0): wide enough for the thinnest skin."""
        ends = np.array([self.least_load, self.most_load])
        low, high = self.coordinate(ends, self.thickness.low)
        return np.linspace(low, high, self.load_nodes)

    @property
    def summary(self) -> str:
        """What will be computed, in a line."""
        axes = ", ".join(f"{n} {a.low:g}–{a.high:g} × {a.nodes}" for n, a in self.axis)
        return f"{self.entries} curves for every opening, law {self.law}: {axes}"

    # ---- build ----

    @property
    def identity(self) -> str:
        """All that the numbers depend on but the solver's version."""
        return f"{self._text} {self.mesh_name}"

    @property
    def rows(self) -> tuple[int, int]:
        """Rows, the check points behind those of the grid, and numbers in each.

        These are log compliances, the q to which it holds, and goes on.
        """
        return self.entries + INTERPOLATION.checks_any, self.load_nodes + 2

    def node(self, entry: int) -> Array:
        """Return the coordinates of the entry with this flat number."""
        at = np.unravel_index(entry, self.shape)
        return np.array([a.coordinates()[i] for (_, a), i in zip(self.axis, at, strict=True)])

    def check_points(self) -> Array:
        """Return the coordinates (m, d) at which the interpolation is checked: any cell, alike."""
        share = np.random.default_rng(0).random((INTERPOLATION.checks_any, len(self.axis)))
        columns = []
        for (_, axis), u in zip(self.axis, share.T, strict=True):
            cells = np.arange(axis.nodes)
            columns.append(np.interp(u * (axis.nodes - 1), cells, axis.coordinates()))
        return np.stack(columns, axis=1)

    def check_coordinates(self) -> Array:
        """Return where along the load: half-way between its nodes, the last beyond them all."""
        nodes = self.load_coordinates()
        return np.asarray(nodes + 0.5 * (nodes[1] - nodes[0]))

    def row(self, entry: int) -> Array:
        """Return one entry: log compliance (load,); the q to which it holds, and goes on.

        By finite elements with R = 1 mm and a scale of 1 MPa. Where the skin creases it goes on
        with a blunter edge, moved to meet the curve there; NaN beyond the end of that.
        """
        law = get_law(self.law)
        between = entry - self.entries
        at = self.node(entry) if between < 0 else self.check_points()[between]
        coordinates = self.load_coordinates() if between < 0 else self.check_coordinates()
        thickness, *others = (
            axis.value(x) for (_, axis), x in zip(self.axis, at.tolist(), strict=True)
        )
        values, ratio = {law.scale: 1.0}, None
        for parameter, value in zip(law.parameters[1:], others, strict=True):
            if parameter.name == law.poisson:
                ratio = value
            else:
                values[parameter.name] = value
        from skinlab.mechanics.fem.newton import StepSettings

        # Steps in the table's own units: R = 1 mm, scale = 1 MPa, so that 1 mbar is q = 1e-4.
        steps = StepSettings(extrapolation_error=3e-5, smallest_step_mbar=0.5, limit_mbar=20.0)
        geometry = Geometry(2.0, thickness)
        skin = values if ratio is None else law.with_ratio(values, ratio)
        law.check_small_strains(skin)
        top_mbar = self.most_load / MBAR
        curve = solve(
            geometry, skin, top_mbar, law=self.law, discretisation=MESHES[self.mesh_name],
            settings=steps, below_mbar=-self.least_load / MBAR,
        )  # fmt: skip
        if len(curve.pressure_mbar) < 2:
            where = zip((name for name, _ in self.axis), (thickness, *others), strict=True)
            raise InputError(
                f"{law.plugin or f'law {self.law!r}'}: it does not hold for any suction where "
                + ", ".join(f"{name} is {value:g}" for name, value in where)
            )
        load = self.load(coordinates, thickness)
        holds_to = curve.holds_to_mbar * MBAR
        row = _log_secant(
            curve, np.where((load >= self.least_load) & (load <= holds_to), load, np.nan)
        )
        if not curve.stopped:
            return np.append(row, [holds_to, holds_to])
        blunt = solve(
            geometry, skin, top_mbar, law=self.law, discretisation=_BLUNT,
            settings=replace(steps, extrapolation_error=3e-4),
        )  # fmt: skip
        goes_to = max(blunt.holds_to_mbar * MBAR, holds_to)
        beyond = (load > holds_to) & (load <= goes_to)
        if beyond.any():
            row[beyond] = _log_secant(blunt, load[beyond])
            if between < 0:
                ends = np.array([holds_to])
                row[beyond] += _log_secant(curve, ends) - _log_secant(blunt, ends)
            else:  # by a length, as where finite elements answer: how is not known
                moved = float(curve.spline(holds_to / MBAR) - blunt.spline(holds_to / MBAR))
                row[beyond] = np.log(np.exp(row[beyond]) + moved / load[beyond])
        return np.append(row, [holds_to, goes_to])

    def table(self, rows: Array, solver_version: str, versions: dict[str, str]) -> Table:
        """Return the table made of all rows."""
        own = plugins_of(self.law, ())
        facts = {"versions": {k: v for k, v in versions.items() if k in own}} if own else {}
        rows, computed = rows[: self.entries], rows[self.entries :, :-2]
        compliance = rows[:, :-2].reshape(*self.shape, -1)
        filled = fill_ratios(compliance, self.load_coordinates()).astype(np.float32)
        holds, goes_on = (np.ascontiguousarray(at).reshape(self.shape) for at in rows[:, -2:].T)
        extra = {_GOES_ON: goes_on}
        table = Table(self, filled, holds, self.mesh_name, solver_version, extra, facts)
        errors = self._errors(table, computed)
        return replace(table, extra={**extra, _ERRORS: errors})

    def _errors(self, table: Table, computed: Array) -> Array:
        """Return interpolated less computed log compliances (m, load); beyond the end, the last.

        The end is where the check point or a corner of its cell does not go on. Interpolated as an
        `Evaluator` does, along the ratios in w itself.
        """
        points, at = self.check_points(), self.check_coordinates()
        errors = np.stack([self._between(table, point, at) for point in points]) - computed
        axes = [axis.coordinates() for _, axis in self.axis]
        for error, point in zip(errors, points, strict=True):
            cell = [
                int(np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2))
                for nodes, x in zip(axes, point, strict=True)
            ]
            corners = table.extra[_GOES_ON][tuple(slice(i, i + 2) for i in cell)]
            load = self.load(at, self.thickness.value(float(point[0])))
            held = np.flatnonzero((load <= corners.min()) & np.isfinite(error))
            error[:] = np.interp(np.arange(len(at)), held, error[held]) if len(held) else 0.0
        return np.asarray(errors)

    def _between(self, table: Table, point: Array, coordinates: Array) -> Array:
        """Return log compliances (u,) at a point (d,) of the axes and coordinates (u,) of loads."""
        load = self.load(coordinates, self.thickness.value(float(point[0])))
        curves = self._tabulate(table, float(point[0]), load / MBAR, np.zeros(1), 1.0)[0]
        axes = self._axes("paper")[1:]
        grid = curves.T.reshape(*self.shape[1:], -1)
        return np.asarray(np.log(tensor_spline(axes, grid)(point[None, 1:])[0] / load))

    def difference(self, table: Table, entry: int) -> str:
        """Compute an entry again; return how it differs in a sentence, or ''."""
        *computed, holds_to, _ = self.row(entry)
        at = np.unravel_index(entry, self.shape)
        off = np.abs(np.array(computed) - table.values[at])  # NaN: filled, not computed
        # A table that was built before ends where the skin creases: beyond, it is filled.
        ends = float(table.extra.get(_GOES_ON, table.holds_to)[at])
        thickness = self.thickness.value(self.thickness.coordinates()[at[0]])
        off[self.load(self.load_coordinates(), thickness) > ends] = np.nan
        worst, stored = float(np.nanmax(off)), float(table.holds_to[at])
        if worst <= VERIFY.log and abs(holds_to - stored) <= VERIFY.holds * stored:
            return ""
        return f"entry {tuple(int(k) for k in at)} differs by {worst:.3g} of its deflection"

    # ---- use ----

    def space(self, table: Table, kappa: KappaConvention) -> Space:
        """Return where the law says that fits look, as far as the table goes."""
        del table
        law = get_law(self.law)
        low, high = [self.scale_mpa[0]], [self.scale_mpa[1]]
        for parameter, search, (_, axis) in zip(
            law.parameters[1:], law.search[1:], self.axis[1:], strict=True
        ):
            first, last = axis.low, axis.high
            if parameter.name == law.poisson:
                own = kappa_ratio(search.low, kappa), kappa_ratio(search.high, kappa)
                first = search.low if own[0] >= first else float(nu_from_ratio(first, kappa))
                last = search.high if own[1] <= last else float(nu_from_ratio(last, kappa))
            low.append(first)
            high.append(last)
        return replace(law.space, low=tuple(low), high=tuple(high))

    def covered(self, pressure_mbar: Array) -> NDArray[np.bool_]:
        """Return which pressures (n,) the table speaks of, its small extensions included."""
        high = self.pressure_mbar * (1 + EXTENSION_ABOVE)
        return np.asarray((pressure_mbar >= -EXTENSION_BELOW_MBAR) & (pressure_mbar <= high))

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: the thickness is outside the table; names the curve.
        """
        try:
            self._check(Geometry(curve.setup.aperture_mm, curve.setup.thickness_mm))
        except NotTrustworthyError as error:
            raise NotTrustworthyError(f"{curve.name}: {error}") from None
        return self.covered(curve.pressure_mbar)

    def _check(self, geometry: Geometry) -> None:
        asked, ends = geometry.thickness_mm / geometry.radius_mm, self.thickness
        if not ends.low * (1 - 1e-12) <= asked <= ends.high * (1 + 1e-12):
            raise NotTrustworthyError(
                f"thickness/radius {asked:.4g} is outside the database "
                f"({ends.low:g}–{ends.high:g}): {geometry.thickness_mm:g} mm of skin under a "
                f"{geometry.aperture_mm:g} mm opening"
            )

    def point(self, base: Mapping[str, float], effects: Effects) -> Array:
        """Return the parameters (p,).

        Raises:
            InputError: there are effects.
        """
        return plain_point(self.law, base, effects)

    def evaluator(self, table: Table, asked: Asked) -> Evaluator:
        """Return the table at this geometry and these pressures.

        Raises:
            NotTrustworthyError: the thickness is outside the table.
        """
        geometry, kappa, sd_mm = asked.geometry, asked.kappa, asked.thickness_sd_mm
        self._check(geometry)
        log_thickness = math.log(geometry.thickness_mm / geometry.radius_mm)
        axes, space = self._axes(kappa), self.space(table, kappa)
        thicknesses = np.array([log_thickness])
        if sd_mm > 0.0:
            thicknesses = self._around(log_thickness, sd_mm / geometry.thickness_mm)
            log_ratio = thicknesses - log_thickness
            axes.append(TableAxis(Coordinate("log"), log_ratio))
            low, high = math.exp(log_ratio[0]), math.exp(log_ratio[-1])
            space = space.extended("thickness_ratio", low, high)
        at_mbar, spread = self._nodes_for(log_thickness, asked.pressure_mbar)
        radius = geometry.radius_mm
        curves = [self._tabulate(table, t, at_mbar, axes[0].nodes, radius) for t in thicknesses]
        wide, turn = (None, None) if spread is None else np.linalg.qr(spread)
        # Rows (scale, ratios, thickness) of curves, a few of which say in what they all live.
        shape = (len(axes[0].nodes), curves[0].shape[2], len(thicknesses))
        some = chosen(math.prod(shape))
        scale, ratio, thickness = np.unravel_index(some, shape)
        rows = np.empty((len(some), len(at_mbar)))
        for t, one in enumerate(curves):
            here = thickness == t
            rows[here] = one[scale[here], :, ratio[here]]
        q = components(rows if turn is None else rows @ turn.T)  # (nodes, k), orthonormal
        onto = q if turn is None else turn.T @ q
        each = [np.swapaxes(onto.T @ one, 1, 2) for one in curves]  # (scale, ratios, k)
        grid = each[0] if len(each) == 1 else np.stack(each, axis=2)
        return Evaluator(
            space,
            axes,
            tensor_spline(axes, grid.reshape(*(len(axis.nodes) for axis in axes), -1)),
            q if wide is None else wide @ q,
            self._at(table.holds_to, thicknesses),
            asked.pressure_mbar,
            load_mbar=1.0 / MBAR,
            relative_errors=self._relative_errors(table, asked),
            goes_on_to=self._at(table.extra.get(_GOES_ON, table.holds_to), thicknesses),
        )

    def _seen_errors(self, table: Table) -> Callable[[float], SeenErrors] | None:
        """Return by how much it was off along q, by h/R; None: that was not measured."""
        if _ERRORS not in table.extra:
            return None
        at, shares = self.check_coordinates(), table.extra[_ERRORS]
        return lambda thickness: SeenErrors(self.load(at, thickness), shares)

    def _relative_errors(self, table: Table, asked: Asked) -> Callable[[float], Array] | None:
        """Return the shapes (u, m) of the interpolation's error by the scale; None: not known."""
        by_thickness = self._seen_errors(table)
        if by_thickness is None:
            return None
        seen = by_thickness(asked.geometry.thickness_mm / asked.geometry.radius_mm)
        load = asked.pressure_mbar * MBAR
        return lambda scale: seen.shapes(load / scale)

    def any_geometry(self, table: Table, kappa: KappaConvention) -> AnyGeometry:
        """See `Table.any_geometry`."""
        axes = [TableAxis(Coordinate("log"), self.thickness.coordinates()), *self._axes(kappa)[1:]]
        return AnyGeometry(
            axes,
            _all_coefficients(table),
            TensorBSpline(
                [knots_through(axis.nodes, 1) for axis in axes],
                [1] * len(axes),
                np.log(np.maximum(table.holds_to, 1e-300))[..., None],
            ),
            knots(self.load_coordinates()),
            self.coordinate,
            self._seen_errors(table),
        )

    def _axes(self, kappa: KappaConvention) -> list[TableAxis]:
        """Return the small grid's axes along the law's parameters."""
        law = get_law(self.law)
        low, high = self.scale_mpa
        axes = [
            TableAxis(Coordinate("log"), np.linspace(math.log(low), math.log(high), CURVE.scale))
        ]
        for parameter, search, (_, axis) in zip(
            law.parameters[1:], law.search[1:], self.axis[1:], strict=True
        ):
            dilatation = parameter.name == law.poisson
            coordinate = (
                Coordinate("dilatation", kappa) if dilatation else Coordinate(search.transform)
            )
            axes.append(TableAxis(coordinate, axis.coordinates()))
        return axes

    def _tabulate(
        self,
        table: Table,
        log_thickness: float,
        pressure_mbar: Array,
        log_scales: Array,
        radius_mm: float,
    ) -> Array:
        """Return w, mm, on the grid (scale, u, ratios)."""
        weights = basis(self.thickness.coordinates(), np.array([log_thickness]))[0]
        stored = _load_coefficients(table, int(np.flatnonzero(weights)[0]))
        at_thickness = np.tensordot(weights, stored, axes=1)  # (ratios…, load)
        load = np.outer(np.exp(-log_scales), pressure_mbar * MBAR)  # (scale, u)
        axis = self.load_coordinates()
        spline = knots(axis)
        at = np.clip(self.coordinate(load, math.exp(log_thickness)), spline[0], spline[-1])
        flat = at_thickness.reshape(-1, len(axis))
        log_compliance = TensorBSpline([spline], [3], flat.T)(at.reshape(-1, 1))  # (…, ratios)
        curves = np.exp(log_compliance, out=log_compliance)
        curves *= radius_mm * load.ravel()[:, None]
        return curves.reshape(*load.shape, -1)

    def _around(self, log_thickness: float, relative_sd: float) -> Array:
        """Return log h/R nodes about a thickness, as far as it is likely and the table goes."""
        axis = self.thickness
        low = log_thickness + math.log(max(1.0 - CURVE.thickness_reach * relative_sd, 0.2))
        high = log_thickness + math.log(1.0 + CURVE.thickness_reach * relative_sd)
        low, high = max(low, math.log(axis.low)), min(high, math.log(axis.high))
        return np.linspace(low, high, max(7, math.ceil((high - low) / CURVE.thickness_step) + 1))

    def _nodes_for(self, log_thickness: float, pressure_mbar: Array) -> tuple[Array, Array | None]:
        """Return the pressures to tabulate, and the matrix (u, nodes) from there to the samples.

        Between the nodes curves are cubic splines in the table's own coordinate of the softest
        skin.
        """
        if len(pressure_mbar) <= CURVE.most_samples:
            return pressure_mbar, None
        softest, thickness = self.scale_mpa[0], math.exp(log_thickness)
        ends = np.array([pressure_mbar.min(), max(float(pressure_mbar.max()), 1e-6)])
        low, high = self.coordinate(ends * MBAR / softest, thickness)
        nodes = np.linspace(low, high, CURVE.pressures)
        at = self.coordinate(pressure_mbar * MBAR / softest, thickness)
        spread = basis(nodes, at) @ coefficients(np.eye(CURVE.pressures), 0)
        return softest / MBAR * self.load(nodes, thickness), spread

    def _at(self, loads: Array, log_thicknesses: Array) -> Array:
        """Return loads (h/R, ratios…) at the nodes (ratios…[, thickness])."""
        nodes = self.thickness.coordinates()
        limits = np.log(loads).reshape(len(nodes), -1)
        below = np.clip(
            np.searchsorted(nodes, log_thicknesses, side="right") - 1, 0, len(nodes) - 2
        )
        share = (log_thicknesses - nodes[below]) / (nodes[below + 1] - nodes[below])
        share = np.clip(share, 0.0, 1.0)[:, None]
        at = ((1.0 - share) * limits[below] + share * limits[below + 1]).T
        held = np.exp(at).reshape(*self.shape[1:], -1)
        return held[..., 0] if len(log_thicknesses) == 1 else held

    def describe(self, table: Table) -> list[str]:
        """Return what is in it."""
        lines = ["dimensionless: every aperture, thickness and pressure within"]
        for name, axis in self.axis:
            lines.append(f"  {name:<22}{axis.low:g} to {axis.high:g}, {axis.nodes} nodes")
        scale = get_law(self.law).parameters[0]
        low, high = self.scale_mpa
        lines.append(f"  {scale.name:<22}{low:g} to {high:g}, exact")
        lines.append(f"  {'pressure_mbar':<22}0 to {self.pressure_mbar:g}")
        median = float(np.median(table.holds_to))
        some = math.exp(0.5 * math.log(low * high))
        shown = 0.025 if low < 0.025 < high else some
        lines.append(
            f"{self.entries} curves; half of them hold to p/{scale.label} = {median:.3g} or more "
            f"({median * shown / MBAR:.0f} mbar at {scale.label} {shown:.3g} {scale.unit})"
        )
        said = self.between(table)
        lines.append(NOT_MEASURED if said is None else said)
        return [line for line in lines if line]

    def between(self, table: Table) -> str | None:
        """See `Spec`: '' of the one that ships, None of a file that was built before."""
        if _ERRORS in table.extra:
            rms = 100.0 * np.sqrt(np.mean(table.extra[_ERRORS] ** 2, axis=1))
            return (
                f"between the nodes off by {np.median(rms):.2g} % of the deflection rms, at worst "
                f"{rms.max():.2g} % ({len(rms)} points compared with finite elements)"
            )
        return "" if table.path is None else None

    # ---- files ----

    @property
    def _text(self) -> str:
        axes = "".join(f"{name}={axis!r}, " for name, axis in self.axis)
        linear = [name for name, axis in self.axis if axis.spacing == "linear"]
        uneven = {name: axis.values for name, axis in self.axis if axis.values}
        return (
            f"DimensionlessSpec(law={self.law!r}, {get_law(self.law).scale}={self.scale_mpa!r}, "
            f"pressure_mbar={self.pressure_mbar!r}, {axes}load_nodes={self.load_nodes!r}, "
            f"load_scale={self.load_scale!r}, least_load={self.least_load!r}"
            f"{f', linear={linear!r}' if linear else ''}{f', at={uneven!r}' if uneven else ''})"
        )

    def head(self, table: Table) -> str:
        """Return what the content hash begins with."""
        return f"({self._text}, {table.mesh_name!r}, {table.solver_version!r})"

    def attributes(self, table: Table) -> dict[str, Any]:
        """Return what a file says besides the arrays."""
        return {
            "law": self.law,
            "mesh": table.mesh_name,
            get_law(self.law).scale: self.scale_mpa,
            "pressure_mbar": self.pressure_mbar,
            "load_nodes": self.load_nodes,
            "load_scale": self.load_scale,
            "least_load": self.least_load,
            **{name: axis.stored for name, axis in self.axis},
            **{name: json.dumps(said) for name, said in table.facts.items()},
        }

    def datasets(self, table: Table) -> list[Dataset]:
        """Return the arrays of a file."""
        axes = ", ".join([*(name for name, _ in self.axis), "load"])
        # Not compressed: it must load at once, and it is small.
        return [
            Dataset("log_compliance", table.values, "1", axes),
            Dataset("holds_to_load", table.holds_to, "1"),
            *(Dataset(name, values, "1") for name, values in table.extra.items()),
        ]

    @classmethod
    def read(cls, file: Any) -> Table:
        """Return the table in an HDF5 file."""
        attrs = file.attrs
        versions = json.loads(str(attrs.get("versions", "{}")))
        warn_of_table(file.filename, str(attrs["law"]), (), versions)
        law = get_law(str(attrs["law"]))
        axes = tuple(
            (name, _stored_axis(axis, np.asarray(at, dtype=float).tolist()))
            for name, axis in default_axes(law)
            for at in [attrs[name]]
        )
        low, high = attrs[law.scale]
        spec = cls(
            law=law.name,
            scale_mpa=(float(low), float(high)),
            axis=axes,
            pressure_mbar=float(attrs["pressure_mbar"]),
            load_nodes=int(attrs["load_nodes"]),
            load_scale=float(attrs["load_scale"]),
            least_load=float(attrs["least_load"]),
            mesh_name=str(attrs["mesh"]),
        )
        return Table(
            spec,
            file["log_compliance"][:],
            file["holds_to_load"][:],
            str(attrs["mesh"]),
            str(attrs["solver_version"]),
            # Tables built before ended where the skin creases.
            # Those and the one that ships have not measured how far they are off between the nodes.
            extra={name: file[name][:] for name in (_GOES_ON, _ERRORS) if name in file},
            facts={"versions": versions} if versions else {},
        )


def _log_secant(curve: SuctionCurve, load: Array) -> Array:
    """Return log(w / (R q)) of a curve of R = 1 mm at loads q (n,); NaN at NaN."""
    secant = np.where(np.abs(load) < 1e-9, curve.spline(0.0, 1) / MBAR, np.nan)  # the tangent
    some = np.isfinite(load) & (np.abs(load) >= 1e-9)
    secant[some] = curve.spline(load[some] / MBAR) / load[some]
    return np.asarray(np.log(secant))


def _stored_axis(default: Axis, at: list[float]) -> Axis:
    low, high, nodes, *values = at
    return Axis(low, high, int(nodes), default.spacing, tuple(values))


@lru_cache(maxsize=8)
def _load_coefficients(table: Table, first: int) -> Array:
    """Return the B-spline coefficients of the table along h/R and the load.

    Of h/R's only those of the four splines from `first` on, which are all that one thickness needs;
    the others, zeros, take no memory.
    """
    values = table.values.astype(np.float64)
    n, here = len(values), slice(first, first + 4)
    found = np.zeros_like(values)
    rows = (inverse(n)[here] @ values.reshape(n, -1)).reshape(-1, *values.shape[1:])
    found[here] = coefficients(rows, values.ndim - 1)
    return found


@lru_cache(maxsize=4)
def _all_coefficients(table: Table) -> TensorBSpline:
    """Return the spline along h/R and the ratios, of the coefficients along the load."""
    assert isinstance(table.spec, DimensionlessSpec)
    axes = [TableAxis(Coordinate("log"), table.spec.thickness.coordinates())]
    axes += table.spec._axes("paper")[1:]
    values = coefficients(table.values.astype(np.float64), table.values.ndim - 1)
    for d, axis in enumerate(axes):
        values = axis.coefficients(values, d)
    return TensorBSpline([a.knots for a in axes], [a.degree for a in axes], values)
