"""A session: everything of one visit in one HDF5 file; docs/files.md describes it field by field.

The raw bytes are the record; curves and results stand beside them and can be made again from them.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import replace as dc_replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.events import Hello, Sample, TimedEvent
from skinlab.curves.curve import Curve
from skinlab.curves.probe_file import ProbeErrors, decode_probe
from skinlab.curves.stated_skin import StatedSkin
from skinlab.errors import InputError
from skinlab.inference.stored_results import stored_result
from skinlab.io.documents import read_json_object, read_toml
from skinlab.io.files import file_hash, write_file
from skinlab.io.hdf5 import open_hdf5, read_array
from skinlab.recording.assembler import CurveAssembler
from skinlab.recording.clocks import ClockReading, clock_from_json, clock_readings
from skinlab.recording.recorded_items import dialect_of, numbered_items, recorded_items
from skinlab.recording.records import Kind, Record
from skinlab.recording.seal import SEAL_BYTES, Seal, put_seal, read_seal
from skinlab.recording.stream import (
    CurveCompleted,
    Message,
    Planned,
    setup_from_json,
    setup_to_json,
)

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
Result = dict[str, Any] | None
_DAY = len("2026-03-01")


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
    results: tuple[Result, ...]


def session_from_records(
    meta: dict[str, Any],
    records: Sequence[Record],
    damaged: Callable[[str], None] = lambda _: None,
) -> Session:
    """Return the session that these records make: its curves are assembled again from the bytes.

    What cannot be read is left out, and told to `damaged` in a sentence each.
    """
    curves: list[Curve] = []
    numbers: list[int] = []

    def keep(messages: list[Message]) -> None:
        for message in messages:
            if isinstance(message, CurveCompleted):
                numbers.append(message.index)
                curves.append(message.curve)

    assembler = CurveAssembler()
    for item in recorded_items(records, dialect_of(meta), damaged):
        if isinstance(item, Planned):
            assembler.plan(item.setup)
            continue
        if isinstance(item.event, Hello):
            meta = {**meta, "instrument": _hello_to_json(item.event)}
        keep(assembler.feed(item.event))
    keep(assembler.end("the record ends here"))
    found: dict[int, dict[str, Any]] = {}
    for number, record in enumerate(records, start=1):
        if record.kind is Kind.RESULT:
            try:
                entry = read_json_object(record.data)
                stored_result(entry["curve"], entry["result"])
                found[int(entry["curve"])] = entry["result"]
            except (ValueError, TypeError, KeyError) as error:
                damaged(f"record {number}, a result, cannot be read ({error}): left out")
    return Session(meta, tuple(records), tuple(curves), tuple(found.get(n) for n in numbers))


def _hello_to_json(hello: Hello) -> dict[str, Any]:
    return {name: getattr(hello, name) for name in Hello.__slots__}


def sample_rows(session: Session) -> list[tuple[float, ...]]:
    """Return one row a sample, in the order of the columns of `samples`."""
    records = session.records
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
        for index, item in numbered_items(records, dialect_of(session.meta))
        if isinstance(item, TimedEvent) and isinstance(e := item.event, Sample)
    ]


def write_session(path: Path, session: Session, *, replace: bool = False) -> None:
    """Write the file; it appears whole or not at all, and is on the disk when this returns.

    `replace` only where the file is an earlier state of the same session.

    Raises:
        InputError: it cannot be written, or exists already; the journal keeps everything.
    """
    # A file name may be no UTF-8, and HDF5 keeps nothing else.
    named = tuple(
        dc_replace(c, name=c.name.encode("utf-8", "backslashreplace").decode())
        for c in session.curves
    )
    write_file(path, _image(dc_replace(session, curves=named)), replace=replace)


def _image(session: Session) -> memoryview:
    """Return the bytes of the file: HDF5 itself is at a loss where a disk is full."""
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True, userblock_size=SEAL_BYTES) as file:
        _write(file, session)
    # A copy: h5py keeps the stream, which cannot be closed while somebody looks into it
    buffer = memoryview(bytearray(image.getbuffer()))
    put_seal(buffer)
    return buffer


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
    rows = sample_rows(session)
    for k, (name, unit) in enumerate(_SAMPLE_COLUMNS):
        kind = np.int64 if name in _WHOLE else np.float64
        column = samples.create_dataset(name, data=np.array([r[k] for r in rows], dtype=kind))
        column.attrs["unit"] = unit
    curves = file.create_group("curves")
    clocks = clock_readings(session.meta, session.records)
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
        if number <= len(clocks) and (clock := clocks[number - 1]) is not None:
            group.attrs["clock"] = json.dumps(clock.to_json())
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


class _Meta(msgspec.Struct):
    """Types of what every reader of a session counts on."""

    created_utc: str = ""
    measured_utc: str = ""
    skinlab_version: str = ""
    subject: str = ""
    site: str = ""
    url: str = ""
    instrument: dict[str, Any] | None = None
    imported: list[dict[str, Any]] | None = None
    dialect: dict[str, Any] | None = None
    control: str = ""
    identification: dict[str, Any] | None = None
    versions: dict[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class Stored:
    """A session as it stands in its file, whether or not it agrees with itself."""

    session: Session
    content_hash: str
    samples: dict[str, NDArray[Any]]  # columns, (samples,) each
    clocks: tuple[ClockReading | None, ...]  # one a curve; older sessions have none

    @property
    def unchanged(self) -> bool:
        """Whether the content has the hash that it was written with."""
        return content_hash(self.session) == self.content_hash


def measured_utc(meta: Mapping[str, Any]) -> str:
    """Return when a session was measured: UTC, or a day alone, in ISO 8601; "" where nobody said.

    The one place that says it. An imported session was created when its files were read, and that
    may be years later.
    """
    name = "created_utc" if meta.get("imported") is None else "measured_utc"
    return str(meta.get(name) or "")


def earlier(one_utc: str, other_utc: str) -> bool:
    """Return whether one was measured before another; of one day, a day alone does not tell."""
    if _DAY in (len(one_utc), len(other_utc)):
        one_utc, other_utc = one_utc[:_DAY], other_utc[:_DAY]
    return one_utc < other_utc


def example_session() -> Path:
    """Return the recorded example that is shipped."""
    return Path(__file__).parents[1] / "data" / "example.h5"


def read_session(path: Path) -> Session:
    """Return the session in this file.

    Raises:
        InputError: no such file, not a session, cut off, or changed since it was written.
    """
    seal = read_seal(path)
    if seal is Seal.BROKEN:
        raise InputError(
            f"{path}: its bytes do not agree with their hash; it was changed "
            f"(`skinlab session verify {path}` says where; `skinlab recover {path}` makes another "
            "of what can still be read)"
        )
    stored = read_stored(path)
    if seal is Seal.NONE or not stored.unchanged:
        raise InputError(
            f"{path}: it was changed, or not written by skinlab: "
            + ("its seal is missing" if stored.unchanged else "its content differs from its hash")
        )
    source, probe = file_hash(path), _probe(stored.session.meta)
    noise_um, pressure_mbar = stated_noise(stored.session.meta)
    curves = tuple(
        dc_replace(
            c,
            source=source,
            probe=probe,
            noise_um=noise_um,
            pressure_noise_mbar=pressure_mbar,
            skin=stated_skin(str(path), stored.session.meta),
            campaign=str(path),
        )
        for c in stored.session.curves
    )
    return dc_replace(stored.session, curves=curves)


def _probe(meta: Mapping[str, Any]) -> ProbeErrors | None:
    """Return the calibration that a session was measured with."""
    text = (meta.get("identification") or {}).get("probe")
    return None if text is None else decode_probe(text, "the session's field identification.probe")


def stated_skin(file: str, meta: Mapping[str, Any]) -> StatedSkin:
    """Return whose skin was measured, and where, as a session states it; `file` is its name."""
    return StatedSkin(file, *(str(meta.get(name) or "").strip() for name in ("subject", "site")))


class _Noise(msgspec.Struct):
    noise_um: Annotated[float, msgspec.Meta(gt=0, lt=1e6)] | None = None
    pressure_noise_mbar: Annotated[float, msgspec.Meta(ge=0, lt=1e3)] | None = None


def stated_noise(meta: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Return what was stated of the noise when a session was measured: µm and mbar, or None.

    Raises:
        InputError: it is no number, or none that could be stated.
    """
    try:
        stated = msgspec.convert(meta.get("identification") or {}, _Noise)
    except ValueError as error:
        raise InputError(f"the session's field identification is damaged ({error})") from None
    return stated.noise_um, stated.pressure_noise_mbar


