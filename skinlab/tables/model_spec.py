"""What a database of one's own is computed of: model, axes, pressures, mesh and measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product

import msgspec
from msgspec import field

from skinlab.curves.curve import check_aperture, check_thickness
from skinlab.curves.program import MOST_PRESSURE_MBAR, Program, parse_program
from skinlab.errors import InputError
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.model import Skin, problem_of
from skinlab.mechanics.fem.suction import (
    LINEAR_DILATATION_MESH,
    MESH_OF_RECORD,
    SCREENING_MESH,
    VERIFICATION_MESH,
    Discretisation,
    Geometry,
)
from skinlab.mechanics.model_file import BASE_BOUNDS, Model
from skinlab.tables.axes import AxisRange, Spacing

MESHES = {
    mesh.name: mesh
    for mesh in (MESH_OF_RECORD, LINEAR_DILATATION_MESH, SCREENING_MESH, VERIFICATION_MESH)
}
MOST_ENTRIES = 1_000_000


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


class ModelSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is computed: every field filled in. `axis` is in the order of the table's axes."""

    model: Model
    axis: dict[str, AxisRange]
    pressures: Pressures
    mesh: MeshChoice = field(default_factory=MeshChoice)
    measurement: Measurement = field(default_factory=Measurement)

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
        return any(get_effect(name).needs_history for name in self.model.effects)

    def skin(self, point: Sequence[float]) -> tuple[Skin, dict[str, dict[str, float]]]:
        """Return the skin and the effects' values at a point of the axes."""
        at = dict(zip(self.axis, map(float, point), strict=True))
        effects = {name: dict(values) for name, values in self.model.values.items()}
        for name, value in at.items():
            effect, _, parameter = name.rpartition(".")
            if effect:
                effects[effect][parameter] = value
        head = self.model.model
        return Skin(at["X1_MPa"], at["X2_MPa"], at["nu"], head.kappa, head.law), effects

    def to_json(self) -> str:
        """Return the whole spec as text; `spec_from_json` reads it."""
        return msgspec.json.encode(self, order="deterministic").decode()


def spec_from_json(text: str) -> ModelSpec:
    """Return the spec that `to_json` gave.

    Raises:
        ValueError: it is none.
    """
    spec = msgspec.json.decode(text, type=ModelSpec)
    # Keys of objects come sorted; the order of the axes is a rule.
    return checked_spec(msgspec.structs.replace(spec, axis=in_order(spec.axis)))


def in_order(axes: Mapping[str, AxisRange]) -> dict[str, AxisRange]:
    """Return the axes in the order of the arrays: X1, X2, ν, then effects' parameters by name."""
    others = sorted(set(axes) - set(BASE_BOUNDS))
    return {name: axes[name] for name in (*BASE_BOUNDS, *others)}


def program_of(text: str) -> Program:
    """Return the program of `[measurement]`.

    Raises:
        InputError: it is none; names the field.
    """
    try:
        return parse_program(text)
    except InputError as error:
        raise InputError(f"measurement.program: {error}") from None


def checked_spec(spec: ModelSpec) -> ModelSpec:
    """Return the spec.

    Raises:
        InputError: it says what cannot be; names the field, and what was expected.
    """
    for name, axis in spec.axis.items():
        try:
            bounds = spec.model.bounds(name)
        except InputError:
            of_model = [f"{e}.{p}" for e, ranges in spec.model.effects.items() for p in ranges]
            raise InputError(
                f"axis.{name} is not known; expected of: {', '.join([*BASE_BOUNDS, *of_model])}"
            ) from None
        axis.check(f"axis.{name}", *bounds)
    if spec.entries > MOST_ENTRIES:
        raise InputError(f"axis: {spec.entries} curves; expected at most {MOST_ENTRIES}")
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
            f"mesh.name {spec.mesh.name!r} is not known; expected of: {', '.join(MESHES)}"
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


def _check_corners(spec: ModelSpec) -> None:
    """Refuse axes with a corner where there is no such skin: layers thicker than it, and so on."""
    ends = [(axis.low, axis.high) for axis in spec.axis.values()]
    for corner in product(*ends):
        try:
            problem_of(*spec.skin(corner), spec.geometry, spec.measurement.cycle)
        except InputError as error:
            at = ", ".join(f"{n} {v:g}" for n, v in zip(spec.axis, corner, strict=True))
            raise InputError(f"axis: at {at}: {error}") from None


def unit_of(axis: str) -> str:
    """Return the unit of an axis: MPa, mm, s, …; 1 where it has none."""
    effect, _, parameter = axis.rpartition(".")
    if not effect:
        return "1" if axis == "nu" else "MPa"
    return {p.name: p.unit for p in get_effect(effect).parameters}[parameter] or "1"
