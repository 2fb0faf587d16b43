"""A session: everything of one visit in one HDF5 file; docs/files.md describes it field by field.

The raw bytes are the record; curves and results stand beside them and can be made again from them.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.events import Hello, Sample, TimedEvent
from skinlab.assembler import CurveAssembler
from skinlab.curve import Curve
from skinlab.database.store import open_hdf5
from skinlab.errors import InputError
from skinlab.journal import Kind, Record
from skinlab.sources import recorded_items
from skinlab.stream import CurveCompleted, Message, Planned, setup_from_json, setup_to_json

SCHEMA = "skinlab.session/1"

_SAMPLE_COLUMNS = (
    ("sequence", "1"),
    ("device_time_s", "s"),
    ("pressure_mbar", "mbar"),
    ("deflection_mm", "mm"),
    ("segment", "1"),
    ("host_time_s", "s"),
)


@dataclass(frozen=True, eq=False)
class Session:
    """What is in a session file.

    `meta` are the facts stated when it was recorded (subject, site, settings of the
    identification, ...); `results` the JSON of each curve's identification, None where there is
    none.
    """

    meta: dict[str, Any]
    records: tuple[Record, ...]
    curves: tuple[Curve, ...]
    results: tuple[dict[str, Any] | None, ...]


def session_from_records(meta: dict[str, Any], records: Sequence[Record]) -> Session:
    """Return the session that these records make: its curves are assembled again from the bytes."""
    curves: list[Curve] = []
    numbers: list[int] = []

    def keep(messages: list[Message]) -> None:
        for message in messages:
            if isinstance(message, CurveCompleted):
                numbers.append(message.index)
                curves.append(message.curve)

    assembler = CurveAssembler()
    for item in recorded_items(records):
        if isinstance(item, Planned):
            assembler.plan(item.setup)
            continue
        if isinstance(item.event, Hello):
            meta = {**meta, "instrument": _hello_to_json(item.event)}
        keep(assembler.feed(item.event))
    keep(assembler.end("the record ends here"))
    found: dict[int, dict[str, Any]] = {}
    for record in records:
        if record.kind is Kind.RESULT:
            entry = json.loads(record.data)
            found[int(entry["curve"])] = entry["result"]
    return Session(meta, tuple(records), tuple(curves), tuple(found.get(n) for n in numbers))


def _hello_to_json(hello: Hello) -> dict[str, Any]:
    return {name: getattr(hello, name) for name in Hello.__slots__}


def write_session(path: Path, session: Session) -> None:
    """Write the file; it appears whole or not at all.

    Raises:
        InputError: it cannot be written; the journal keeps everything.
    """
    import h5py

    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.touch(mode=0o600)  # about a person: for its owner only
        with h5py.File(partial, "w", track_order=True) as file:
            _write(file, session)
        os.replace(partial, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def _write(file: Any, session: Session) -> None:
    file.attrs["schema"] = SCHEMA
    file.attrs["meta"] = json.dumps(session.meta)
    raw = file.create_group("raw")
    blob = b"".join(r.data for r in session.records)
    raw.create_dataset("data", data=np.frombuffer(blob, dtype=np.uint8), compression="gzip")
    raw.create_dataset(
        "kind", data=np.array([int(r.kind) for r in session.records], dtype=np.uint8)
    )
    raw["kind"].attrs["values"] = ", ".join(f"{k.value} {k.name.lower()}" for k in Kind)
    ends = np.cumsum([len(r.data) for r in session.records], dtype=np.uint64)
    raw.create_dataset("end", data=ends)
    times = raw.create_dataset("host_time_s", data=[r.host_time_s for r in session.records])
    times.attrs["unit"] = "s"
    samples = file.create_group("samples")
    rows = [
        (e.sequence, e.device_time_s, e.pressure_mbar, e.deflection_mm, e.segment, item.host_time_s)
        for item in recorded_items(session.records)
        if isinstance(item, TimedEvent) and isinstance(e := item.event, Sample)
    ]
    for k, (name, unit) in enumerate(_SAMPLE_COLUMNS):
        kind = np.int64 if name in ("sequence", "segment") else np.float64
        column = samples.create_dataset(name, data=np.array([r[k] for r in rows], dtype=kind))
        column.attrs["unit"] = unit
    curves = file.create_group("curves")
    for number, (curve, result) in enumerate(
        zip(session.curves, session.results, strict=True), start=1
    ):
        group = curves.create_group(f"{number:04d}")
        group.attrs["name"] = curve.name
        group.attrs["setup"] = json.dumps(setup_to_json(curve.setup))
        group.attrs["partial"] = curve.partial
        for name, unit in (("time_s", "s"), ("pressure_mbar", "mbar"), ("deflection_mm", "mm")):
            column = group.create_dataset(name, data=getattr(curve, name))
            column.attrs["unit"] = unit
        if curve.segment is not None:
            group.create_dataset("segment", data=curve.segment)
        if result is not None:
            group.attrs["result"] = json.dumps(result)
    file.attrs["content_hash"] = content_hash(session)


def content_hash(session: Session) -> str:
    """Return `sha256:…` over all that a session says."""
    digest = hashlib.sha256(json.dumps(session.meta, sort_keys=True).encode())
    for record in session.records:
        digest.update(repr((int(record.kind), record.host_time_s)).encode())
        digest.update(record.data)
    for curve, result in zip(session.curves, session.results, strict=True):
        setup = json.dumps(setup_to_json(curve.setup), sort_keys=True)
        digest.update(f"{curve.name} {setup} {curve.partial}".encode())
        for array in (curve.time_s, curve.pressure_mbar, curve.deflection_mm):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(json.dumps(result, sort_keys=True).encode())
    return f"sha256:{digest.hexdigest()}"


def read_session(path: Path) -> Session:
    """Return the session in this file.

    Raises:
        InputError: no such file, not a session, cut off, or changed since it was written.
    """
    with open_hdf5(path) as file:
        if file.attrs.get("schema") != SCHEMA:
            raise InputError(
                f"{path}: schema {file.attrs.get('schema')!r}; expected a session, {SCHEMA!r}"
            )
        raw = file["raw"]
        blob = raw["data"][:].tobytes()
        ends = raw["end"][:].tolist()
        records = tuple(
            Record(Kind(kind), host_time_s, blob[begin:end])
            for kind, host_time_s, begin, end in zip(
                raw["kind"][:].tolist(),
                raw["host_time_s"][:].tolist(),
                [0, *ends][: len(ends)],
                ends,
                strict=True,
            )
        )
        curves, results = [], []
        for group in file["curves"].values():
            curves.append(
                Curve(
                    name=str(group.attrs["name"]),
                    setup=setup_from_json(json.loads(group.attrs["setup"])),
                    time_s=group["time_s"][:],
                    pressure_mbar=group["pressure_mbar"][:],
                    deflection_mm=group["deflection_mm"][:],
                    segment=group["segment"][:] if "segment" in group else None,
                    partial=bool(group.attrs["partial"]),
                )
            )
            text = group.attrs.get("result")
            results.append(None if text is None else json.loads(text))
        session = Session(json.loads(file.attrs["meta"]), records, tuple(curves), tuple(results))
        stated = file.attrs["content_hash"]
    if content_hash(session) != stated:
        raise InputError(f"{path}: its content does not agree with its hash; it was changed")
    return session
