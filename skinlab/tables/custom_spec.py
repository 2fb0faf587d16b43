"""What a custom table is computed of: model, axes, pressures, mesh and measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product
from typing import Any, ClassVar

import msgspec
import numpy as np
from msgspec import field
from numpy.typing import NDArray

from skinlab.curves.apertures import check_aperture
from skinlab.curves.curve import Curve, check_thickness
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import MOST_PRESSURE_MBAR, Program, parse_program
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.effects.model import going_on, problem_of
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, Discretisation, Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_file import Model
from skinlab.mechanics.model_plugins import warn_of_table
from skinlab.parameters import Parameter, Space, Transform
from skinlab.tables.abscissa import Abscissa, PressureAbscissa, ProgramAbscissa
from skinlab.tables.axes import AxisRange, Spacing, TableAxis, axis_of
from skinlab.tables.evaluator import Evaluator, tensor_spline
from skinlab.tables.extrapolate import fill_curves
from skinlab.tables.meshes import MESHES
from skinlab.tables.model_errors import interpolation_shapes
from skinlab.tables.settings import INTERPOLATION, NODES, VERIFY
from skinlab.tables.svd_basis import chosen, components
from skinlab.tables.table import Asked, Dataset, Table

Array = NDArray[np.float64]

_ERRORS, _GOES_ON = "interpolation_error", "goes_on_to"
_OF_TIME = (
    "effects of its model depend on time or cycle, so that it holds along one program; one that "
    "was built without is to be built again"
)
_CURVES = (("deflection_mm", "mm"), ("slope_mm_per_mbar", "mm/mbar"))


class Pressures(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[pressures]: from 0 to `high_mbar`, both nodes (None: the program's top, else 100)."""

    high_mbar: float | None = None
    nodes: int = 51
    spacing: Spacing = "linear"


class MeshChoice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[mesh]."""

    name: str = MESH_OF_RECORD.name


class Measurement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[measurement]: with what the curves are measured."""

    aperture_mm: float = 6.0
    thickness_mm: float = 1.0
    program: str | None = None
    cycle: int = 1


class CustomSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is computed: every field filled in. `axis` is in the order of the table's axes."""

    model: Model
    axis: dict[str, AxisRange]
    pressures: Pressures
    mesh: MeshChoice = field(default_factory=MeshChoice)
    measurement: Measurement = field(default_factory=Measurement)

    kind: ClassVar[str] = "model"

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes along each axis."""
        return tuple(axis.nodes for axis in self.axis.values())

    @property
    def entries(self) -> int:
        """Number of curves."""
        return math.prod(self.shape)

    @property
    def geometry(self) -> Geometry:
        """Opening and thickness."""
        return Geometry(self.measurement.aperture_mm, self.measurement.thickness_mm)

    @property
    def program(self) -> Program | None:
        """What the pump does; None where the deflection depends on the pressure alone."""
        text = self.measurement.program
        return None if text is None else parse_program(text)

    @property
    def discretisation(self) -> Discretisation:
        """The mesh and its elements."""
        return MESHES[self.mesh.name]

    @property
    def high_mbar(self) -> float:
        """Highest pressure."""
        assert self.pressures.high_mbar is not None
        return self.pressures.high_mbar

    @property
    def has_history(self) -> bool:
        """Whether an effect depends on time or cycle."""
        return self.model.needs_history

    def skin(self, point: Sequence[float]) -> tuple[Skin, dict[str, dict[str, float]]]:
        """Return the skin and the effects' values at a point of the axes."""
        at = dict(zip(self.axis, map(float, point), strict=True))
        effects = {name: dict(values) for name, values in self.model.values.items()}
        for name, value in at.items():
            effect, _, parameter = name.rpartition(".")
            if effect:
                effects[effect][parameter] = value
        head, law = self.model.model, self.model.law
        return Skin(tuple(at[name] for name in law.names), head.kappa, head.law), effects

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        return self.model.model.law

    @property
    def mesh_name(self) -> str:
        """Name of the discretisation."""
        return self.mesh.name

    @property
    def fixed_geometry(self) -> Geometry:
        """The only opening and thickness that it speaks of."""
        return self.geometry

    @property
    def abscissa(self) -> Abscissa:
        """Along what it holds its curves."""
        return _abscissa(self.program if self.has_history else None, self.high_mbar, self.pressures)

    @property
    def axes(self) -> tuple[TableAxis, ...]:
        """How its curves run along each axis."""
        kappa, poisson = self.model.model.kappa, self.model.law.poisson
        return tuple(
            axis_of(axis, kappa=kappa if name == poisson else None)
            for name, axis in self.axis.items()
        )

    @property
    def summary(self) -> str:
        """What will be computed, in a line."""
        axes = ", ".join(f"{n} {a.low:g}–{a.high:g} × {a.nodes}" for n, a in self.axis.items())
        at = (
            f"{self.geometry.aperture_mm:g} mm opening on {self.geometry.thickness_mm:g} mm of skin"
        )
        along = f", along {self.program} only" if self.has_history else ""
        return f"{self.entries} curves, {at}{along}: {axes}"

    # ---- build ----

    @property
    def identity(self) -> str:
        """All that the numbers depend on but the solver's version."""
        return self.to_json()

    @property
    def rows(self) -> tuple[int, int]:
        """Rows, the check points behind those of the grid, and numbers in each.

        The last is how many of the nodes come before the skin creases.
        """
        return self.entries + INTERPOLATION.checks, self.abscissa.width + 1

    def node(self, entry: int) -> tuple[float, ...]:
        """Return the values along the axes of the entry with this flat number."""
        at = np.unravel_index(entry, self.shape)
        return tuple(float(a.values()[i]) for a, i in zip(self.axis.values(), at, strict=True))

    def check_points(self) -> Array:
        """Return the points (m, k) between the nodes at which the interpolation is checked."""
        share = np.random.default_rng(0).random((INTERPOLATION.checks, len(self.axis)))
        columns = []
        for axis, u in zip(self.axis.values(), share.T, strict=True):
            log = axis.spacing == "log"
            even = axis.low + (axis.high - axis.low) * u
            columns.append(axis.low * (axis.high / axis.low) ** u if log else even)
        return np.stack(columns, axis=1)

    def row(self, entry: int) -> Array:
        """Return one entry's row by finite elements, NaN where the skin does not go on either."""
        between = entry - self.entries
        point = self.node(entry) if between < 0 else self.check_points()[between]
        skin, effects = self.skin(point)
        held = np.ones(len(self.abscissa.nodes), dtype=bool)

        def respond(path: PressurePath, time_s: Array, pressure_mbar: Array) -> Array:
            found = going_on(
                skin, effects, self.geometry, path, time_s, pressure_mbar,
                cycle=self.measurement.cycle, discretisation=self.discretisation,
            )  # fmt: skip
            np.logical_and(held, found.held, out=held)
            return found.deflection_mm

        row = self.abscissa.row(respond)
        return np.append(row, _first_lost(held[None])[0])

    def table(self, rows: Array, solver_version: str, versions: dict[str, str]) -> Table:
        """Return the table made of all rows."""
        nodes, width = self.abscissa.nodes, self.abscissa.width
        rows, held = rows[:, :-1].copy(), rows[:, -1].astype(int)
        going = np.all(np.isfinite(rows).reshape(len(rows), -1, len(nodes)), axis=1)
        gone = np.maximum(_first_lost(going), held)
        # Later samples that seem to hold again are of a skin that did not get there.
        lost = np.arange(len(nodes)) >= gone[:, None]
        rows[np.tile(lost, width // len(nodes))] = np.nan
        holds, goes_on = (
            np.where(n > 0, nodes[n - 1], -np.inf)[: self.entries].reshape(self.shape)
            for n in (held, gone)
        )
        grid, between = np.split(rows, [self.entries])
        curves = fill_curves(grid.reshape(*self.shape, -1))
        extra = {_ERRORS: self._errors(curves, holds, between), _GOES_ON: goes_on}
        facts = {"versions": versions}
        return Table(self, curves, holds, self.mesh_name, solver_version, extra, facts)

    def _errors(self, curves: Array, holds_to: Array, computed: Array) -> Array:
        """Return interpolated less computed rows (m, width); zero where either ends."""
        nodes, axes = self.abscissa.nodes, self.axes
        at = self.check_points().T
        points = np.stack([a.coordinate(p, p) for a, p in zip(axes, at, strict=True)], axis=1)
        errors = np.nan_to_num(tensor_spline(axes, curves)(points) - computed)
        for error, point in zip(errors, points, strict=True):  # as far as the point's cell holds
            cell = [int(axis.cell(point[[d]])[0]) for d, axis in enumerate(axes)]
            corners = holds_to[tuple(slice(i, i + 2) for i in cell)]
            error[np.tile(nodes > corners.min(), len(error) // len(nodes))] = 0.0
        return np.asarray(errors)

    def difference(self, table: Table, entry: int) -> str:
        """Compute an entry again; return how it differs in a sentence, or ''."""
        nodes = self.abscissa.nodes
        at = np.unravel_index(entry, self.shape)
        computed = self.row(entry)[:-1].reshape(-1, len(nodes))
        stored = table.values[at].reshape(-1, len(nodes))
        held = nodes <= table.holds_to[at]  # beyond: filled, not computed
        off = np.abs(computed - stored)[:, held]
        if np.all(off <= VERIFY.mm):
            return ""
        named = ", ".join(f"{n} {v:g}" for n, v in zip(self.axis, self.node(entry), strict=True))
        return f"entry {named} differs by {float(np.max(off)):.3g} mm"

    # ---- use ----

    def space(self, table: Table | None, kappa: KappaConvention) -> Space:
        """Return where it holds at all: even as the model's priors say, else as the axes are."""
        del table, kappa
        transforms: list[Transform] = []
        for name, axis in self.axis.items():
            own = None if "." in name else self.model.prior(name)
            even = own if own in ("uniform", "log-uniform") else _AS_SPACED[axis.spacing]
            transforms.append("log" if axis.low > 0 and even == "log-uniform" else "linear")
        axes = self.axis.values()
        low, high = tuple(a.low for a in axes), tuple(a.high for a in axes)
        return Space(tuple(self.axis), low, high, tuple(transforms))

    def point(self, base: Mapping[str, float], effects: Effects) -> Array:
        """Return the parameters (p,); what `effects` do not give is the model's own value.

        Raises:
            InputError: a value is none of this table's; says which.
        """
        at = self.model.law.named(self.model.law.ordered(base))
        own = self.model.values
        for effect, values in effects.items():
            for parameter, value in values.items():
                name = f"{effect}.{parameter}"
                if name not in self.axis and own.get(effect, {}).get(parameter) != value:
                    raise InputError(f"{name} {value:g} is not one of this database's")
        for name, axis in self.axis.items():
            effect, _, parameter = name.rpartition(".")
            if effect:
                at[name] = effects.get(effect, {}).get(parameter, own[effect][parameter])
            if not axis.low <= at[name] <= axis.high:
                raise InputError(
                    f"{name} {at[name]:g} is outside the database ({axis.low:g}–{axis.high:g})"
                )
        return np.array([at[name] for name in self.axis])

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: it does not speak of such a curve at all; says why.
        """
        setup, own = curve.setup, self.measurement
        try:
            geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
            self._check(geometry, setup.thickness_sd_mm or 0.0)
        except NotTrustworthyError as error:
            raise NotTrustworthyError(f"{curve.name}: {error}") from None
        if self.has_history and setup.cycle != own.cycle:
            raise NotTrustworthyError(
                f"{curve.name}: cycle {setup.cycle}, and this database holds for cycle "
                f"{own.cycle} only"
            )
        return self.abscissa.covered(curve)

    def evaluator(self, table: Table, asked: Asked) -> Evaluator:
        """Return it at these pressures (u,) and times since the program's start (u,).

        Raises:
            NotTrustworthyError: it does not speak of this geometry, uncertainty or convention, or
                needs times, and there are none.
        """
        self._check(asked.geometry, asked.thickness_sd_mm)
        kappa, stated = asked.kappa, self.model.model.kappa
        if kappa != stated:
            raise NotTrustworthyError(f"kappa {kappa!r}, and this database holds for {stated!r}")
        abscissa, axes = self.abscissa, self.axes
        operator = abscissa.operator(asked.pressure_mbar, asked.time_s)
        along = abscissa.along(asked.pressure_mbar, asked.time_s)
        errors = table.extra[_ERRORS]
        wide, turn = np.linalg.qr(operator)
        curves = table.values.reshape(-1, table.values.shape[-1]) @ turn.T
        q = components(curves[chosen(len(curves))])  # of samples, in an orthonormal basis
        end = float(abscissa.nodes[-1]) - 1e-6
        return Evaluator(
            self.space(table, kappa),
            axes,
            tensor_spline(axes, (curves @ q).reshape(*self.shape, -1)),
            wide @ q,
            table.holds_to,
            np.minimum(along, end),
            goes_on_to=table.extra.get(_GOES_ON),
            errors_mm=interpolation_shapes(operator @ errors.T, along / end),
        )

    def _check(self, geometry: Geometry, thickness_sd_mm: float) -> None:
        own = self.geometry
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

    def describe(self, table: Table) -> list[str]:
        """Return what is in it."""
        model, abscissa = self.model, self.abscissa
        lines = [
            f"model {model.model.name!r} ({model.hash[:19]}…), kappa {model.model.kappa}: "
            f"{self.geometry.aperture_mm:g} mm opening, {self.geometry.thickness_mm:g} mm skin"
        ]
        if self.has_history:
            lines.append(f"  along {self.program} only, cycle {self.measurement.cycle}")
        for name, axis in self.axis.items():
            lines.append(
                f"  {name:<28}{axis.low:g} to {axis.high:g}, {axis.nodes} nodes, {axis.spacing}"
            )
        for effect, values in model.values.items():
            for parameter, value in values.items():
                if f"{effect}.{parameter}" not in self.axis:
                    lines.append(f"  {effect}.{parameter} is {value:g}")
        lines.append(
            f"  {'pressure_mbar':<28}0 to {self.high_mbar:g}, {len(abscissa.nodes)} samples"
        )
        short = int((table.holds_to < abscissa.nodes[-1]).sum())
        lines.append(f"{self.entries} curves, {short} of them hold to less than the end")
        lines.append(self.between(table))
        said = model.provenance
        if said.verdict:
            origin = f", from {', '.join(said.data)}" if said.data else ""
            lines.append(f"adopted {said.date}, verdict {said.verdict}{origin}")
        built = ", ".join(f"{name} {v}" for name, v in sorted(table.facts["versions"].items()))
        return [*lines, f"built with {built}"]

    def between(self, table: Table) -> str:
        """Return how far it is off between its nodes, in words."""
        errors = table.extra[_ERRORS][:, : len(self.abscissa.nodes)]
        rms_um = 1e3 * np.sqrt(np.mean(errors**2, axis=1))
        return (
            f"between the nodes off by {np.median(rms_um):.2g} µm rms, at worst "
            f"{rms_um.max():.2g} µm ({len(rms_um)} points compared with finite elements)"
        )

    # ---- files ----

    def head(self, table: Table) -> str:
        """Return what the content hash begins with."""
        return f"{self.to_json()} {table.solver_version}"

    def attributes(self, table: Table) -> dict[str, Any]:
        """Return what a file says besides the arrays."""
        return {
            "spec": self.to_json(),
            "versions": msgspec.json.encode(table.facts["versions"], order="sorted").decode(),
        }

    def datasets(self, table: Table) -> list[Dataset]:
        """Return the arrays of a file."""
        abscissa = self.abscissa
        along = "pressure_mbar" if abscissa.unit == "mbar" else "time_s"
        axes = ", ".join([*self.axis, along])
        blocks = np.split(table.values, abscissa.width // len(abscissa.nodes), axis=-1)
        return [
            *(Dataset(f"axes/{n}", a.values(), self._unit(n)) for n, a in self.axis.items()),
            Dataset(f"axes/{along}", abscissa.nodes, abscissa.unit),
            *(
                Dataset(name, block, unit, axes, compression=4)
                for (name, unit), block in zip(_CURVES, blocks, strict=False)
            ),
            Dataset(_ERRORS, table.extra[_ERRORS], "mm; slopes mm/mbar"),
            Dataset(f"holds_to_{abscissa.unit}", table.holds_to, abscissa.unit),
            *(
                Dataset(f"{name}_{abscissa.unit}", table.extra[name], abscissa.unit)
                for name in [_GOES_ON]
                if name in table.extra
            ),
        ]

    def parameter(self, name: str) -> Parameter:
        """Return what the law or an effect declares of an axis."""
        effect, _, parameter = name.rpartition(".")
        if not effect:
            return self.model.law.parameter(name)
        return {p.name: p for p in get_effect(effect).parameters}[parameter]

    def _unit(self, name: str) -> str:
        return self.parameter(name).unit or "1"

    @classmethod
    def read(cls, file: Any) -> Table:
        """Return the table in an HDF5 file.

        Raises:
            ValueError: its spec is damaged, or its arrays are not of the spec's shape.
        """
        versions = msgspec.json.decode(str(file.attrs["versions"]), type=dict[str, str])
        stated = msgspec.json.decode(str(file.attrs["spec"]), type=cls).model
        warn_of_table(file.filename, stated.model.law, stated.effects, versions)
        spec = spec_from_json(str(file.attrs["spec"]))
        abscissa = spec.abscissa
        curves = [file[name][:] for name, _ in _CURVES if name in file]
        if f"holds_to_{abscissa.unit}" not in file:
            raise InputError(f"its curves are not along {abscissa.unit}: {_OF_TIME}")
        holds_to = file[f"holds_to_{abscissa.unit}"][:]
        errors = file[_ERRORS][:]
        shapes = [(*spec.shape, len(abscissa.nodes))] * (abscissa.width // len(abscissa.nodes))
        if [c.shape for c in curves] != shapes or (holds_to.shape, errors.shape[1:]) != (
            spec.shape,
            (abscissa.width,),
        ):
            raise InputError("its arrays are not of its spec's shape; it is damaged")
        extra = {_ERRORS: errors}
        beyond = f"{_GOES_ON}_{abscissa.unit}"
        if beyond in file:  # tables built before ended where the skin creases
            extra[_GOES_ON] = file[beyond][:]
        return Table(
            spec,
            np.concatenate(curves, axis=-1),
            holds_to,
            spec.mesh_name,
            str(file.attrs["solver_version"]),
            extra,
            {"versions": versions},
        )

    def to_json(self) -> str:
        """Return the whole spec as text; `spec_from_json` reads it."""
        return msgspec.json.encode(self, order="deterministic").decode()


def spec_from_json(text: str) -> CustomSpec:
    """Return the spec that `to_json` gave.

    Raises:
        ValueError: it is none.
    """
    spec = msgspec.json.decode(text, type=CustomSpec)
    # Keys of objects come sorted; the order of the axes is a rule.
    return checked_spec(msgspec.structs.replace(spec, axis=in_order(spec.model, spec.axis)))


_AS_SPACED = {"log": "log-uniform", "linear": "uniform", "chebyshev": "uniform"}


@lru_cache(maxsize=16)
def _abscissa(program: Program | None, high_mbar: float, pressures: Pressures) -> Abscissa:
    if program is None:
        return PressureAbscissa(high_mbar, pressures.nodes, pressures.spacing != "linear")
    return ProgramAbscissa(program, high_mbar, pressures.nodes)


def in_order(model: Model, axes: Mapping[str, AxisRange]) -> dict[str, AxisRange]:
    """Return the axes in the order of the arrays: the law's, then effects' parameters by name."""
    own = [name for name in model.law.names if name in axes]
    return {name: axes[name] for name in (*own, *sorted(set(axes) - set(own)))}


def program_of(text: str) -> Program:
    """Return the program of `[measurement]`.

    Raises:
        InputError: it is none; names the field.
    """
    try:
        return parse_program(text)
    except InputError as error:
        raise InputError(f"measurement.program: {error}") from None


def checked_spec(spec: CustomSpec) -> CustomSpec:
    """Return the spec.

    Raises:
        InputError: it says what cannot be; names the field, and what was expected.
    """
    for name, axis in spec.axis.items():
        try:
            bounds = spec.model.bounds(name)
        except InputError as error:
            of_model = [f"{e}.{p}" for e, ranges in spec.model.effects.items() for p in ranges]
            if name in of_model:  # of an effect that is not there any more
                raise InputError(f"axis.{name}: {error}") from None
            known = ", ".join([*spec.model.law.names, *of_model])
            raise InputError(f"axis.{name} is not known; expected one of: {known}") from None
        axis.check(f"axis.{name}", *bounds)
    if spec.entries > NODES.most_entries:
        raise InputError(f"axis: {spec.entries} curves; expected at most {NODES.most_entries}")
    high = spec.high_mbar
    if not 0 < high <= MOST_PRESSURE_MBAR:
        raise InputError(
            f"pressures.high_mbar is {high:g}: expected more than 0, to {MOST_PRESSURE_MBAR:g}"
        )
    if not 4 <= spec.pressures.nodes <= 2000:
        raise InputError(f"pressures.nodes is {spec.pressures.nodes}: expected 4 to 2000")
    if spec.pressures.spacing == "log":
        raise InputError("pressures.spacing is log: expected linear or chebyshev, they begin at 0")
    if spec.mesh.name not in MESHES:
        raise InputError(
            f"mesh.name {spec.mesh.name!r} is not known; expected one of: {', '.join(MESHES)}"
        )
    at = spec.measurement
    for key, check, value in (
        ("aperture_mm", check_aperture, at.aperture_mm),
        ("thickness_mm", check_thickness, at.thickness_mm),
    ):
        try:
            check(value)
        except InputError as error:
            raise InputError(f"measurement.{key}: {error}") from None
    if spec.has_history and at.program is None:
        raise InputError(f"measurement.program is missing: {_OF_TIME}")
    if not 1 <= at.cycle <= 100:
        raise InputError(f"measurement.cycle is {at.cycle}: expected 1 to 100")
    if at.program is not None:
        top = program_of(at.program).max_pressure_mbar
        if abs(top - high) > 1e-9:
            raise InputError(
                f"pressures.high_mbar is {high:g}, and measurement.program goes to {top:g}"
            )
    _check_corners(spec)
    return spec


def _check_corners(spec: CustomSpec) -> None:
    """Refuse axes with a corner where there is no such skin: layers thicker than it, and so on."""
    ends = [(axis.low, axis.high) for axis in spec.axis.values()]
    for corner in product(*ends):
        try:
            problem_of(*spec.skin(corner), spec.geometry, spec.measurement.cycle)
        except InputError as error:
            at = ", ".join(f"{n} {v:g}" for n, v in zip(spec.axis, corner, strict=True))
            raise InputError(f"axis: at {at}: {error}") from None


def _first_lost(held: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return how many nodes (m,) come before the first that is not held, of (m, n)."""
    return np.asarray(np.where(held.all(axis=1), held.shape[1], np.argmin(held, axis=1)))
