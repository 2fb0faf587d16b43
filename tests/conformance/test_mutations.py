"""Files that anything may have happened to: each ends in an answer or a sentence, never in a bug.

30 seeded mutations a kind; `make soak` runs 10,000, and looks at time and memory too.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import json
import random
import resource
import shutil
import sqlite3
import time
import tomllib
from collections.abc import Callable
from contextlib import closing
from importlib.resources import files
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
from explained import UP
from explained import campaign as campaign_of_offset

from drivers.line_dialect import read_line_dialect
from sim_device.build import build_device
from skinlab.acquisition.protocol import read_protocol
from skinlab.acquisition.settings import recall
from skinlab.cli.main import run
from skinlab.curves.phantoms import read_phantoms
from skinlab.discrepancy import cache
from skinlab.discrepancy.workflow import explain
from skinlab.errors import InputError
from skinlab.inference.population import read_prior
from skinlab.inference.probe_file import read_probe
from skinlab.mechanics.model_file import read_model
from skinlab.recording.journal import Journal
from skinlab.recording.records import Kind
from skinlab.recording.seal import SEAL_BYTES, put_seal
from skinlab.recording.session import read_session
from skinlab.studies.reference import read_reference
from skinlab.studies.table import read_columns
from skinlab.tables.spec_file import read_spec
from skinlab.tables.store import shipped_table

EXAMPLE = Path(str(files("skinlab") / "data" / "example.h5"))
GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]
CURVE = "time_s,pressure_mbar,deflection_mm\n" + "".join(
    f"{t / 10},{2 * t},{0.02 * t**0.8:.6f}\n" for t in range(51)
)
CAMPAIGN = """[campaign]
title = "forearm"
noise_um = 3.0
[[curve]]
file = "c.csv"
aperture_mm = 6.0
thickness_mm = 1.0
program = "ramp:100@20"
cycle = 1
"""
MODEL = """[model]
name = "forearm"
law = "extended_neo_hookean"
kappa = "paper"
[parameters.X1_MPa]
low = 0.005
high = 0.2
prior = "log-uniform"
[effects.deflection_gain.gain]
value = 1.1
prior = {mean = 1.1, sd = 0.02}
[provenance]
verdict = "named"
"""
SKIN = """[skin]
X1_MPa = 0.025
X2_MPa = 2.95
nu = 0.28
thickness_mm = 1.0
[sensor]
rate_hz = 20.0
noise_um = 3.0
"""
FAULTS = """[[fault]]
kind = "unplug"
at_s = 2.0
for_s = 1.0
[[fault]]
kind = "bit_flip"
at_s = 1.0
rate = 0.1
"""
TOKENS = [
    "text", '"text"', "-1", "0", "1e308", "1e999", "nan", "-inf", "true", "[]", "{}", "9" * 400,
    "[" * 2000, "{a=" * 2000, "\\u0000", '"\\u0000"', "\x00", "\x1b]0;x\x07", "\n", '"', "=", ",",
    "../../etc/passwd", "1979-05-27", "\ufeff", "x" * 200_000,
]  # fmt: skip


def in_text(raw: bytes, rng: random.Random) -> bytes:
    """Put a token in the place of another, or do what happens to bytes."""
    if rng.random() < 0.4:
        return in_bytes(raw, rng)
    words = raw.decode().replace("=", " = ").split(" ")
    for _ in range(rng.randint(1, 3)):
        words[rng.randrange(len(words))] = rng.choice(TOKENS)
    return " ".join(words).encode("utf-8", "surrogatepass")


def in_bytes(raw: bytes, rng: random.Random) -> bytes:
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


def in_journal(path: Path, rng: random.Random) -> None:
    """Change values of rows, or bytes of pages."""
    if rng.random() < 0.5:
        path.write_bytes(in_bytes(path.read_bytes(), rng))
        return
    values = [
        "text", -1, None, 3 * 10**8, 1e308, float("inf"), b"", b"[" * 10_000, b"{}", b"\xff" * 50,
        b'{"curve": "x", "result": []}', b'{"aperture_mm": 6}', "[[[", "{}", 2**62,
    ]  # fmt: skip
    with closing(sqlite3.connect(path)) as db:
        rows = [n for (n,) in db.execute("SELECT number FROM record")]
        keys = [k for (k,) in db.execute("SELECT key FROM meta")]
        for _ in range(rng.randint(1, 5)):
            try:
                if rng.random() < 0.2:
                    change = (rng.choice(values), rng.choice(keys))
                    db.execute("UPDATE meta SET value = ? WHERE key = ?", change)
                else:
                    column = rng.choice(["kind", "host_time_s", "utc_s", "data", "data"])
                    change = (rng.choice(values), rng.choice(rows))
                    db.execute(f"UPDATE record SET {column} = ? WHERE number = ?", change)
            except sqlite3.IntegrityError:
                continue
        db.commit()


def in_session(path: Path, rng: random.Random) -> None:
    """Change bytes, which break the seal; or fields, under a seal that holds."""
    if rng.random() < 0.3:
        path.write_bytes(in_bytes(path.read_bytes(), rng))
        return
    texts = ["", "[" * 5000, "{}", "[]", "7", '{"identification": 3}', '{"instrument": []}', "\x1b"]
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        name = rng.choice(names)
        if isinstance(file[name], h5py.Dataset) and rng.random() < 0.8:
            old = file[name][()]
            del file[name]
            kind = rng.choice(["i1", "f4", "f8", "c16", "u8", "S3", "u1"])
            shape = rng.choice([(0,), old.shape, (3,), (10**12,), (2, 2), (3 * 10**8,)])
            file.create_dataset(
                name, shape=shape, dtype=kind, chunks=True if np.prod(shape) else None
            )
        else:
            owner = rng.choice([file, file["curves/0001"]])
            if len(owner.attrs):
                owner.attrs[rng.choice(list(owner.attrs))] = rng.choice([*texts, 3, 1e308, b"\xff"])
    image = bytearray(path.read_bytes())
    assert len(image) > SEAL_BYTES
    put_seal(memoryview(image))
    path.write_bytes(image)


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    folder = tmp_path_factory.mktemp("originals")
    example = read_session(EXAMPLE)
    writer = Journal(folder / "journal", example.meta)
    for record in example.records:
        match record.kind:
            case Kind.PLAN:
                writer.plan(record.host_time_s, json.loads(record.data))
            case Kind.RESULT:
                entry = json.loads(record.data)
                writer.result(record.host_time_s, entry["curve"], entry["result"])
            case Kind.RECEIVED | Kind.SENT:
                way = "rx" if record.kind is Kind.RECEIVED else "tx"
                writer.raw(way, record.host_time_s, record.data, record.utc_s)
            case Kind.AUDIT:
                writer.audit(record.host_time_s, "me", "session opened", **example.meta)
    writer.close()
    return folder


def journal(folder: Path, originals: Path, rng: random.Random) -> list[list[str]]:
    shutil.copy(originals / "journal", folder / "j")
    in_journal(folder / "j", rng)
    return [["recover", "j", "--out", "s.h5"]] + [["session", "info", "s.h5"]] * (
        rng.random() < 0.3
    )


def session(folder: Path, originals: Path, rng: random.Random) -> list[list[str]]:
    shutil.copy(EXAMPLE, folder / "s.h5")
    in_session(folder / "s.h5", rng)
    return [["session", "info", "s.h5"], ["export", "s.h5", "--to", "json", "out"]]


def campaign(folder: Path, originals: Path, rng: random.Random) -> list[list[str]]:
    text, curve = CAMPAIGN.encode(), CURVE.encode()
    if rng.random() < 0.7:
        text = in_text(text, rng)
    else:
        curve = in_text(curve, rng)
    (folder / "c.toml").write_bytes(text)
    (folder / "c.csv").write_bytes(curve)
    return [["identify", "c.toml", "--method", "lm"], ["cutometer", "c.toml"]]


def model(folder: Path, originals: Path, rng: random.Random) -> list[list[str]]:
    (folder / "m.toml").write_bytes(in_text(MODEL.encode(), rng))
    skin = ["--x1-mpa", "0.02", "--x2-mpa", "1", "--nu", "0.3"]
    return [["forward", *skin, *GEOMETRY, "--program", "ramp:100@20", "--model", "m.toml"]]


KINDS: dict[str, Callable[[Path, Path, random.Random], list[list[str]]]] = {
    f.__name__: f for f in (journal, session, campaign, model)
}


def attack(kind, count, seed, folder, originals, capfd, monkeypatch) -> float:
    """Run the mutations; return the longest time of a command, s."""
    longest = 0.0
    for number in range(count):
        rng = random.Random(f"{kind} {seed} {number}")
        at = folder / str(number)
        at.mkdir()
        monkeypatch.chdir(at)
        for arguments in KINDS[kind](at, originals, rng):
            begin = time.monotonic()
            status = run(arguments)
            longest = max(longest, time.monotonic() - begin)
            said = capfd.readouterr()
            assert status in {0, 1, 2, 3, 5}, (number, arguments, said.err)
            for word in ("Traceback", "Warning", "internal error", "\x1b"):
                assert word not in said.out + said.err, (number, arguments)
        shutil.rmtree(at)
    return longest


@pytest.mark.parametrize("kind", KINDS)
def test_commands_end_in_an_answer_or_a_sentence(kind, tmp_path, originals, capfd, monkeypatch):
    attack(kind, 30, 0, tmp_path, originals, capfd, monkeypatch)


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_ten_thousand_of_each(kind, tmp_path, originals, capfd, monkeypatch):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    longest = attack(kind, 10_000, 1, tmp_path, originals, capfd, monkeypatch)
    assert longest < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000


def probes(count, seed, folder):
    path = folder / "f.toml"
    for number in range(count):
        for text, name in ((SKIN, "skin"), (FAULTS, "faults")):
            path.write_bytes(in_text(text.encode(), random.Random(f"{name} {seed} {number}")))
            skin, faults = (path, None) if name == "skin" else (None, path)
            try:
                build_device(skin, seed=1, speed=1.0, aperture_mm=6.0, faults_file=faults)
            except ValueError:  # the one that is promised; anything else fails here
                continue


def test_skins_and_faults_build_a_probe_or_end_in_a_sentence(tmp_path):
    probes(30, 0, tmp_path)


@pytest.mark.soak
def test_ten_thousand_skins_and_faults(tmp_path):
    probes(10_000, 1, tmp_path)


@pytest.fixture(scope="module")
def outcome():
    table = shipped_table()
    return explain(campaign_of_offset(table, UP), table, workers=1)


@pytest.mark.parametrize("count", [30, pytest.param(10_000, marks=pytest.mark.soak)])
def test_a_damaged_cache_is_computed_again(tmp_path, outcome, count):
    records = outcome.found.records
    cache.save("key", outcome, tmp_path)
    (file,) = tmp_path.iterdir()
    raw = file.read_bytes()
    assert cache.load("key", records, tmp_path) is not None
    for number in range(count):
        damaged = in_bytes(raw, random.Random(number))
        file.write_bytes(damaged)
        assert damaged == raw or cache.load("key", records, tmp_path) is None


# ---- all that is read of text, straight to its reader, by changes of two kinds -----------------

PROBE = """schema = "skinlab.probe/1"
serial_number = "P-9"
model = "m"
aperture_mm = 6.0
calibrated_utc = "2026-01-01T00:00:00+00:00"
valid_until_utc = "2027-01-01T00:00:00+00:00"
noise_um = 3.0
pressure_noise_mbar = 0.2
misfit = 1.0
not_determined = []
phantoms_off = []
phantoms = []
covariance = [[1e-4, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1e-4, 0.0, 0.0],
  [0.0, 0.0, 0.0, 0.01, 0.0], [0.0, 0.0, 0.0, 0.0, 1e-6]]