class _Header(msgspec.Struct):
    name: str


class _Model(msgspec.Struct):
    model: _Header


@dataclass(frozen=True)
class StatedModel:
    """How the model of a session's results is called, and the database that they are from."""

    name: str
    database: str | None  # the file; None: one that ships


def stated_model(meta: Mapping[str, Any]) -> StatedModel | None:
    """Return of which model a session's results are; None: of the law alone.

    Only what it is called is read: its effects may be of plugins that are not here.

    Raises:
        InputError: what the session says of it is damaged.
    """
    settings = meta.get("identification") or {}
    if settings.get("model") is None:
        return None
    try:
        name = msgspec.convert(read_toml(settings["model"]), _Model).model.name
        return StatedModel(name, settings.get("database_path"))
    except (ValueError, TypeError) as error:
        raise InputError(f"the session's field identification.model is damaged ({error})") from None


def read_stored(path: Path) -> Stored:
    """Return what is in this file, changed or not.

    Raises:
        InputError: no such file, not a session, or cut off.
    """
    with open_hdf5(path) as file:
        if file.attrs.get("schema") != SCHEMA:
            raise InputError(f"schema {file.attrs.get('schema')!r}; expected a session, {SCHEMA!r}")
        return _read(file)


def read_result(number: int, group: Any) -> Result:
    """Return the result of curve `number`, of its group in a file.

    Raises:
        InputError, ValueError, KeyError, TypeError: it is damaged.
    """
    text = group.attrs.get("result")
    if text is None:
        return None
    found = read_json_object(text)
    stored_result(number, found)
    return found


