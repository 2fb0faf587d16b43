"""SPEC.toml: which database to build; docs/files.md describes it.

    [model]
    file = "adopted.toml"          # or name, law, kappa and the tables of a MODEL.toml, here

    [axis.X1_MPa]
    low = 0.01
    high = 0.1
    nodes = 8
    spacing = "log"

    [axis."natural_tension.stretch"]
    low = 1.0
    high = 1.1
    nodes = 5
    spacing = "chebyshev"

    [pressures]
    high_mbar = 100.0
    nodes = 51

    [mesh]
    name = "record-2"

    [measurement]
    aperture_mm = 6.0
    thickness_mm = 1.0

Decoded strictly. A MODEL.toml is a SPEC.toml that leaves all the rest to the defaults.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
from msgspec import field

from skinlab.curve import check_aperture, check_thickness
from skinlab.database.axes import AxisRange, Spacing
from skinlab.effects import get_effect
from skinlab.effects.model import Skin, problem_of
from skinlab.errors import InputError
from skinlab.fem.suction import (
    LINEAR_DILATATION_MESH,
    MESH_OF_RECORD,
    SCREENING_MESH,
    VERIFICATION_MESH,
    Discretisation,
    Geometry,
)
from skinlab.model_file import (
    BASE_BOUNDS,
    EffectRange,
    Model,
    Normal,
    check_entry,
    model_of,
    plain,
    read_model,
)
from skinlab.program import MOST_PRESSURE_MBAR, Program, parse_program

MESHES = {
    mesh.name: mesh
    for mesh in (MESH_OF_RECORD, LINEAR_DILATATION_MESH, SCREENING_MESH, VERIFICATION_MESH)
}
MOST_ENTRIES = 1_000_000

# Where a file says no more: the paper's range of X1 and ν, and X2 about its own.
_BASE_AXES = {
    "X1_MPa": AxisRange(0.01, 0.1, 8, "log"),
    "X2_MPa": AxisRange(0.1, 10.0, 10, "log"),
    "nu": AxisRange(0.2, 0.48, 6, "linear"),
}
_EFFECT_NODES = 5
_REACH = 4.0  # standard deviations of a normal prior
_HISTORY_PROGRAM = "ramp:100@20,ramp:0@20"


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
    return _checked(msgspec.structs.replace(spec, axis=_in_order(spec.axis, spec.model)))


def read_spec(path: str | Path) -> ModelSpec:
    """Return the spec of this file.

    Raises:
        InputError: it cannot be read, or something in it is not known, missing or out of range; the
            message names the file and the field.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    try:
        said = msgspec.toml.decode(raw)
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {plain(str(error))}") from None
    named = _named_model(said, path)
    try:
        return _spec_of(said, named)
    except (ValueError, UnicodeDecodeError) as error:  # InputError is one
        raise InputError(f"{path}: {plain(str(error))}") from None


def _named_model(said: dict[str, Any], path: Path) -> Model | None:
    """Return the model of the file that `[model] file` names; None where it names none."""
    header = said.get("model")
    if not isinstance(header, dict) or "file" not in header:
        return None
    file = header["file"]
    if not isinstance(file, str):
        raise InputError(f"{path}: model.file: expected the name of a MODEL.toml")
    others = [f"model.{key}" for key in header if key != "file"]
    others += [key for key in ("parameters", "effects", "provenance") if key in said]
    if others:
        raise InputError(
            f"{path}: {others[0]} is not known beside model.file; expected it in {file}"
        )
    return read_model(path.parent / file)


def _spec_of(said: dict[str, Any], named: Model | None) -> ModelSpec:
    own = {"axis", "pressures", "mesh", "measurement"}
    known = own | {"model", "parameters", "effects", "provenance"}
    for key in said:
        if key not in known:
            raise InputError(f"{key} is not known; expected of: {', '.join(sorted(known))}")
    model = named or model_of({k: v for k, v in said.items() if k not in own})
    tables = said.get("axis", {})
    if not isinstance(tables, dict):
        raise InputError("axis: expected tables [axis.NAME]")
    given = {name: check_entry(f"axis.{name}", table, AxisRange) for name, table in _flat(tables)}
    measurement = check_entry("measurement", said.get("measurement", {}), Measurement)
    pressures = check_entry("pressures", said.get("pressures", {}), Pressures)
    history = any(get_effect(name).needs_history for name in model.effects)
    if history and measurement.program is None:
        measurement = msgspec.structs.replace(measurement, program=_HISTORY_PROGRAM)
    if pressures.high_mbar is None:
        top = 100.0
        if measurement.program is not None:
            top = _program(measurement.program).max_pressure_mbar
        pressures = msgspec.structs.replace(pressures, high_mbar=top)
    return _checked(
        ModelSpec(
            model,
            _in_order(given, model),
            pressures,
            check_entry("mesh", said.get("mesh", {}), MeshChoice),
            measurement,
        )
    )


def _flat(tables: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return the axes' tables by name: [axis.effect.parameter] is [axis."effect.parameter"]."""
    found = []
    for name, table in tables.items():
        inner = isinstance(table, dict) and table and name not in BASE_BOUNDS and "." not in name
        if inner and all(isinstance(t, dict) for t in table.values()):
            found += [(f"{name}.{parameter}", t) for parameter, t in table.items()]
        else:
            found.append((name, table))
    return found


def _in_order(given: dict[str, AxisRange], model: Model) -> dict[str, AxisRange]:
    """Return X1, X2, ν, then the effects' parameters by name; defaults filled in."""
    axes = {
        name: given[name] if name in given else _within(default, *model.bounds(name))
        for name, default in _BASE_AXES.items()
    }
    others = {name: axis for name, axis in given.items() if name not in axes}
    if not given:
        others = {
            f"{name}.{parameter}": _effect_axis(model, name, parameter, at)
            for name, ranges in model.effects.items()
            for parameter, at in ranges.items()
        }
    return axes | {name: others[name] for name in sorted(others)}


def _within(axis: AxisRange, low: float, high: float) -> AxisRange:
    """Return a default axis inside a model's bounds; along these where they lie apart from it."""
    inside = max(axis.low, low), min(axis.high, high)
    if not inside[0] < inside[1]:
        inside = low, high
    spacing = axis.spacing if inside[0] > 0 else "linear"
    return AxisRange(*inside, axis.nodes, spacing)


def _effect_axis(model: Model, name: str, parameter: str, at: EffectRange) -> AxisRange:
    low, high = model.bounds(f"{name}.{parameter}")
    if isinstance(at.prior, Normal):
        reach = _REACH * at.prior.sd
        about = max(low, at.prior.mean - reach), min(high, at.prior.mean + reach)
        if about[0] < about[1]:
            low, high = about
    declared = {p.name: p for p in get_effect(name).parameters}[parameter]
    spacing: Spacing = "log" if declared.spacing == "log" and low > 0 else "chebyshev"
    return AxisRange(low, high, _EFFECT_NODES, spacing)


def _program(text: str) -> Program:
    try:
        return parse_program(text)
    except InputError as error:
        raise InputError(f"measurement.program: {error}") from None


def _checked(spec: ModelSpec) -> ModelSpec:
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
        top = _program(at.program).max_pressure_mbar
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
