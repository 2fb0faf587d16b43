"""A session as a bundle of HL7 FHIR R4: an Observation a curve, and the code system they use.

The curve is SampledData (time, pressure, deflection: three components, because sampling need not be
even); parameters are components with UCUM quantities, their 90 % intervals an extension. The
subject is referred to by pseudonym, never by a Patient resource: a hospital's system knows who it
is, and we do not. docs/exchange.md describes it.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.cutometer import step_numbers
from skinlab.errors import InputError
from skinlab.exchange.codes import (
    CODES,
    INTERVAL,
    SESSION_FILE,
    SYSTEM,
    UCUM,
    unit_of,
    words_of,
)
from skinlab.mechanics.materials.base import KAPPA, NU_CONSISTENT
from skinlab.recording.audit import entries
from skinlab.recording.session import Session, content_hash, measured_utc, stated_model
from skinlab.recording.session_fit import excluded_of
from skinlab.text import json_text

Array = NDArray[np.float64]

FILE = "fhir.json"
_SPACE = uuid.uuid5(uuid.NAMESPACE_URL, SYSTEM)
_UNKNOWN = {
    "coding": [
        {
            "system": "http://terminology.hl7.org/CodeSystem/data-absent-reason",
            "code": "unknown",
            "display": "Unknown",
        }
    ]
}


def to_fhir(session: Session, file: str | None = None) -> dict[str, str]:
    """Return the one file: a Bundle of type collection. The same session gives the same text.

    `file` is the session's own name, without folders; None: it is of no file.
    """
    key = content_hash(session)
    entries_: list[dict[str, Any]] = [_entry(_code_system(session), f"{key} codes")]
    device = _device(session)
    if device is not None:
        entries_.append(_entry(device, f"{key} device"))
    for number, (curve, result) in enumerate(
        zip(session.curves, session.results, strict=True), start=1
    ):
        observation = _observation(session, curve, result, number)
        if device is not None:
            observation["device"] = {"reference": entries_[1]["fullUrl"]}
        if file:  # no identifier: two sessions may have one name
            observation["extension"] = [{"url": SESSION_FILE, "valueString": file}]
        entries_.append(_entry(observation, f"{key} curve {number}"))
    bundle: dict[str, Any] = {
        "resourceType": "Bundle",
        "id": str(uuid.uuid5(_SPACE, key)),
        "type": "collection",
        "entry": entries_,
    }
    created = session.meta.get("created_utc")
    if created:
        bundle["timestamp"] = str(created)
    return {FILE: json_text(bundle) + "\n"}


def _entry(resource: dict[str, Any], name: str) -> dict[str, Any]:
    number = str(uuid.uuid5(_SPACE, name))
    return {"fullUrl": f"urn:uuid:{number}", "resource": {**resource, "id": number}}


def _code_system(session: Session) -> dict[str, Any]:
    own = [n for r in session.results if r for n in (r.get("parameters") or {})]
    names = list(dict.fromkeys([*CODES, *own]))
    return {
        "resourceType": "CodeSystem",
        "url": SYSTEM,
        "name": "SkinlabCodes",
        "status": "active",
        "content": "complete",
        "caseSensitive": True,
        "concept": [{"code": name, "display": words_of(name)} for name in names],
    }


def _device(session: Session) -> dict[str, Any] | None:
    known = session.meta.get("instrument")
    if not isinstance(known, dict):
        return None
    return {
        "resourceType": "Device",
        "identifier": [
            {"system": "urn:x-skinlab:probe", "value": str(known.get("serial_number") or "unknown")}
        ],
        "deviceName": [{"name": str(known.get("model") or "suction probe"), "type": "model-name"}],
        "version": [{"value": str(known.get("firmware") or "unknown")}],
    }


def _observation(
    session: Session, curve: Curve, result: Mapping[str, Any] | None, number: int
) -> dict[str, Any]:
    meta, setup = session.meta, curve.setup
    components = [
        _sampled("time", curve.time_s - curve.time_s[0] if len(curve) else curve.time_s, curve),
        _sampled("pressure", curve.pressure_mbar, curve),
        _sampled("deflection", curve.deflection_mm, curve),
        _component("aperture", setup.aperture_mm),
        _component("thickness", setup.thickness_mm),
    ]
    found = result or {}
    for name, value in (found.get("parameters") or {}).items():
        components.append(_component(name, value["value"], value.get("low"), value.get("high")))
    for name in (NU_CONSISTENT, KAPPA, "rms_um", "noise_um"):
        if found.get(name) is not None:
            components.append(_component(name, found[name]))
    components += [_component(name, value) for name, value in _steps(curve).items()]
    observation: dict[str, Any] = {
        "resourceType": "Observation",
        "status": _status(session, curve),
        "code": _concept("suction-curve"),
        "component": components,
        "method": {"text": f"suction, program {setup.program or 'not stated'}"},
        "note": [{"text": text} for text in _notes(session, curve, found)],
    }
    observation["identifier"] = [
        {"system": "urn:x-skinlab:curve", "value": f"{content_hash(session)}#{number}"}
    ]
    if meta.get("subject"):
        observation["subject"] = {
            "identifier": {"system": "urn:x-skinlab:subject", "value": str(meta["subject"])}
        }
    if meta.get("site"):
        observation["bodySite"] = {"text": str(meta["site"])}
    if measured := measured_utc(meta):
        observation["effectiveDateTime"] = measured
    who = next((e.who for e in entries(session.records)), None)
    if who:
        observation["performer"] = [
            {"identifier": {"system": "urn:x-skinlab:operator", "value": who}}
        ]
    return observation


def _status(session: Session, curve: Curve) -> str:
    if curve.name in excluded_of(session):
        return "entered-in-error"
    return "preliminary" if curve.partial else "final"


def _notes(session: Session, curve: Curve, found: Mapping[str, Any]) -> list[str]:
    how = session.meta.get("identification") or {}
    notes = [f"{curve.name}; cycle {curve.setup.cycle}, repeat {curve.setup.repeat}"]
    if (why := excluded_of(session).get(curve.name)) is not None:
        notes.append(f"left out by who measured it: {why}")
    if found.get("error"):
        notes.append(f"not identified: {found['error']}")
    if found.get("flags"):
        notes.append("flags: " + ", ".join(found["flags"]))
    if how:
        stated = stated_model(session.meta)  # X1 beside an effect is another one
        model = "the law alone" if stated is None else f"the model {stated.name!r}"
        notes.append(
            f"identified by {model} with {how.get('method')}, seed {how.get('seed')}, kappa "
            f"{how.get('kappa')}, database {how.get('database_hash')}, skinlab "
            f"{session.meta.get('skinlab_version')}"
        )
    return notes


def _steps(curve: Curve) -> dict[str, float]:
    try:
        numbers = step_numbers(curve).numbers
    except (InputError, IndexError, ValueError):
        return {}
    return {n: v.value for n, v in numbers.items() if v.value is not None}


def _concept(name: str) -> dict[str, Any]:
    return {"coding": [{"system": SYSTEM, "code": name, "display": words_of(name)}]}


def _quantity(name: str, value: float) -> dict[str, Any]:
    unit = unit_of(name)
    return {"value": float(value), "unit": unit, "system": UCUM, "code": unit}


def _component(
    name: str, value: float | None, low: float | None = None, high: float | None = None
) -> dict[str, Any]:
    component: dict[str, Any] = {"code": _concept(name)}
    if value is None or not math.isfinite(value):
        return component | {"dataAbsentReason": _UNKNOWN}
    component["valueQuantity"] = _quantity(name, value)
    if low is not None and high is not None:
        interval = {"low": _quantity(name, low), "high": _quantity(name, high)}
        component["extension"] = [{"url": INTERVAL, "valueRange": interval}]
    return component


def _sampled(name: str, values: Array, curve: Curve) -> dict[str, Any]:
    component: dict[str, Any] = {"code": _concept(name)}
    if len(values) < 2:
        return component | {"dataAbsentReason": _UNKNOWN}
    return component | {
        "valueSampledData": {
            "origin": _quantity(name, 0.0),
            "period": round(1e3 * float(np.median(np.diff(curve.time_s))), 6),
            "dimensions": 1,
            "data": " ".join(_decimal(v) for v in values.tolist()),
        }
    }


def _decimal(value: float) -> str:
    """Return a number as FHIR's SampledData has it: nine digits, no exponent."""
    return f"{value:z.9f}".rstrip("0").rstrip(".") or "0"
