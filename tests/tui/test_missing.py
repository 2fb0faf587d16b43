"""What the model misses: the screen by keys, and the search in its own process."""

from __future__ import annotations

import re
import threading
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest
from explained import UP, UP_AND_DOWN, campaign
from textual.widgets import Input

from skinlab.acquisition.adopting import write_adopted
from skinlab.acquisition.explainer import Explainer
from skinlab.acquisition.probe_session import ProbeSession
from skinlab.discrepancy.next_measurement import NextMeasurement
from skinlab.discrepancy.odds import odds_words
from skinlab.discrepancy.verdict import Verdict
from skinlab.discrepancy.workflow import explain
from skinlab.errors import InputError, SkinlabError
from skinlab.inference.result import Value
from skinlab.mechanics.effects import all_effects
from skinlab.mechanics.model_file import BASE, read_model
from skinlab.recording.advised import ADVISED, MISSING_EFFECT
from skinlab.recording.audit import entries
from skinlab.recording.session import read_session
from skinlab.tui.missing import (
    hints,
    missing_rows,
    outcome_rows,
    size_words,
    verdict_lines,
)
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.missing import MissingScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.shown import Missing


@pytest.fixture(scope="module")
def named(table):
    """The answer of a real search."""
    return explain(campaign(table, UP_AND_DOWN), table, finite_elements=False)


@pytest.fixture(scope="module")
def ambiguous(named):
    """The same, as if two explanations were tied."""
    best = named.best
    tied = NextMeasurement(8.0, "ramp:300@60,ramp:0@60", (best.effects, ("pressure_lag",)), 3.2)
    verdict = Verdict("ambiguous", [best, best])
    return replace(named, verdict=verdict, next_measurement=tied)


class Search:
    """In the place of the other process: answers when it is told to."""

    def __init__(self, answer=None):
        self.answer = answer
        self.go = threading.Event()
        self.asked = []

    def __call__(self, campaign, model, tell, database_path):
        self.asked.append(campaign)
        tell("screening")
        self.go.wait(120.0)
        return self.answer

    def cancel(self):
        self.answer = None
        self.go.set()


def keep_audit(bed, monkeypatch):
    """Return what goes into the audit trail from here on."""
    noted, audit = [], bed.app.bench.audit

    def keep(what, **detail):
        noted.append((what, detail))
        audit(what, **detail)

    monkeypatch.setattr(bed.app.bench, "audit", keep)
    return noted


async def looking(bed):
    """Measure once, and begin to look for what the model misses."""
    await bed.connected()
    await bed.run()
    await bed.press("d")
    await bed.on(MissingScreen)
    await bed.until(lambda: "now:  screening" in bed.text("#missing-text"))


@pytest.mark.long
async def test_the_search_blocks_nothing_and_the_next_measurement_is_one_key_away(
    bedside, ambiguous, monkeypatch
):
    search = Search(ambiguous)
    async with bedside(explain=search) as bed:
        await looking(bed)
        (asked,) = search.asked
        assert [curve.name for curve in asked.curves] == ["curve 1"]
        await bed.press("a", "f7")  # nothing to adopt or to load yet
        vents = bed.app.bench.vents
        await bed.press("v")  # vents, and goes back
        await bed.until(lambda: bed.app.bench.vents > vents)
        await bed.on(MainScreen)
        await bed.run()  # the search goes on meanwhile
        search.go.set()
        await bed.until(lambda: bed.board.missing.outcome is ambiguous)
        await bed.press("s")
        await bed.until(lambda: bed.app.screen.query("#session-text"))
        await bed.press("d")
        await bed.on(MissingScreen)
        await bed.until(lambda: "tied" in bed.text("#missing-text"))
        assert len(search.asked) == 1  # shown, not looked for again
        noted = keep_audit(bed, monkeypatch)
        await bed.press("f7")
        await bed.on(MainScreen)
        following = ambiguous.next_measurement
        assert noted == [
            (ADVISED, {"aperture_mm": following.aperture_mm, "program": following.program,
                       "because": MISSING_EFFECT})
        ]  # fmt: skip
        program, opening = (
            bed.app.screen.query_one(f, Input) for f in ("#program", "#aperture_mm")
        )
        await bed.until(lambda: program.value == ambiguous.next_measurement.program)
        await bed.until(lambda: opening.value == "8")
        assert len(bed.board.entries) == 2
        await bed.check()  # the other head, in the same session
        assert bed.board.hello.aperture_mm == 8
        assert len(bed.board.entries) == 2


