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

With `[table] form = "dimensionless"` it is one table of the model's law for every opening,
thickness and pressure; its axes are h/R and the law's ratios:

    [model]
    name = "rubber"
    law = "mooney_rivlin"

    [table]
    form = "dimensionless"
    scale_mpa = [0.01, 0.2]

    [axis.C01_over_C10]
    low = 0.01
    high = 10.0
    nodes = 12
    spacing = "log"
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import msgspec

from drivers.reading import read_whole
from skinlab.curves.program import MOST_PRESSURE_MBAR
from skinlab.errors import InputError
from skinlab.io.documents import read_toml
from skinlab.io.files import named_in_errors
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.fem.suction import EXTENSION_BELOW_MBAR, MBAR
from skinlab.mechanics.model_file import (
    EffectRange,
    Model,
    Normal,
    check_entry,
    model_of,
    read_model,
)
from skinlab.parameters import Nodes, Parameter
from skinlab.tables.axes import AxisRange, Spacing
from skinlab.tables.custom_spec import (
    CustomSpec,
    Measurement,
    MeshChoice,
    Pressures,
    checked_spec,
    in_order,
    program_of,
)
from skinlab.tables.dimensionless_spec import Axis, DimensionlessSpec
from skinlab.tables.meshes import MESHES
from skinlab.tables.settings import NODES


class TableForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[table]: custom, or dimensionless with the range of the law's scale and nodes of the load."""

    form: Literal["custom", "dimensionless"] = "custom"
    scale_mpa: tuple[float, float] | None = None
    load_nodes: int | None = None


def read_spec(path: str | Path) -> CustomSpec | DimensionlessSpec:
    """Return the spec of this file.

    Raises:
        InputError: it cannot be read, or something in it is not known, missing or out of range; the
            message names the file and the field.
    """
    path = Path(path)
    with named_in_errors(path):
        said = read_toml(read_whole(path))
    named = _named_model(said, path)
    with named_in_errors(path):
        return _spec_of(said, named)


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


def _spec_of(said: dict[str, Any], named: Model | None) -> CustomSpec | DimensionlessSpec:
    own = {"axis", "pressures", "mesh", "measurement", "table"}
    known = own | {"model", "parameters", "effects", "provenance"}
    for key in said:
        if key not in known:
            raise InputError(f"{key} is not known; expected one of: {', '.join(sorted(known))}")
    model = named or model_of({k: v for k, v in said.items() if k not in own})
    tables = said.get("axis", {})
    if not isinstance(tables, dict):
        raise InputError("axis: expected tables [axis.NAME]")
    given = {
        name: check_entry(f"axis.{name}", table, AxisRange) for name, table in _flat(tables, model)
    }
    form = check_entry("table", said.get("table", {}), TableForm)
    if form.form == "dimensionless":
        return _dimensionless(said, model, given, form)
    for key in ("scale_mpa", "load_nodes"):
        if getattr(form, key) is not None:
            raise InputError(f'table.{key} is known where table.form is "dimensionless" only')
    measurement = check_entry("measurement", said.get("measurement", {}), Measurement)
    pressures = check_entry("pressures", said.get("pressures", {}), Pressures)
    if model.needs_history and measurement.program is None:
        measurement = msgspec.structs.replace(measurement, program=NODES.history_program)
    if pressures.high_mbar is None:
        top = 100.0
        if measurement.program is not None:
            top = program_of(measurement.program).max_pressure_mbar
        pressures = msgspec.structs.replace(pressures, high_mbar=top)
    return checked_spec(
        CustomSpec(
            model,
            _filled(given, model),
            pressures,
            check_entry("mesh", said.get("mesh", {}), MeshChoice),
            measurement,
        )
    )


