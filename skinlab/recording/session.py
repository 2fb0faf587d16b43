"""A session: everything of one visit in one HDF5 file; docs/files.md describes it field by field.

The raw bytes are the record; curves and results stand beside them and can be made again from them.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.events import Hello, Sample, TimedEvent
from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.recording.assembler import CurveAssembler
from skinlab.recording.recorded import numbered_items, recorded_items
from skinlab.recording.records import Kind, Record
from skinlab.recording.seal import SEAL_BYTES, Seal, put_seal, read_seal
from skinlab.recording.stream import (
    CurveCompleted,
    Message,
    Planned,
    setup_from_json,
    setup_to_json,
)
from skinlab.tables.hdf5 import open_hdf5

SCHEMA = "skinlab.session/1"

_SAMPLE_COLUMNS = (
    ("sequence", "1"),
    ("device_time_s", "s"),
    ("pressure_mbar", "mbar"),
    ("deflection_mm", "mm"),
    ("segment", "1"),
    ("host_time_s", "s"),
    ("utc_s", "s"),
    ("record", "1"),
)
_WHOLE = frozenset({"sequence", "segment", "record"})


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


def sample_rows(records: Sequence[Record]) -> list[tuple[float, ...]]:
    """Return one row a sample, in the order of the columns of `samples`."""
    return [
        (
            e.sequence,
            e.device_time_s,
            e.pressure_mbar,
            e.deflection_mm,
            e.segment,
            item.host_time_s,
            records[index].utc_s,
            index,
        )
        for index, item in numbered_items(records)
        if isinstance(item, TimedEvent) and isinstance(e := item.event, Sample)
    ]


def write_session(path: Path, session: Session, *, replace: bool = False) -> None:
    """Write the file; it appears whole or not at all, and is on the disk when this returns.

    `replace` only where the file is an earlier state of the same session.

    Raises:
        InputError: it cannot be written, or exists already; the journal keeps everything.
    """
    image = _image(session)
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.unlink(missing_ok=True)
        # About a person: for its owner only.
        with os.fdopen(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as file:
            file.write(image)
            file.flush()
            os.fsync(file.fileno())
        if replace:
            os.replace(partial, path)
        else:
            _take_name(partial, path)
        _names_to_disk(path.parent)
    except OSError as error:
        if isinstance(error, FileExistsError) and path.exists():  # and not: its folder is a file
            raise InputError(f"{path}: exists already; a session is never overwritten") from None
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def _image(session: Session) -> memoryview:
    """Return the bytes of the file: HDF5 itself is at a loss where a disk is full."""
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True, userblock_size=SEAL_BYTES) as file:
        _write(file, session)
    buffer = image.getbuffer()
    put_seal(buffer)
    return buffer


def _take_name(partial: Path, path: Path) -> None:
    """Give the whole file its name, which must be free."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if path.exists():
            raise FileExistsError from None
        os.replace(partial, path)


def _names_to_disk(folder: Path) -> None:
    """Let a folder's new name survive a power cut, where the system can."""
    if hasattr(os, "O_DIRECTORY"):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


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
    for name in ("host_time_s", "utc_s"):
        values = np.array([getattr(r, name) for r in session.records], dtype=np.float64)
        raw.create_dataset(name, data=values).attrs["unit"] = "s"
    samples = file.create_group("samples")
    rows = sample_rows(session.records)
    for k, (name, unit) in enumerate(_SAMPLE_COLUMNS):
        kind = np.int64 if name in _WHOLE else np.float64
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
    """Return `sha256:…` over all that a session says, apart from what is made from its bytes."""
    digest = hashlib.sha256(json.dumps(session.meta, sort_keys=True).encode())
    for record in session.records:
        what = (int(record.kind), record.host_time_s, record.utc_s, len(record.data))
        digest.update(repr(what).encode())
        digest.update(record.data)
    for curve, result in zip(session.curves, session.results, strict=True):
        setup = json.dumps(setup_to_json(curve.setup), sort_keys=True)
        digest.update(f"{curve.name} {setup} {curve.partial}".encode())
        for array in (curve.time_s, curve.pressure_mbar, curve.deflection_mm, curve.segment):
            digest.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
        digest.update(json.dumps(result, sort_keys=True).encode())
    return f"sha256:{digest.hexdigest()}"


@dataclass(frozen=True, eq=False)
class Stored:
    """A session as it stands in its file, whether or not it agrees with itself."""

    session: Session
    content_hash: str
    samples: dict[str, NDArray[Any]]  # columns, (samples,) each

    @property
    def unchanged(self) -> bool:
        """Whether the content has the hash that it was written with."""
        return content_hash(self.session) == self.content_hash


def read_session(path: Path) -> Session:
    """Return the session in this file.

    Raises:
        InputError: no such file, not a session, cut off, or changed since it was written.
    """
    seal = read_seal(path)
    if seal is Seal.BROKEN:
        raise InputError(
            f"{path}: its bytes do not agree with their hash; it was changed "
            f"(`skinlab session verify {path}` says where)"
        )
    stored = read_stored(path)
    if seal is Seal.NONE or not stored.unchanged:
        raise InputError(
            f"{path}: it was changed, or not written by skinlab: "
            + ("its seal is missing" if stored.unchanged else "its content differs from its hash")
        )
    return stored.session


def read_stored(path: Path) -> Stored:
    """Return what is in this file, changed or not.

    Raises:
        InputError: no such file, not a session, or cut off.
    """
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("schema") != SCHEMA:
                raise InputError(
                    f"{path}: schema {file.attrs.get('schema')!r}; expected a session, {SCHEMA!r}"
                )
            return _read(file)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(f"{path}:") else f"{path}: {text}") from None
    except (ValueError, TypeError, AttributeError, IndexError, OverflowError) as error:
        raise InputError(f"{path}: a field is missing or damaged ({error})") from None


def _read(file: Any) -> Stored:
    raw = file["raw"]
    blob = raw["data"][:].tobytes()
    ends = raw["end"][:].tolist()
    records = tuple(
        Record(Kind(kind), host_time_s, utc_s, blob[begin:end])
        for kind, host_time_s, utc_s, begin, end in zip(
            raw["kind"][:].tolist(),
            raw["host_time_s"][:].tolist(),
            raw["utc_s"][:].tolist(),
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
    meta = json.loads(file.attrs["meta"])
    if not isinstance(meta, dict):
        raise ValueError("meta")
    samples = {name: file["samples"][name][:] for name, _ in _SAMPLE_COLUMNS}
    session = Session(meta, records, tuple(curves), tuple(results))
    return Stored(session, str(file.attrs["content_hash"]), samples)
