"""Skin parameters with all that is needed to compare them: `skinlab.parameters/1`.

Numbers of two laws, two tables or two openings are not comparable by their names alone. Every entry
says law, table, model, program, opening, thickness and error model; `SCHEMA` is the JSON schema
that such a document keeps (also in docs/parameters.schema.json).
"""

from __future__ import annotations

from typing import Any

from skinlab.curves.apertures import APERTURES_MM
from skinlab.exchange.codes import unit_of
from skinlab.inference.identify import Identifier
from skinlab.inference.settings import INTERVALS
from skinlab.recording.session import Session, measured_utc
from skinlab.recording.session_fit import excluded_of
from skinlab.recording.stream import setup_to_json
from skinlab.text import json_text

NAME = "skinlab.parameters/1"
FILE = "parameters.json"

_NUMBER = {"type": "number"}
_OPEN = {"type": ["number", "null"]}
_TEXT = {"type": "string"}
_MAYBE = {"type": ["string", "null"]}
_HASH = {"type": "string", "pattern": "^sha256:[0-9a-f]{64}$"}


def _object(properties: dict[str, Any], **open_: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of an object; what is `open_` may be missing."""
    return {
        "type": "object",
        "properties": properties | open_,
        "required": list(properties),
        "additionalProperties": False,
    }


SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "$id": "urn:x-skinlab:parameters/1",
    "title": "Skin parameters from suction curves, comparable",
    **_object(
        {
            "schema": {"const": NAME},
            "curves": {
                "type": "array",
                "items": _object(
                    {
                        "subject": _MAYBE,
                        "site": _MAYBE,
                        "measured_utc": _MAYBE,
                        "curve": _TEXT,
                        "setup": _object(
                            {
                                "aperture_mm": {"enum": list(APERTURES_MM)},
                                "thickness_mm": {"type": "number", "minimum": 0.1, "maximum": 10},
                                "thickness_sd_mm": _OPEN,
                                "program": _MAYBE,
                                "cycle": {"type": "integer", "minimum": 1},
                                "repeat": {"type": "integer", "minimum": 1},
                            },
                            placement=_TEXT,
                        ),
                        "law": _TEXT,
                        "kappa": {"enum": ["paper", "consistent"]},
                        "model": _object(
                            {
                                "name": _TEXT,
                                "hash": _HASH,
                                "effects": {"type": "array", "items": _TEXT},
                            }
                        ),
                        "table": _object({"hash": _HASH, "mesh": _TEXT}),
                        "method": _TEXT,
                        "seed": {"type": "integer"},
                        "phases": {"type": "array", "items": _TEXT},
                        "error_model": _object(
                            {
                                "name": _TEXT,
                                "parameters": {
                                    "type": "object",
                                    "additionalProperties": _OPEN,
                                },
                            }
                        ),
                        "interval": {"const": INTERVALS.level},
                        "parameters": {
                            "type": "object",
                            "additionalProperties": _object(
                                {"value": _NUMBER, "low": _OPEN, "high": _OPEN, "unit": _TEXT}
                            ),
                        },
                        "correlation": {
                            "type": ["array", "null"],
                            "items": {"type": "array", "items": _NUMBER},
                        },
                        "rms_um": _OPEN,
                        "flags": {"type": "array", "items": _TEXT},
                        "skinlab_version": _TEXT,
                    },
                    left_out=_TEXT,
                    session_file=_TEXT,
                ),
            },
        }
    ),
}


def to_parameters(
    session: Session, identifier: Identifier, file: str | None = None
) -> dict[str, str]:
    """Return the one file; curves without parameters are not in it.

    `identifier` is the one that the session was identified with, `file` the session's own name,
    without folders; None: it is of no file.
    """
    provenance, meta = identifier.provenance(), session.meta
    curves, out = [], excluded_of(session)
    for curve, result in zip(session.curves, session.results, strict=True):
        values = (result or {}).get("parameters")
        if result is None or not values:
            continue
        stated = result.get("error_model") or {
            "name": "white",
            "parameters": {"white_um": result.get("noise_um")},
        }
        curves.append(
            {
                "subject": meta.get("subject") or None,
                "site": meta.get("site") or None,
                "measured_utc": measured_utc(meta) or None,
                "curve": curve.name,
                "setup": setup_to_json(curve.setup),
                "law": identifier.database.law,
                "kappa": provenance.kappa,
                "model": {
                    "name": provenance.model_name,
                    "hash": provenance.model_hash,
                    "effects": list(provenance.effects),
                },
                "table": {
                    "hash": provenance.database_hash,
                    "mesh": identifier.database.mesh_name,
                },
                "method": provenance.method,
                "seed": provenance.seed,
                "phases": list(result.get("phases") or ()),
                "error_model": {"name": stated["name"], "parameters": stated["parameters"]},
                "interval": INTERVALS.level,
                "parameters": {
                    name: {**{k: v[k] for k in ("value", "low", "high")}, "unit": unit_of(name)}
                    for name, v in values.items()
                },
                "correlation": result.get("correlation"),
                "rms_um": result.get("rms_um"),
                "flags": list(result.get("flags") or ()),
                "skinlab_version": str(meta.get("skinlab_version") or ""),
                **({"left_out": out[curve.name]} if curve.name in out else {}),
                **({"session_file": file} if file else {}),
            }
        )
    whole = {"schema": NAME, "curves": curves}
    return {FILE: json_text(whole) + "\n"}
