"""The table of seeds says what the files of results say: it is written by hand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "missing-effect-figures.md").read_text(encoding="utf-8")
SEEDS = PAGE.partition("## Seed by seed")[2].partition('"The truth leads" says')[0]
ROWS = {
    match[1]: [cell.strip() for cell in match[0].split("|")[1:-1]]
    for match in re.finditer(r"^\| (\d+).*\|$", SEEDS, re.MULTILINE)
}
FILES = {
    path.stem.rpartition("_")[2]: json.loads(path.read_text(encoding="utf-8"))
    for path in (ROOT / "benchmarks" / "results").glob("missing_effect_life_[0-9]*1911.json")
}
# Older files have no `figures`; 441911 counts as it was run first, its file as it was run again.
COMPARED = sorted(s for s, file in FILES.items() if "figures" in file and s in ROWS)
AGAIN = "441911"


def counted(seed: str, figure: str) -> tuple[int, int]:
    """Return (how many, of how many); (0, 0) of what was not asked at that seed."""
    share = FILES[seed]["figures"].get("life_" + figure, {"share": None, "of": 0})
    return round((share["share"] or 0.0) * share["of"]), share["of"]


def told(cell: str) -> tuple[int, int] | None:
    match = re.match(r"(\d+) of (\d+)", cell)
    return match and (int(match[1]), int(match[2]))


def test_seeds_are_found():
    assert len(COMPARED) >= 20


@pytest.mark.parametrize("seed", [seed for seed in COMPARED if seed != AGAIN])
def test_a_row_is_as_its_file(seed):
    _, _, nothing, right, knower, tied, *_ = ROWS[seed]
    alarms, of = counted(seed, "something_named_where_nothing_is")
    if of:
        some, _ = counted(seed, "anything_but_none_where_nothing_is")
        assert nothing.startswith(f"{alarms}; {some} of {of}")
    # The figure has the names where nothing is hidden, too; the column has not.
    rights, names = counted(seed, "names_right")
    assert told(right) == (rights, names - alarms)
    assert told(knower) == counted(seed, "named_where_a_knower_of_the_errors_has_20_to_1")
    assert told(tied) == counted(seed, "truth_among_tied")


@pytest.mark.parametrize("seed", [seed for seed in COMPARED if int(seed) >= 281911])
def test_pairs_are_as_the_file_counts_them(seed):
    pairs = ROWS[seed][6]
    rights, of = counted(seed, "two_hidden_named_rightly")
    wrong, _ = counted(seed, "two_hidden_named_wrongly")
    if of:
        both, _, wrongly = pairs.rpartition("; ")
        assert told(wrongly) == (wrong, of)
        assert rights in {int(n) for n in re.findall(r"\d+", both)}


def test_the_short_table_has_the_same():
    short = (ROOT / "docs" / "missing-effect.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+1911), .*\|$", short, re.MULTILINE)
    assert rows
    for seed in rows:
        (line,) = re.findall(rf"^\| {seed}, .*\|$", short, re.MULTILINE)
        _, _, nothing, right, knower, pairs, *_ = [c.strip() for c in line.split("|")[1:-1]]
        assert ROWS[seed][2].startswith(nothing)
        assert (told(ROWS[seed][3]), told(ROWS[seed][4])) == (told(right), told(knower))
        rights, of = counted(seed, "two_hidden_named_rightly")
        wrong, _ = counted(seed, "two_hidden_named_wrongly")
        assert pairs == f"{rights}; {wrong} of {of}"