def _dimensionless(
    said: dict[str, Any], model: Model, given: dict[str, AxisRange], form: TableForm
) -> DimensionlessSpec:
    """Return the spec of a dimensionless table of the model's law.

    Raises:
        InputError: the model says more than a law, or a value is out of its range.
    """
    for key in ("effects", "parameters"):
        if getattr(model, key):
            raise InputError(f"{key}: a dimensionless table is of a law alone; expected none")
    if "measurement" in said:
        raise InputError("measurement: a dimensionless table is for every measurement")
    mesh = check_entry("mesh", said.get("mesh", {}), MeshChoice)
    if mesh.name not in MESHES:
        raise InputError(
            f"mesh.name {mesh.name!r} is not known; expected one of: {', '.join(MESHES)}"
        )
    axes = []
    for name, at in given.items():
        at.check(f"axis.{name}", 0.0, math.inf)
        if at.spacing == "chebyshev" or at.nodes < 4:
            raise InputError(f"axis.{name}: expected 4 nodes or more, linear or log")
        axes.append((name, Axis(at.low, at.high, at.nodes, at.spacing)))
    pressures = check_entry("pressures", said.get("pressures", {}), Pressures)
    top = 500.0 if pressures.high_mbar is None else pressures.high_mbar
    if not 0 < top <= MOST_PRESSURE_MBAR:
        raise InputError(
            f"pressures.high_mbar is {top:g}: expected more than 0, to {MOST_PRESSURE_MBAR:g}"
        )
    nodes = 84 if form.load_nodes is None else form.load_nodes
    if not 8 <= nodes <= 1000:
        raise InputError(f"table.load_nodes is {nodes}: expected 8 to 1000")
    spec = DimensionlessSpec(
        model.model.law, form.scale_mpa or (0.0, 0.0), tuple(axes), top,
        load_nodes=nodes, mesh_name=mesh.name,
    )  # fmt: skip
    scale, (low, high) = model.law.parameters[0], spec.scale_mpa
    if not scale.low <= low < high <= scale.high:
        raise InputError(
            f"table.scale_mpa is {low:g} to {high:g}: expected within {scale.low:g} to "
            f"{scale.high:g}"
        )
    # Below zero, where a noisy channel goes, in the softest skin.
    least = -EXTENSION_BELOW_MBAR * MBAR / low
    return replace(spec, least_load=max(spec.least_load, 1.25 * least))


def _flat(tables: dict[str, Any], model: Model) -> list[tuple[str, Any]]:
    """Return the axes' tables by name: [axis.effect.parameter] is [axis."effect.parameter"]."""
    found = []
    for name, table in tables.items():
        inner = isinstance(table, dict) and table and name not in model.law.names
        if inner and all(isinstance(t, dict) for t in table.values()):
            found += [(f"{name}.{parameter}", t) for parameter, t in table.items()]
        else:
            found.append((name, table))
    return found


def _filled(given: dict[str, AxisRange], model: Model) -> dict[str, AxisRange]:
    """Return the axes in their order, defaults filled in."""
    base = {p.name: _within(p, *model.bounds(p.name)) for p in model.law.parameters}
    if given:
        return in_order(model, base | given)
    others = {
        f"{name}.{parameter}": _effect_axis(model, name, parameter, at)
        for name, ranges in model.effects.items()
        for parameter, at in ranges.items()
    }
    return in_order(model, base | others)


def _within(parameter: Parameter, low: float, high: float) -> AxisRange:
    """Return a law's default axis inside a model's bounds; along these where they lie apart."""
    axis = parameter.axis or Nodes(parameter.low, parameter.high, 8, parameter.spacing)
    inside = max(axis.low, low), min(axis.high, high)
    if not inside[0] < inside[1]:
        inside = low, high
    spacing = axis.spacing if inside[0] > 0 else "linear"
    return AxisRange(*inside, axis.count, spacing)


def _effect_axis(model: Model, name: str, parameter: str, at: EffectRange) -> AxisRange:
    low, high = model.bounds(f"{name}.{parameter}")
    if isinstance(at.prior, Normal):
        reach = NODES.reach * at.prior.sd
        about = max(low, at.prior.mean - reach), min(high, at.prior.mean + reach)
        if about[0] < about[1]:
            low, high = about
    declared = {p.name: p for p in get_effect(name).parameters}[parameter]
    spacing: Spacing = "log" if declared.spacing == "log" and low > 0 else "chebyshev"
    return AxisRange(low, high, NODES.effect, spacing)
