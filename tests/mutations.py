"""Ways to spoil a file, a good one of each kind, and the commands and readers that meet it.

Two hands change text, one that knows what it means and one that does not, and `zzuf` as a third
where the computer has it: a program that one hand wrote is often good at its own mistakes only.
"""

from __future__ import annotations

import copy
import csv
import datetime as dt
import io
import json
import random
import re
import shutil
import sqlite3
import subprocess
import tomllib
from collections.abc import Callable
from contextlib import closing
from importlib.resources import files
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import tomli_w
from crashes import journal_of_example

from drivers.capture import decode_capture, read_capture
from drivers.dialects import get_dialect
from drivers.errors import DialectFileError
from drivers.line_dialect import read_line_dialect
from sim_device.build import build_device
from skinlab.acquisition.protocol import read_protocol
from skinlab.acquisition.settings import recall
from skinlab.cli.main import run
from skinlab.curves.phantoms import read_phantoms
from skinlab.curves.probe_file import read_probe
from skinlab.errors import InputError
from skinlab.exchange.importing.remembered import Remembered
from skinlab.inference.population import read_prior
from skinlab.mechanics.model_file import read_model
from skinlab.recording.records import Kind
from skinlab.recording.seal import SEAL_BYTES, put_seal
from skinlab.recording.session import read_session
from skinlab.recording.visit_index import visits
from skinlab.studies.reference import read_reference
from skinlab.studies.table import read_columns
from skinlab.tables.build_checkpoint import KeptRows
from skinlab.tables.spec_file import read_spec
from skinlab.tui.key_owners import owners
from skinlab.tui.settings_file import read_settings

ROOT = Path(__file__).parents[1]
INPUTS = Path(__file__).parent / "data" / "inputs"
OLD = Path(__file__).parent / "data" / "v0.1"
EXAMPLE = Path(str(files("skinlab") / "data" / "example.h5"))
GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]
SKIN = ["--x1-mpa", "0.02", "--x2-mpa", "1", "--nu", "0.3"]
NOBODY = "socket://127.0.0.1:9"  # a port at which nobody answers
ROWS = [(t / 10, 2 * t, round(0.02 * t**0.8, 6)) for t in range(51)]
CURVE = "time_s,pressure_mbar,deflection_mm\n" + "".join(f"{t},{p},{w}\n" for t, p, w in ROWS)
ZZUF = shutil.which("zzuf")

Random = random.Random
Mutation = Callable[[bytes, Random], bytes]


# ---- bytes ---------------------------------------------------------------------------------------


def in_bytes(raw: bytes, rng: Random) -> bytes:
    """Flip, drop, double, cut off or overwrite."""
    out = bytearray(raw)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out)) if out else 0
        end = min(len(out), at + rng.choice([1, 4, 64, 4096]))
        match rng.randrange(5):
            case 0 if out:
                out[at] ^= 1 << rng.randrange(8)
            case 1:
                del out[at:end]
            case 2:
                out[at:at] = out[at:end]
            case 3 if rng.random() < 0.3:
                del out[at:]
            case _:
                out[at:end] = rng.randbytes(end - at)
    return bytes(out)


def zzuf(raw: bytes, rng: Random) -> bytes:
    """Let another program flip bits."""
    command = [
        str(ZZUF),
        "-s",
        str(rng.randrange(10**6)),
        "-r",
        str(rng.choice([1e-4, 1e-3, 0.02])),
    ]
    return subprocess.run(command, input=raw, capture_output=True, check=True).stdout


# ---- text, by its meaning ------------------------------------------------------------------------

TOKENS = [
    "text", '"text"', "-1", "0", "1e308", "1e999", "nan", "-inf", "true", "[]", "{}", "9" * 400,
    "[" * 2000, "{a=" * 2000, "\\u0000", '"\\u0000"', "\x00", "\x1b]0;x\x07", "\n", '"', "=", ",",
    "../../etc/passwd", "1979-05-27", "\ufeff", "x" * 200_000,
]  # fmt: skip
WRONG = [
    0, -1, 2**63 - 1, 1e308, -1e308, float("nan"), float("inf"), 5e-324, True, "", "x", "9" * 5000,
    "\x1b[2J", "../..", [], [[]], [1, "a"], [[1.0], [1.0, 2.0]], {}, {"a": {"b": [{}]}},
    dt.datetime(1, 1, 1), dt.date(9999, 12, 31), dt.time(23, 59),
]  # fmt: skip


