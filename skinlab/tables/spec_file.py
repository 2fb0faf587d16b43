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

from pathlib import Path
from typing import Any

import msgspec

from skinlab.errors import InputError
from skinlab.io.documents import read_toml
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.model_file import (
    BASE_BOUNDS,
    EffectRange,
    Model,
    Normal,
    check_entry,
    model_of,
    plain,
    read_model,
)
from skinlab.tables.axes import AxisRange, Spacing
from skinlab.tables.model_spec import (
    Measurement,
    MeshChoice,
    ModelSpec,
    Pressures,
    checked_spec,
    in_order,
    program_of,
)

# Where a file says no more: the paper's range of X1 and ν, and X2 about its own.
_BASE_AXES = {
    "X1_MPa": AxisRange(0.01, 0.1, 8, "log"),
    "X2_MPa": AxisRange(0.1, 10.0, 10, "log"),
    "nu": AxisRange(0.2, 0.48, 6, "linear"),
}
_EFFECT_NODES = 5
_REACH = 4.0  # standard deviations of a normal prior
_HISTORY_PROGRAM = "ramp:100@20,ramp:0@20"


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
        said = read_toml(raw)
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
            top = program_of(measurement.program).max_pressure_mbar
        pressures = msgspec.structs.replace(pressures, high_mbar=top)
    return checked_spec(
        ModelSpec(
            model,
            _filled(given, model),
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


def _filled(given: dict[str, AxisRange], model: Model) -> dict[str, AxisRange]:
    """Return the axes in their order, defaults filled in."""
    base = {name: _within(axis, *model.bounds(name)) for name, axis in _BASE_AXES.items()}
    if given:
        return in_order(base | given)
    others = {
        f"{name}.{parameter}": _effect_axis(model, name, parameter, at)
        for name, ranges in model.effects.items()
        for parameter, at in ranges.items()
    }
    return in_order(base | others)


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