@pytest.mark.long
async def test_giving_up_and_looking_again(bedside, named):
    search = Search(named)
    async with bedside(explain=search, size=(60, 20)) as bed:
        await looking(bed)
        await bed.press("delete")
        await bed.until(lambda: "Given up" in bed.text("#missing-text"))
        search.answer = named
        await bed.press("d")
        await bed.until(lambda: "deflection_offset" in bed.text("#missing-text"))
        await bed.press("b")
        await bed.on(MainScreen)


@pytest.mark.long
async def test_adopting_writes_a_model_and_goes_on_with_it(bedside, named, tmp_path):
    search = Search(named)
    search.go.set()
    async with bedside(explain=search) as bed:
        await bed.connected()
        await bed.run()
        await bed.press("d")
        await bed.until(lambda: bed.board.missing and bed.board.missing.outcome)
        await bed.until(lambda: "Missing: deflection_offset" in bed.text("#missing-text"))
        await adopt(bed)
        await bed.until(lambda: "Adopted:" in bed.text("#missing-text"))
        await bed.press("b")
        await bed.on(MainScreen)
        await bed.check()
        assert bed.board.entries == {}  # of another session: one session, one model
        await bed.until(lambda: "base with deflection_offset" in bed.text("#card-text"))
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm)
    (path,) = tmp_path.glob("*.h5")
    (model,) = tmp_path.glob("*-deflection_offset.toml")
    assert list(read_model(model).effects) == ["deflection_offset"]
    deeds = [entry.what for entry in entries(read_session(path).records)]
    assert "model adopted" in deeds


async def adopt(bed):
    await bed.press("a")
    await bed.on(ConfirmScreen)
    for words in ("deflection_offset", "X1", "→", "new session", "Ctrl+Z"):
        assert words in bed.text("#question-text")
    await bed.press(*"yes", "enter", "space")  # typing answers nothing
    assert isinstance(bed.app.screen, ConfirmScreen)
    assert bed.board.model is None
    await bed.confirm()
    await bed.until(lambda: bed.board.model == "base with deflection_offset")


@pytest.mark.long
async def test_what_was_adopted_can_be_undone(bedside, named, tmp_path):
    search = Search(named)
    search.go.set()
    async with bedside(explain=search) as bed:
        await bed.connected()
        await bed.run()
        await bed.press("d")
        await bed.until(lambda: bed.board.missing and bed.board.missing.outcome)
        await bed.press("a")
        await bed.on(ConfirmScreen)
        await bed.press("f8")
        await bed.on(MissingScreen)
        assert bed.board.model is None
        await adopt(bed)
        await bed.on(MissingScreen)
        await bed.press("ctrl+z")
        await bed.until(lambda: bed.board.model is None)
        await bed.until(lambda: "Adopted" not in bed.text("#missing-text"))
        await bed.press("b")
        await bed.on(MainScreen)
        await bed.run()
        assert len(bed.board.entries) == 2  # the session goes on, with the model of before
        assert "deflection_offset" not in str(bed.board.entry.result.parameters)
    (path,) = tmp_path.glob("*.h5")
    deeds = [entry.what for entry in entries(read_session(path).records)]
    assert deeds.index("model adopted") < deeds.index("model adoption undone")