def in_text(raw: bytes, rng: Random) -> bytes:
    """Put a token in the place of another, or do what happens to bytes."""
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        return in_bytes(raw, rng)
    if rng.random() < 0.4:
        return in_bytes(raw, rng)
    words = text.replace("=", " = ").split(" ")
    for _ in range(rng.randint(1, 3)):
        words[rng.randrange(len(words))] = rng.choice(TOKENS)
    return " ".join(words).encode("utf-8", "surrogatepass")


def in_structure(raw: bytes, rng: Random) -> bytes:
    """Change what a text means: values of other types, keys gone, doubled lists, one in another."""
    try:
        tree = tomllib.loads(raw.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return splice(raw, rng)
    for _ in range(rng.randint(1, 3)):
        holder: Any = tree
        while True:
            keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
            if not keys:
                break
            key = rng.choice(keys)
            if isinstance(holder[key], dict | list) and rng.random() < 0.7:
                holder = holder[key]
                continue
            match rng.randrange(4):
                case 0:
                    del holder[key]
                case 1:
                    holder[key] = [copy.deepcopy(holder[key])] * rng.choice([1, 2, 300])
                case 2 if isinstance(holder, dict):
                    holder[rng.choice(["", "x", "schema", "a.b", key.upper()])] = copy.deepcopy(
                        holder[key]
                    )
                case _:
                    holder[key] = copy.deepcopy(rng.choice(WRONG))
            break
    return tomli_w.dumps(tree).encode("utf-8", "surrogatepass")


def splice(raw: bytes, rng: Random) -> bytes:
    """Put a piece of the text into another place of it, or cut it off, or repeat its lines."""
    lines = raw.split(b"\n")
    match rng.randrange(4):
        case 0:
            return raw[: rng.randrange(len(raw))]
        case 1:
            a, b, c = sorted(rng.randrange(len(raw)) for _ in range(3))
            return raw[:a] + raw[b:c] + raw[a:]
        case 2:
            rng.shuffle(lines)
            return b"\n".join(lines)
        case _:
            return b"\n".join(lines + lines * rng.choice([1, 50]))


# ---- text, by a hand that knows no grammar -------------------------------------------------------

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
NUMBERS = [
    b"0", b"-0.0", b"00012", b"1_000", b"0x7f", b"1e", b".", b"--1", b"+1", b"1,5", b"1.2.3",
    b"1e-400", b"127", b"128", b"255", b"65536", b"2147483648", b"4294967296",
    b"9223372036854775807", b"9223372036854775808", b"-9223372036854775809",
    b"18446744073709551616", b"1e38", b"1e400", b"NaN", b"-Infinity", b"0." + b"3" * 4000,
    b"7" * 4301, b"True", b"None", b"1/3", b"", "٣".encode(), "１２".encode(), "½".encode(),
    "−1".encode(), "1\u00a0000".encode(), b"1e9", b"100000",
]  # fmt: skip
JUNK = [
    b"\x00", b"\x00" * 5000, b"\xff\xfe", b"\xef\xbb\xbf", b"\xed\xa0\x80", b"\xc0\x80",
    b"\xf4\x90\x80\x80", b"\r", b"\x85", "\u2028".encode(), "\u202e".encode(), "\u200b".encode(),
    "e\u0301".encode() * 300, "\U0001f9ea".encode(), b"\x1b[2J\x1b]0;x\x07", b"\x9b2J", b"%n%s%x",
    b"$(id)", b"{0.__class__}", b"';--", b"=1+1", b"@A1", b"\t" * 3000, b"[" * 3000, b"{" * 3000,
    b"'''", b'"""', b"\\" * 301, b"(" * 999, b"a." * 3000, b"#", b";", b"..", b"A" * 100_000,
    b"\n" * 20_000,
]  # fmt: skip
RECODED: list[Callable[[bytes], bytes]] = [
    lambda raw: raw.replace(b"\n", b"\r\n"),
    lambda raw: raw.replace(b"\n", b"\r"),
    lambda raw: raw.replace(b"\n", b""),
    lambda raw: raw.decode("utf-8", "replace").encode("utf-16"),
    lambda raw: raw.decode("utf-8", "replace").encode("utf-32-be"),
    lambda raw: raw.decode("utf-8", "replace").encode("cp1252", "replace") + b"\xe4",
    lambda raw: b"\xef\xbb\xbf" * 2 + raw,
    lambda raw: raw.replace(b" ", "\u00a0".encode()),
    lambda raw: raw.replace(b".", b","),
    bytes.swapcase,
    lambda raw: raw[::-1],
    lambda raw: b"",
    lambda raw: b"\n \t\n",
    lambda raw: raw * 40,
]


def foreign(raw: bytes, rng: Random, other: bytes = CURVE.encode()) -> bytes:
    """Change numbers, bytes, lines and encodings by a hand that knows no grammar."""
    for _ in range(rng.choice([1, 1, 2, 4])):
        a, b = sorted((rng.randrange(len(raw) + 1), rng.randrange(len(raw) + 1)))
        match rng.randrange(8):
            case 0 | 1:
                found = list(NUMBER.finditer(raw))
                if found:
                    at = rng.choice(found)
                    raw = raw[: at.start()] + rng.choice(NUMBERS) + raw[at.end() :]
            case 2:
                raw = raw[:a] + rng.choice(JUNK) + raw[a:]
            case 3:
                raw = rng.choice(RECODED)(raw)
            case 4:
                raw = (
                    raw[:a]
                    + raw[a:b] * min(rng.choice([2, 9, 3000]), 1 + 10**6 // (b - a + 1))
                    + raw[b:]
                )
            case 5:
                raw = raw[:a] + other[rng.randrange(len(other)) :]
            case 6:
                lines = raw.split(b"\n")
                at = rng.randrange(len(lines))
                fields = lines[at].split(rng.choice([b",", b"=", b" ", b";"]))
                lines[at] = rng.choice([b",", b"=", b""]).join(fields * rng.choice([1, 2, 0]))
                raw = b"\n".join(lines)
            case _:
                mark = rng.choice([b'"', b"'", b"[", b"]", b"{", b"}", b"=", b",", b".", b"#"])
                raw = raw.replace(
                    mark, rng.choice([b"", mark * 2, b"\n", b" "]), rng.choice([1, -1])
                )
    return raw


MUTATIONS: list[Mutation] = [in_text, in_structure, in_structure, splice, foreign, foreign, foreign]


def spoilt(raw: bytes, rng: Random) -> bytes:
    """Return a text that something has happened to."""
    change = rng.choice([*MUTATIONS, *([zzuf] if ZZUF else [])])
    return change(raw, rng)


# ---- SQLite and HDF5 -----------------------------------------------------------------------------

STORED = [
    "text", -1, None, 3 * 10**8, 1e308, float("inf"), b"", b"[" * 10_000, b"{}", b"\xff" * 50,
    b'{"curve": "x", "result": []}', b'{"aperture_mm": 6}', "[[[", "{}", 2**62, "[]", "null", "[1]",
    '{"X1_MPa": 3}', '{"X1_MPa": ["a", 1, 2]}', "\x1b[2J", "1e999", "NaN",
]  # fmt: skip


def in_sqlite(path: Path, rng: Random) -> None:
    """Change values of rows, or bytes of pages."""
    if rng.random() < 0.5:
        path.write_bytes(rng.choice([in_bytes, *([zzuf] if ZZUF else [])])(path.read_bytes(), rng))
        return
    with closing(sqlite3.connect(path)) as db:
        tables = [n for (n,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        for _ in range(rng.randint(1, 5)):
            table = rng.choice([t for t in tables if db.execute(f"SELECT 1 FROM {t}").fetchone()])
            columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            which, where = rng.choice(columns), rng.choice(columns)
            (value,) = rng.choice(db.execute(f"SELECT {where} FROM {table}").fetchall())
            try:
                db.execute(
                    f"UPDATE {table} SET {which} = ? WHERE {where} IS ?",
                    (rng.choice(STORED), value),
                )
            except sqlite3.IntegrityError:
                continue
        db.commit()


def in_hdf5(path: Path, rng: Random, sealed: bool) -> None:
    """Change bytes; or fields, under a seal that holds."""
    if rng.random() < 0.3:
        path.write_bytes(rng.choice([in_bytes, *([zzuf] if ZZUF else [])])(path.read_bytes(), rng))
        return
    texts = [
        "", "[" * 5000, "{}", "[]", "7", '{"identification": 3}', '{"instrument": []}', "\x1b",
        3, 1e308, b"\xff", [1.0, 2.0], "null", "1e999", "\ud800".encode("utf-8", "surrogatepass"),
    ]  # fmt: skip
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        name = rng.choice(names)
        if isinstance(file[name], h5py.Dataset) and rng.random() < 0.6:
            old = file[name][()]
            if rng.random() < 0.5 and np.size(old) and old.dtype.kind in "fiu":
                spread = np.ravel(old).copy()
                for _ in range(rng.choice([1, 3, len(spread)])):
                    value = rng.choice([0, -1, 1, 1e308, -1e308, np.nan, np.inf, 1e-300, 7])
                    with np.errstate(all="ignore"):
                        spread[rng.randrange(len(spread))] = np.float64(value).astype(old.dtype)
                file[name][...] = np.reshape(spread, np.shape(old))
            else:
                del file[name]
                kind = rng.choice(["i1", "f4", "f8", "c16", "u8", "S3", "u1"])
                shape = rng.choice([(0,), old.shape, (3,), (10**12,), (2, 2), (3 * 10**8,)])
                file.create_dataset(
                    name, shape=shape, dtype=kind, chunks=True if np.prod(shape) else None
                )
        elif rng.random() < 0.2:
            del file[name]
        else:
            at = [file, *[file[n] for n in names if len(file[n].attrs)]]
            owner = rng.choice([o for o in at if len(o.attrs)])
            key = rng.choice(list(owner.attrs))
            said = owner.attrs[key]
            if isinstance(said, str) and rng.random() < 0.5:
                new = spoilt(said.encode(), rng)[:60_000].decode("utf-8", "replace")
                owner.attrs[key] = new.replace("\x00", "0")
            elif rng.random() < 0.2:
                del owner.attrs[key]
            else:
                owner.attrs[key] = rng.choice(texts)
    if sealed:
        image = bytearray(path.read_bytes())
        assert len(image) > SEAL_BYTES
        put_seal(memoryview(image))
        path.write_bytes(image)


# ---- the good files ------------------------------------------------------------------------------


def exports() -> dict[str, bytes]:
    """Return one curve as four kinds of software write it."""
    comma = [f"{t};{p};{w}".replace(".", ",") for t, p, w in ROWS]
    book = openpyxl.Workbook()
    for row in (("Time (s)", "Pressure (mbar)", "Deflection (mm)"), *ROWS):
        book.active.append(row)
    excel = io.BytesIO()
    book.save(excel)
    tabs = "\r\n".join(f"{1000 * t:.0f}\t{p / 10:.2f}\t{1000 * w:.1f}" for t, p, w in ROWS)
    return {
        "plain.csv": CURVE.encode(),
        "cutometer.csv": (
            "Cutometer dual MPA 580\nDatum: 12.03.2020 10:15\nSonde;6 mm\n\n"
            "Zeit [s];Druck [mbar];Auslenkung [mm]\n" + "\n".join(comma) + "\n"
        ).encode("latin-1"),
        "tabs.txt": ("elapsed time (ms)\tsuction (kPa)\tHöhe (µm)\r\n" + tabs).encode("utf-16"),
        "book.xlsx": excel.getvalue(),
    }


def write_originals(folder: Path) -> Path:
    """Write what is made of more than a text: a journal, an index of visits, a study, a capture."""
    example = read_session(EXAMPLE)
    writer = journal_of_example(folder / "journal")
    writer.audit(0.0, "me", "session opened", **example.meta)
    writer.close()
    for name, raw in exports().items():
        (folder / name).write_bytes(raw)
    (folder / "visits").mkdir()
    shutil.copy(EXAMPLE, folder / "visits" / "s.h5")
    visits(folder / "visits")
    people = folder / "people"
    people.mkdir()
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(["file", "subject", "site", "visit", "aperture_mm", "thickness_mm", "program"])
    for k in range(2):
        (people / f"c{k}.csv").write_text(CURVE)
        rows.writerow([f"c{k}.csv", f"P-{k}", "forearm", "1", "6", "1", "ramp:100@20"])
    (people / "curves.csv").write_text(table.getvalue())
    (people / "subjects.csv").write_text("subject,group,age_years,sex\nP-0,a,30,f\nP-1,b,40,m\n")
    assert run(STUDY(people, folder / "study")) == 0
    chunks = [
        {"schema": "skinlab.capture/1", "port": "x", "begun_utc": "2026-01-01T00:00:00+00:00"}
    ]
    begin = next(r.host_time_s for r in example.records if r.kind is Kind.RECEIVED)
    for record in example.records:
        if record.kind is Kind.RECEIVED and len(chunks) < 40:
            at_s = record.host_time_s - begin
            chunks.append({"time_s": at_s, "from": "instrument", "hex": record.data.hex()})
    (folder / "capture.jsonl").write_text("".join(json.dumps(c) + "\n" for c in chunks))
    with KeptRows(folder / "rows", "what", 3, resume=False) as kept:
        for k in range(9):
            kept.add(k, np.full(3, float(k)))
    return folder


def STUDY(people: Path, out: Path) -> list[str]:
    """Return the command of a study that is quick."""
    return ["study", str(people), "--out", str(out), "--workers", "1", "--method", "lm"]


# ---- kinds that commands read --------------------------------------------------------------------

Commands = list[list[str]]


def journal(folder: Path, originals: Path, rng: Random) -> Commands:
    shutil.copy(originals / "journal", folder / "j")
    in_sqlite(folder / "j", rng)
    info = [["session", "info", "s.h5"]] if rng.random() < 0.3 else []
    return [["recover", "j", "--out", "s.h5"], *info]


def session(folder: Path, originals: Path, rng: Random) -> Commands:
    shutil.copy(EXAMPLE, folder / "s.h5")
    in_hdf5(folder / "s.h5", rng, sealed=True)
    also = [
        ["export", "s.h5", "--to", "json", "out"], ["export", "s.h5", "--to", "csv", "out"],
        ["export", "s.h5", "--to", "fhir", "out"], ["export", "s.h5", "--to", "parameters", "out"],
        ["identify", "s.h5", "--method", "lm"], ["cutometer", "s.h5"],
    ]  # fmt: skip
    slow = ["compare", "s.h5", str(EXAMPLE)]
    return [["session", "info", "s.h5"], slow if rng.random() < 0.01 else rng.choice(also)]


def campaign(folder: Path, originals: Path, rng: Random) -> Commands:
    text, curve = (INPUTS / "campaign.toml").read_bytes(), CURVE.encode()
    if rng.random() < 0.7:
        text = spoilt(text, rng)
    else:
        curve = spoilt(curve, rng)
    (folder / "c.toml").write_bytes(text)
    (folder / "c.csv").write_bytes(curve)
    return [["identify", "c.toml", "--method", "lm"], ["cutometer", "c.toml"]]


def curve(folder: Path, originals: Path, rng: Random) -> Commands:
    (folder / "c.csv").write_bytes(spoilt(CURVE.encode(), rng))
    return [["identify", "c.csv", *GEOMETRY, "--method", "lm"]]


def export(folder: Path, originals: Path, rng: Random) -> Commands:
    name = rng.choice(["plain.csv", "cutometer.csv", "tabs.txt", "book.xlsx"])
    raw = (originals / name).read_bytes()
    by_bytes = name in {"tabs.txt", "book.xlsx"}  # UTF-16, and a zip
    (folder / name).write_bytes(
        rng.choice([in_bytes, foreign])(raw, rng) if by_bytes else spoilt(raw, rng)
    )
    return [["import", name, *GEOMETRY, "--program", "ramp:100@20", "--out", "s.h5"]]


def model(folder: Path, originals: Path, rng: Random) -> Commands:
    (folder / "m.toml").write_bytes(spoilt((INPUTS / "model.toml").read_bytes(), rng))
    return [["forward", *SKIN, *GEOMETRY, "--program", "ramp:100@20", "--model", "m.toml"]]


def database(folder: Path, originals: Path, rng: Random) -> Commands:
    shutil.copy(OLD / "custom.h5", folder / "d.h5")
    in_hdf5(folder / "d.h5", rng, sealed=False)
    curve = [
        "--x1-mpa",
        "0.03",
        "--x2-mpa",
        "1",
        "--nu",
        "0.3",
        *GEOMETRY,
        "--program",
        "ramp:50@20",
    ]
    return [["database", "info", "d.h5"], ["forward", *curve, "--database", "d.h5"]]


def study(folder: Path, originals: Path, rng: Random) -> Commands:
    shutil.copytree(originals / "people", folder / "people")
    name = rng.choice(["curves.csv", "subjects.csv", "c0.csv", "curves.csv"])
    path = folder / "people" / name
    path.write_bytes(spoilt(path.read_bytes(), rng))
    return [STUDY(Path("people"), Path("study"))]


def study_state(folder: Path, originals: Path, rng: Random) -> Commands:
    shutil.copytree(originals / "study", folder / "study")
    in_sqlite(folder / "study" / "study.sqlite", rng)
    return [STUDY(originals / "people", Path("study"))]


def used(folder: Path, originals: Path, rng: Random) -> Commands:
    """What is read beside a curve, in use; its readers alone are READERS."""
    (folder / "c.csv").write_text(CURVE)
    name = rng.choice(["probe", "prior", "protocol", "phantoms", "dialect"])
    (folder / "f.toml").write_bytes(spoilt(READERS[name][0], rng))
    identify = ["identify", "c.csv", *GEOMETRY]
    return [{
        "probe": [*identify, "--probe", "f.toml"],
        "prior": [*identify, "--prior", "f.toml", "--site", "arm"],
        "protocol": ["measure", "--port", NOBODY, "--protocol", "f.toml", "--thickness-mm", "1",
                     "--out", "m.h5"],
        "phantoms": ["calibrate", "--port", NOBODY, "--phantoms", "f.toml", "--out", "p.toml"],
        "dialect": ["capture", "--port", NOBODY, "--dialect", "f.toml", "--seconds", "0",
                    "--out", "c.jsonl"],
    }[name]]  # fmt: skip


KINDS: dict[str, Callable[[Path, Path, Random], Commands]] = {
    f.__name__: f
    for f in (
        journal, session, campaign, curve, export, model, database, study, study_state, used,
    )
}  # fmt: skip


# ---- kinds that go straight to their reader ------------------------------------------------------


def _skin(path: Path) -> None:
    build_device(path, seed=1, speed=1.0, aperture_mm=6.0, faults_file=None)


def _faults(path: Path) -> None:
    build_device(None, seed=1, speed=1.0, aperture_mm=6.0, faults_file=path)


def _capture(path: Path) -> None:
    list(decode_capture(read_capture(path)[1], get_dialect("reference")))


def _checkpoint(path: Path) -> None:
    with KeptRows(path, "what", 3, resume=True) as kept:
        list(kept.found())


def _raw(name: str) -> bytes:
    return (INPUTS / f"{name}.toml").read_bytes()


TIDY = "file,subject,X1_MPa,X1_MPa_low,X1_MPa_high\n" + "".join(
    f"c{k}.csv,P{k},0.03,0.02,0.04\n" for k in range(9)
)
KEPT = json.dumps({"port": "sim://", "aperture_mm": "6", "program": "ramp:100@20"})
KEYS = 'theme = "dark"\n[keys]\nvent = "f12"\nhelp = ["f11", "ctrl+y"]\n'
ANSWERS = '[[layout]]\nheadings = ["a", "b"]\n[layout.answers]\ntime-column = "a"\n'
DIALECT = (ROOT / "examples" / "dialects" / "plain_line.toml").read_bytes()
PHANTOMS = (files("skinlab") / "data" / "phantoms.toml").read_bytes()
# A good file's bytes, and what reads it; the drivers and the simulator know no InputError
READERS: dict[str, tuple[bytes, Callable[[Path], object]]] = {
    "probe": (_raw("probe"), read_probe),
    "prior": (_raw("prior"), read_prior),
    "reference": (_raw("reference"), read_reference),
    "protocol": (_raw("protocol"), read_protocol),
    "phantoms": (PHANTOMS, read_phantoms),
    "spec": (_raw("spec"), read_spec),
    "model": (_raw("model"), read_model),
    "dialect": (DIALECT, read_line_dialect),
    "skin": (_raw("skin"), _skin),
    "faults": (_raw("faults"), _faults),
    "tidy": (TIDY.encode(), read_columns),
    "fields": (KEPT.encode(), recall),
    "keys": (KEYS.encode(), lambda path: read_settings(path, owners())),
    "answers": (ANSWERS.encode(), lambda path: Remembered(path).lines),
}
MADE: dict[str, Callable[[Path], object]] = {"capture.jsonl": _capture, "rows": _checkpoint}
PLAIN_ERRORS = {"skin", "faults", "capture.jsonl"}


def refusal(kind: str) -> type[Exception]:
    """Return the error that a reader of this kind may end in."""
    if kind == "dialect":
        return DialectFileError
    return ValueError if kind in PLAIN_ERRORS else InputError