deflection_gain = {value = 1.06, low = 1.05, high = 1.07}
deflection_offset_um = {value = -35.0, low = -36.0, high = -34.0}
pressure_gain = {value = 0.97, low = 0.96, high = 0.98}
pressure_offset_mbar = {value = 0.6, low = 0.5, high = 0.7}
lag_s = {value = 0.03, low = 0.02, high = 0.04}
"""
PRIOR = """schema = "skinlab.prior/1"
parameters = ["X1_MPa", "X2_MPa", "nu"]
coordinates = ["log", "log", "linear"]
mean = [-3.5, 0.2, 0.3]
covariance = [[0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.0004]]
freedom = 30.0
people = 33
curves = 66
model_hash = "sha256:0"
"""
REFERENCE = """schema = "skinlab.reference/1"
title = "cheeks"
source = "somebody 2020"
licence = "CC0"
[[range]]
quantity = "R0"
site = "cheek"
aperture_mm = 2.0
program = "mode1:450,3,3"
n = 75
[range.percentiles]
5 = 0.20
50 = 0.26
95 = 0.32
"""
PROTOCOL = """[study]
title = "Winter forearms"
sites = ["forearm, volar, left"]
[conditions]
room_temperature_c = [20.0, 24.0]
operator = true
[acceptance]
interval_percent = {X1_MPa = 20.0}
[[step]]
name = "wide"
aperture_mm = 6.0
program = "ramp:100@20"
repeats = 2
rest_s = 30.0
"""
SPEC = """[model]
name = "small"
[axis.X1_MPa]
low = 0.02
high = 0.05
nodes = 2
[axis.X2_MPa]
low = 0.5
high = 2.0
nodes = 2
[axis.nu]
low = 0.28
high = 0.36
nodes = 2
[pressures]
high_mbar = 30
nodes = 8
"""
TIDY = "file,subject,X1_MPa,X1_MPa_low,X1_MPa_high\n" + "".join(
    f"c{k}.csv,P{k},0.03,0.02,0.04\n" for k in range(9)
)
SETTINGS = json.dumps({"port": "sim://", "aperture_mm": "6", "program": "ramp:100@20"})
DIALECT = (Path(__file__).parents[2] / "examples" / "dialects" / "plain_line.toml").read_text()
PHANTOMS = (files("skinlab") / "data" / "phantoms.toml").read_text()
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "probe": (PROBE, read_probe),
    "prior": (PRIOR, read_prior),
    "reference": (REFERENCE, read_reference),
    "protocol": (PROTOCOL, read_protocol),
    "phantoms": (PHANTOMS, read_phantoms),
    "spec": (SPEC, read_spec),
    "model": (MODEL, read_model),
    "dialect": (DIALECT, read_line_dialect),
    "study": (TIDY, read_columns),
    "settings": (SETTINGS, recall),
}
WRONG = [
    0, -1, 2**63 - 1, 1e308, -1e308, float("nan"), float("inf"), 5e-324, True, "", "x", "9" * 5000,
    "\x1b[2J", "../..", [], [[]], [1, "a"], [[1.0], [1.0, 2.0]], {}, {"a": {"b": [{}]}},
    dt.datetime(1, 1, 1), dt.date(9999, 12, 31), dt.time(23, 59),
]  # fmt: skip


def in_structure(raw: bytes, rng: random.Random) -> bytes:
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
                    holder[key] = [holder[key]] * rng.choice([1, 2, 300])
                case 2 if isinstance(holder, dict):
                    holder[rng.choice(["", "x", "schema", "a.b", key.upper()])] = holder[key]
                case _:
                    holder[key] = rng.choice(WRONG)
            break
    return tomli_w.dumps(tree).encode("utf-8", "surrogatepass")


def splice(raw: bytes, rng: random.Random) -> bytes:
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


def readers(kind: str, count: int, seed: int, folder: Path) -> None:
    text, read = READERS[kind]
    path = folder / "file.toml"
    path.write_text(text)
    read(path)  # so that what is mutated is good
    for number in range(count):
        rng = random.Random(f"{kind} {seed} {number}")
        change = rng.choice([in_text, in_structure, in_structure, splice])
        path.write_bytes(change(text.encode(), rng))
        begin = time.process_time()
        # A dialect is the drivers', which know no InputError
        with contextlib.suppress(ValueError if kind == "dialect" else InputError):
            read(path)
        assert time.process_time() - begin < 10.0


@pytest.mark.parametrize("kind", READERS)
def test_readers_end_in_a_sentence(kind, tmp_path):
    readers(kind, 60, 0, tmp_path)


@pytest.mark.soak
@pytest.mark.parametrize("kind", READERS)
def test_ten_thousand_of_each_reader(kind, tmp_path):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    readers(kind, 10_000, 1, tmp_path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000