async def test_without_a_curve_there_is_nothing_to_look_at(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("d")
        assert isinstance(bed.app.screen, MainScreen)
        assert bed.board.missing is None


@pytest.mark.long
async def test_a_search_that_fails_is_a_sentence(bedside):
    class Fails(Search):
        def __call__(self, *_):
            raise InputError("curve 1: 3 samples; expected 20 or more")

    async with bedside(explain=Fails()) as bed:
        await bed.connected()
        await bed.run()
        await bed.press("d")
        await bed.until(lambda: "expected 20 or more" in bed.text("#missing-text"))
        await bed.press("b")
        await bed.connected()


# ---- words and picture ----------------------------------------------------------------------


def plain_text(rows):
    return "\n".join("".join(text for text, _ in row) for row in rows)


def words(missing):
    return plain_text(missing_rows(missing, 80))


def test_an_outcome_in_words(named, ambiguous):
    text = plain_text(outcome_rows(named, 80))
    for part in ("Missing: deflection_offset", "Gap", "before", "after", "× noise", "X1", "ν"):
        assert part in text
    assert "times likelier than " in text  # the doubt
    assert any(f"offset {um}" in text for um in (78, 79, 80, 81, 82))
    assert " µm (" in text  # a unit with every size
    assert "curve 1, load" in text  # where
    assert "Next: a adopts" in text
    assert "log10" not in text
    for effect in all_effects():  # no name stands unexplained
        if re.search(rf"\b{effect.name}\b", text):
            assert effect.meaning in text
    assert "Next: F7 loads ramp:300@60,ramp:0@60" in plain_text(outcome_rows(ambiguous, 80))


def test_sizes_have_the_unit_that_suits_and_odds_are_round():
    assert size_words("pressure_lag.lag_s", Value(0.02313, 0.0174, 0.0281)) == "23 ms (17–28)"
    assert size_words("pressure_lag.lag_s", Value(0.7, 0.61, 0.82)) == "0.70 s (0.61–0.82)"
    assert size_words("tape_slip.slip_mm", Value(0.15, 0.12, 0.17)) == "150 µm (120–170)"
    assert size_words("natural_tension.stretch", Value(1.024, 1.022, 1.026)) == (
        "1.0240 (1.0220–1.0260)"
    )
    assert odds_words(1.3) == "20 times"
    assert odds_words(9.0) == "more than 10,000 times"


def test_shares_of_the_gap_sum_up_and_bars_are_drawn(named):
    shown = plain_text(outcome_rows(named, 80))
    assert "█" in shown
    found = {
        what: int(percent)
        for what, percent in re.findall(
            "[░▒▓█] (noise|placement|mesh|the effect) ([0-9]+) %", shown
        )
    }
    assert sum(found.values()) == pytest.approx(100, abs=2)
    assert found["the effect"] > 90  # the offset is all that was hidden


def test_what_is_known_is_said_at_every_moment(named, tmp_path):
    assert "d begins" in words(None)
    missing = Missing(("curve 1",))
    assert hints(missing) == (False, False)
    missing.stages += ["one", "two"]
    assert "  done: one" in words(missing)
    assert "two …" in words(missing)
    missing.running = False
    assert "Given up" in words(missing)
    missing.outcome = named
    assert hints(missing) == (False, True)
    missing.adopted = tmp_path
    assert hints(missing) == (False, False)
    assert words(missing).startswith(f"Adopted: {tmp_path}")


@pytest.mark.parametrize("columns", [58, 80, 160])
def test_each_curve_has_its_picture_before_and_after_on_one_scale(named, columns):
    rows = outcome_rows(named, columns)
    text = plain_text(rows)
    assert "curve 1, 6 mm" in text
    assert "before: " in text
    assert "after: " in text
    dots = {name: [t for row in rows for t, style in row if style == name] for name in
            ("before", "after")}  # fmt: skip
    # Before, dots go up to the offset; after, they are within the band
    assert sum(map(len, dots["before"])) > 0
    pictures = [row for row in rows if any("⠀" < c <= "⣿" for t, _ in row for c in t)]
    assert pictures
    assert all(sum(len(t) for t, _ in row) <= columns for row in pictures)


@pytest.mark.long
def test_the_pictures_grow_with_the_screen(named):
    small, large, huge = (len(outcome_rows(named, 160, lines)) for lines in (0, 60, 500))
    assert small < large <= huge < small + 60  # and not without end


OWN = {"natural_tension.stretch": {"value": 1.0252, "low": 1.021, "high": 1.03}}
LAG = {"pressure_lag.lag_s": {"value": 0.023, "low": 0.017, "high": 0.028}}


def of_effects(candidate, *effects):
    fit = candidate.fit
    return replace(candidate, fit=replace(fit, unknowns=replace(fit.unknowns, effects=effects)))


@pytest.fixture
def with_model(named):
    """The answer to a model with an effect of its own: what it misses is tied."""
    base = of_effects(named.found.base, "natural_tension")
    law = named.parameters(named.found.base)
    offset = {n: v for n, v in named.parameters(named.best).items() if "." in n}
    known = {("natural_tension",): {**law, **OWN}}
    known[("natural_tension", "deflection_offset")] = {**law, **OWN, **offset}
    known[("natural_tension", "pressure_lag")] = {**law, **OWN, **LAG}
    tied = [of_effects(named.best, *names) for names in list(known)[1:]]
    return replace(
        named,
        found=replace(named.found, base=base, candidates=tied),
        verdict=Verdict("ambiguous", tied),
        posteriors={names: SimpleNamespace(parameters=all_of) for names, all_of in known.items()},
    )


def test_the_size_is_of_what_is_missing_and_of_whom_is_said(with_model):
    said = [line for line in verdict_lines(with_model) if "Its size" in line]
    assert [line.partition(":")[0] for line in said] == [
        "Its size, if it is deflection_offset",
        "Its size, if it is pressure_lag",
    ]
    assert not any("natural_tension" in line for line in said)
    assert "pressure_lag lag 23 ms (17–28)" in said[1]
    first = with_model.verdict.explanations[:1]
    (alone,) = (
        line
        for line in verdict_lines(replace(with_model, verdict=Verdict("named", first)))
        if "Its size" in line
    )
    assert alone.startswith("Its size: deflection_offset")
    assert "natural_tension" not in alone
    both = of_effects(with_model.best, "natural_tension", "deflection_offset", "pressure_lag")
    sizes = {**next(iter(with_model.posteriors.values())).parameters, **LAG}
    two = replace(
        with_model,
        verdict=Verdict("named", [both]),
        posteriors={both.effects: SimpleNamespace(parameters=sizes)},
    )
    (their,) = (line for line in verdict_lines(two) if "sizes: " in line)
    assert their.startswith("Their sizes: ")


def test_the_values_of_the_models_own_effects_are_shown(with_model):
    alone = replace(with_model, verdict=Verdict("none", []))
    for outcome in (with_model, alone):
        said = ["".join(text for text, _ in row) for row in outcome_rows(outcome, 80)]
        at = next(i for i, line in enumerate(said) if line.startswith(" natural_tension stretch"))
        assert "1.025 (1.021–1.030)" in said[at + 1]
        assert not any(line.startswith(" pressure_lag lag") for line in said)  # it is missing


# ---- the model ------------------------------------------------------------------------------


def test_a_model_is_never_overwritten(named, ambiguous, table, tmp_path):
    from datetime import UTC, datetime

    now = datetime(2026, 1, 2, tzinfo=UTC)
    write = partial(write_adopted, base=BASE, folder=tmp_path, database=table, now=now)
    first, model = write(named, session=None)
    second, _ = write(named, session=None)
    assert first != second
    assert read_model(first).hash == model.hash
    with pytest.raises(InputError, match="nothing to adopt"):
        write(ambiguous, session=None)
    with pytest.raises(InputError, match="cannot be written"):
        write(named, folder=first, session=None)


# ---- the other process ----------------------------------------------------------------------


@pytest.mark.long
def test_the_real_search(table):
    stages = []
    found = Explainer()(campaign(table, UP_AND_DOWN), BASE, stages.append)
    assert found.verdict.name == "named"
    assert found.best.effects == ("deflection_offset",)
    assert any("screening" in stage for stage in stages)


def test_a_search_can_be_given_up(table):
    explainer = Explainer()
    explainer.cancel()  # there is none
    assert explainer(campaign(table, UP), BASE, lambda _: explainer.cancel()) is None


def test_a_search_that_dies_is_a_sentence(table):
    with pytest.raises(SkinlabError, match="ended without an answer"):
        Explainer(["false"])(campaign(table, UP), BASE, print)


def test_what_the_search_refuses_is_said(table):
    short = campaign(table, "ramp:100@500")
    with pytest.raises(SkinlabError, match="expected 20 or more"):
        Explainer()(short, BASE, lambda _: None)


def test_closing_ends_the_search(tmp_path, identifier):
    search = Search()
    ProbeSession(
        tmp_path, lambda _: None, make_identifier=lambda: identifier, explain=search
    ).close()
    assert search.go.is_set()
