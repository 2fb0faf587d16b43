"""Files that anything may have happened to: each ends in an answer or a sentence, never in a bug.

Some seeded mutations a kind; the soak runs 10,000 in pieces of 1,000, looks at time and memory too,
and saves what it counted. `pytest -m soak --stepwise tests/conformance/test_mutations.py` goes on
where one failed.
"""

from __future__ import annotations

import contextlib
import json
import math
import random
import resource
import shutil
import time
from collections import Counter
from pathlib import Path

import pytest
from explained import UP
from explained import campaign as campaign_of_offset
from mutations import (
    KINDS,
    MADE,
    READERS,
    ZZUF,
    in_bytes,
    in_sqlite,
    refusal,
    spoilt,
    write_originals,
)

from skinlab.cli.main import run
from skinlab.discrepancy import cache
from skinlab.discrepancy.workflow import explain
from skinlab.recording.visit_index import NAME as VISITS
from skinlab.recording.visit_index import visits
from skinlab.tables.store import shipped_table

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results" / "mutations.json"
PIECES = range(10)
A_PIECE = 1000
LONGEST_S = 10.0
MOST_KB = 500_000
MOST_BYTES = 1_000_000  # of a file that is read in `make test`; one of 7 MB takes 2.5 s
GROW = ("keys", "answers")  # so large among the first 60
FORBIDDEN = ("Traceback", "Warning", "internal error", "\x1b", "\x00")
LONGEST_LINE, MOST_LINES = 1600, 60  # on standard error


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    return write_originals(tmp_path_factory.mktemp("originals"))


def memory_kb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def save(kind, piece, **figures):
    """Add the figures of a piece to those of the pieces before."""
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"command": "make soak"}
    results[kind] = {**results.get(kind, {}), str(piece): {"zzuf": bool(ZZUF), **figures}}
    RESULTS.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n")


def attack(kind, numbers, folder, originals, capfd, monkeypatch):
    """Run the commands on mutations; return how they ended, and the longest time of one, s."""
    longest, ends, wrong = 0.0, Counter(), []
    allowed = {0, 1, 2, 3, 4, 5} if kind == "used" else {0, 1, 2, 3, 5}
    for number in numbers:
        rng = random.Random(f"{kind} {number}")
        at = folder / str(number)
        at.mkdir()
        monkeypatch.chdir(at)
        for arguments in KINDS[kind](at, originals, rng):
            begin = time.process_time()
            status = run(arguments)
            longest = max(longest, time.process_time() - begin)
            ends[str(status)] += 1
            said = capfd.readouterr()
            if (
                status not in allowed
                or (status != 0 and not (said.err + said.out).strip())
                or any(len(line) > LONGEST_LINE for line in said.err.splitlines())
                or said.err.count("\n") > MOST_LINES
                or any(word in said.out + said.err for word in FORBIDDEN)
            ):
                wrong.append(f"{number} {arguments} {status}: {said.err[-600:]}")
        monkeypatch.chdir(folder)
        shutil.rmtree(at)
    assert wrong == []
    return ends, longest


@pytest.mark.parametrize("kind", KINDS)
def test_commands_end_in_an_answer_or_a_sentence(kind, tmp_path, originals, capfd, monkeypatch):
    attack(kind, range(4 if kind == "study" else 8), tmp_path, originals, capfd, monkeypatch)


@pytest.mark.soak
@pytest.mark.parametrize("piece", PIECES)
@pytest.mark.parametrize("kind", KINDS)
def test_ten_thousand_of_each(kind, piece, tmp_path, originals, capfd, monkeypatch):
    before = memory_kb()
    numbers = range(A_PIECE * piece, A_PIECE * (piece + 1))
    ends, longest = attack(kind, numbers, tmp_path, originals, capfd, monkeypatch)
    grown = memory_kb() - before
    assert longest < LONGEST_S
    assert grown < MOST_KB
    save(kind, piece, ends=dict(ends), longest_s=round(longest, 2), grown_mb=grown // 1000)


def read_spoilt(kind, good, read, numbers, folder, most_bytes=math.inf):
    """Let a reader read mutations; return how many it took, and the longest time of one, s."""
    path = folder / "file.toml"
    path.write_bytes(good)
    read(path)  # so that what is mutated is good
    longest, taken = 0.0, 0
    for number in numbers:
        raw = spoilt(good, random.Random(f"{kind} {number}"))
        if len(raw) > most_bytes:
            continue
        path.write_bytes(raw)
        begin = time.process_time()
        with contextlib.suppress(refusal(kind)):
            read(path)
            taken += 1
        longest = max(longest, time.process_time() - begin)
    assert longest < LONGEST_S
    return taken, longest


@pytest.mark.parametrize(
    ("kind", "most_bytes"),
    [
        *((kind, MOST_BYTES) for kind in (*READERS, *MADE)),
        *(pytest.param(kind, math.inf, marks=pytest.mark.long) for kind in GROW),
    ],
)
def test_readers_end_in_a_sentence(kind, most_bytes, tmp_path, originals):
    good, read = READERS[kind] if kind in READERS else ((originals / kind).read_bytes(), MADE[kind])
    read_spoilt(kind, good, read, range(60), tmp_path, most_bytes)


@pytest.mark.soak
@pytest.mark.parametrize("kind", [*READERS, *MADE])
def test_ten_thousand_of_each_reader(kind, tmp_path, originals):
    good, read = READERS[kind] if kind in READERS else ((originals / kind).read_bytes(), MADE[kind])
    before = memory_kb()
    taken, longest = read_spoilt(kind, good, read, range(A_PIECE * len(PIECES)), tmp_path)
    grown = memory_kb() - before
    assert grown < MOST_KB
    figures = {"read": taken, "longest_s": round(longest, 2), "grown_mb": grown // 1000}
    save(f"reader of {kind}", "all", **figures)


@pytest.mark.parametrize("count", [30, pytest.param(10_000, marks=pytest.mark.soak)])
def test_a_damaged_index_of_visits_is_made_again(tmp_path, originals, count):
    wanted = visits(originals / "visits")
    whole = (originals / "visits" / VISITS).read_bytes()
    folder = tmp_path / "v"
    shutil.copytree(originals / "visits", folder, copy_function=shutil.copy2)
    for number in range(count):
        (folder / VISITS).write_bytes(whole)
        in_sqlite(folder / VISITS, random.Random(number))
        found = visits(folder)
        assert len(found) == len(wanted) == 1
    if count > 1000:
        save("index of visits", "all", made_again=count)


@pytest.fixture(scope="module")
def outcome():
    table = shipped_table()
    return explain(campaign_of_offset(table, UP), table, workers=1, finite_elements=False)


@pytest.mark.long
@pytest.mark.parametrize("count", [30, pytest.param(10_000, marks=pytest.mark.soak)])
def test_a_damaged_cache_is_computed_again(tmp_path, outcome, count):
    records = outcome.found.records
    cache.save("key", outcome, tmp_path)
    (file,) = tmp_path.iterdir()
    raw = file.read_bytes()
    assert cache.load("key", records, tmp_path) is not None
    before, longest = memory_kb(), 0.0
    for number in range(count):
        damaged = in_bytes(raw, random.Random(number))
        file.write_bytes(damaged)
        begin = time.process_time()
        assert damaged == raw or cache.load("key", records, tmp_path) is None
        longest = max(longest, time.process_time() - begin)
    grown = memory_kb() - before
    assert longest < LONGEST_S
    assert grown < MOST_KB
    if count > 1000:
        figures = {"longest_s": round(longest, 2), "grown_mb": grown // 1000}
        save("cache", "all", computed_again=count, **figures)