def read_curve(group: Any) -> Curve:
    """Return the curve of a group in a file.

    Raises:
        InputError, OSError, ValueError, KeyError, TypeError: it is damaged.
    """
    return Curve(
        name=_text(group.attrs["name"]),
        setup=setup_from_json(read_json_object(group.attrs["setup"])),
        time_s=read_array(group, "time_s", float),
        pressure_mbar=read_array(group, "pressure_mbar", float),
        deflection_mm=read_array(group, "deflection_mm", float),
        segment=read_array(group, "segment", np.int64) if "segment" in group else None,
        partial=bool(group.attrs["partial"]),
    )


def _text(value: object) -> str:
    text = str(value)
    text.encode()  # what is no UTF-8 comes as surrogates
    return text


def _read(file: Any) -> Stored:
    raw = file["raw"]
    blob = read_array(raw, "data", np.uint8).tobytes()
    ends = read_array(raw, "end", np.uint64).tolist()
    records = tuple(
        Record(Kind(kind), host_time_s, utc_s, blob[begin:end])
        for kind, host_time_s, utc_s, begin, end in zip(
            read_array(raw, "kind", np.uint8).tolist(),
            read_array(raw, "host_time_s", float).tolist(),
            read_array(raw, "utc_s", float).tolist(),
            [0, *ends][: len(ends)],
            ends,
            strict=True,
        )
    )
    curves, results, clocks = [], [], []
    for group in file["curves"].values():
        curves.append(read_curve(group))
        results.append(read_result(len(curves), group))
        clock = group.attrs.get("clock")
        clocks.append(None if clock is None else clock_from_json(read_json_object(clock)))
    samples = {
        name: read_array(file["samples"], name, np.int64 if name in _WHOLE else float)
        for name, _ in _SAMPLE_COLUMNS
    }
    meta = read_json_object(file.attrs["meta"])
    msgspec.convert(meta, _Meta)
    session = Session(meta, records, tuple(curves), tuple(results))
    return Stored(session, str(file.attrs["content_hash"]), samples, tuple(clocks))
