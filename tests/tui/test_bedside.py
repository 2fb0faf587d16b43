"""What the screen says of a visit: counted loadings, doses, honest numbers, messages, keys."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shown import entry_of
from textual import events

from drivers.events import Hello, InstrumentState, Sample, State
from drivers.probe import Probe
from skinlab.acquisition.measurement_messages import Phase, Plan
from skinlab.acquisition.messages import Connected, Done, Heard, Over, Went
from skinlab.curves.curve import Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.program import parse_program
from skinlab.inference.result import Identification
from skinlab.quality.gates.base import Finding
from skinlab.recording.session import example_session, read_session
from skinlab.recording.stream import (
    CurveCompleted,
    CurveStarted,
    Flagged,
    Happened,
    Identified,
    Sampled,
)
from skinlab.report.verdict import FOR_EFFECT, Use
from skinlab.tui.card_text import verdict_text
from skinlab.tui.shown import Playing
from skinlab.tui.summary import Repeats, left_out, repeats, repeats_lines
from skinlab.tui.text import dose_text, where_text
from skinlab.tui.ui_state import Board, Level
from skinlab.tui.widgets.card import Card
from skinlab.tui.widgets.curve_plot import CurvePlot
from skinlab.tui.widgets.curves import Curves

HELLO = Hello("reference", 1, "rig", "1.0", "7", 6.0, 500.0, 60.0, 1.0, 1000.0, simulated=False)
SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))


def connected_board():
    board = Board("p")
    board.see(Connected("p", HELLO))
    return board


def load(board, who, seconds=5.0, mbar=50.0, index=1):
    """One loading of a site: a second of suction at each of several samples."""
    board.visit = who
    growing = GrowingCurve(SETUP)
    board.see(Heard((CurveStarted(index, growing), Happened(State(InstrumentState.RUNNING, "")))))
    for k in range(int(seconds) + 1):
        sample = Sample(k, float(k), mbar, 0.1, 0)
        growing.append(sample)
        board.see(Heard((Sampled(index, sample),)))
    board.live = None


async def begin_visit(bed, subject):
    """Measure once for another subject than before."""
    await bed.fill("subject", subject)
    await bed.check()
    assert not bed.board.entries
    await bed.press("f9")
    await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)


# ---- loadings and dose ----------------------------------------


@pytest.mark.long
async def test_loadings_are_counted_for_each_site(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        cycle = bed.app.screen.query_one("#cycle")
        await bed.fill("subject", "P01")
        await bed.run()
        await bed.run()
        await bed.check()
        assert "loading  3 of this site" in bed.text("#card-text")
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm and bed.board.review is None)
        await bed.fill("subject", "P02")
        await bed.until(lambda: cycle.value == "1")
        await begin_visit(bed, "P02")
        await bed.fill("subject", "P01")
        await bed.until(lambda: cycle.value == "3")  # in another session of the same program, too
        await bed.press("f6")
        await bed.until(lambda: cycle.value == "1")
        await bed.check()
        assert "loading  1 of this site (as you say: 3 by count)" in bed.text("#card-text")
        await bed.press("f9")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
        await bed.until(lambda: cycle.value == "2")
        await bed.quit()
    loadings = [[c.setup.cycle for c in read_session(p).curves] for p in session_files()]
    assert loadings == [[1, 2], [1], [1]]


@pytest.mark.long
async def test_the_dose_of_a_site_goes_on_in_its_next_session(bedside):
    probes = []

    def make_probe(*arguments, **options):
        probes.append(Probe(*arguments, **options))
        return probes[-1]

    async with bedside(make_probe=make_probe) as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.run()
        once = bed.board.dose.suction_mbar_s
        await begin_visit(bed, "P02")
        await begin_visit(bed, "P01")
        assert bed.board.dose.suction_mbar_s > 1.9 * once
        assert probes[-1].dose.suction_mbar_s > 1.9 * once  # which the limit is held to
        await bed.quit()


def test_a_dose_and_a_count_belong_to_a_site():
    board = connected_board()
    load(board, ("P01", "arm"))
    board.name(("P01", "arm"))
    assert board.next_cycle == 2
    assert dose_text(board.dose) == "250 mbar·s in 5 s"
    board.name(("P01", "leg"))
    assert board.next_cycle == 1


def test_the_dose_stays_in_the_header_where_the_rest_has_no_room():
    board = connected_board()
    load(board, ("P01", "forearm, volar"))
    board.name(("P01", "forearm, volar"))
    assert "250 mbar·s in 5 s" in where_text(board, 48)
    assert "rig" not in where_text(board, 48)
    assert "rig" in where_text(board, 120)


# ---- honest numbers ----------------------------------------


def test_only_what_is_alike_is_averaged():
    entries = [entry_of(number) for number in range(1, 6)]
    entries[1].cut = "vented"
    last = entries[-1].curve
    entries[-1].curve = replace(last, setup=replace(last.setup, cycle=2))  # a later loading
    (group,) = repeats(entries, {})
    assert group.curves == (1, 3, 4), left_out(entries, {})
    assert group.first
    out = left_out(entries, {3: "moved"})
    assert out == {2: "cut short", 3: "moved"}
    assert group.mean.keys() == {"X1_MPa", "X2_MPa"}  # no mean over what no curve fixes
    text = "\n".join(repeats_lines([group], out))
    assert "first loadings" in text
    assert "Curve 2 is in no mean: cut short" in text
    assert "ν: no mean, curves 1, 3, 4 do not fix it; j fits them together" in text
    again = [entry_of(number) for number in (6, 7)]
    for entry in again:
        entry.curve = replace(entry.curve, setup=replace(entry.curve.setup, cycle=2))
    text = "\n".join(repeats_lines(repeats([entries[0], *again], {})))
    assert text.endswith("ν: no mean, curves 6, 7 do not fix it")  # j leaves later loadings out
    assert "j fits them together" in "\n".join(repeats_lines(repeats(again, {})))


def test_a_mean_without_scatter_keeps_its_digits():
    same = Repeats(6.0, "ramp:100@20", True, (1, 2), {"X1_MPa": 0.02464}, {"X1_MPa": 0.0})
    assert "X1 0.0246 ± 0.0000 MPa (0 %)" in repeats_lines([same])[1]


def test_what_tells_explanations_apart_is_not_scolded_for_its_few_samples():
    board = connected_board()
    curve = entry_of(1).curve
    board.advise(curve.setup.aperture_mm, str(curve.setup.program))
    few = Finding("too_few_points", "the first loading has 5 samples", "use a slower ramp")
    unknown = Identification("curve 1", curve.setup, "too few samples")
    growing = CurveStarted(1, GrowingCurve(curve.setup))
    for news in (growing, Flagged(1, few), CurveCompleted(1, curve, None, 0), Flagged(1, few)):
        board.see(Heard((news,)))
    board.see(Heard((Identified(1, curve, unknown),)))
    (entry,) = board.entries.values()
    assert entry.verdict.words == f"Good curve: {FOR_EFFECT}"
    assert verdict_text(board).following.startswith("d, then d again")
    assert left_out([entry], {}) == {1: FOR_EFFECT}
    entry.result = replace(entry_of(1).result, flags=("at_bound:X1_MPa",))
    assert entry.verdict.why == FOR_EFFECT
    board.entries[1].for_effect = False  # the same, not asked for
    assert entry.verdict.use is Use.NOT


def test_a_replay_knows_what_was_measured_for_a_missing_effect():
    board = Board("s.h5")
    board.playing = Playing()
    board.see(Connected("s.h5", HELLO, for_effect=frozenset({"curve 2"})))
    for number in (1, 2):
        curve = entry_of(number).curve
        few = Finding("too_few_points", "the first loading has 5 samples", "use a slower ramp")
        growing = CurveStarted(number, GrowingCurve(curve.setup))
        for news in (growing, Flagged(number, few), CurveCompleted(number, curve, None, 0)):
            board.see(Heard((news,)))
    assert [len(e.findings) for e in board.entries.values()] == [1, 0]
    assert [e.for_effect for e in board.entries.values()] == [False, True]


@pytest.mark.parametrize(
    ("name", "mean", "sd", "said"),
    [
        ("natural_tension.stretch", 1.0252, 0.0004, "stretch 1.0252 ± 0.0004 (2 %)"),
        ("natural_tension.stretch", 1.0002, 0.0011, "stretch 1.000 ± 0.001"),  # no effect
        ("nu", 0.0, 0.0, "ν 0.00 ± 0.00"),
    ],
)
def test_scatter_is_of_what_differs_from_no_effect(name, mean, sd, said):
    group = Repeats(6.0, "mode1", True, (1, 2), {name: mean}, {name: sd})
    assert repeats_lines([group])[1].endswith(said)


@pytest.mark.long
async def test_changed_says_what_could_have_been_shown(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("program", "ramp:100@20,ramp:0@50")  # as in the example
        await bed.run()
        await bed.press("s")
        await bed.until(lambda: bed.app.screen.query("#session-text"))
        await bed.press("c")
        await bed.until(lambda: bed.app.focused.id == "session-line")
        bed.app.focused.value = str(example_session())
        await bed.press("enter")
        await bed.until(lambda: "Changed since example.h5" in bed.text("#session-text"))
        text = bed.text("#session-text")
        assert "the smallest change that could have been shown is" in text
        assert "scatter of placements" in text
        assert "probability" not in text


# ---- the verdict ----------------------------------------


@pytest.mark.long
async def test_the_verdict_says_what_is_wrong_and_the_next_step(bedside):
    async with bedside(size=(60, 20)) as bed:
        await bed.connected()
        first = "Next: F8 shows what will happen, F9 then starts it"
        await bed.until(lambda: bed.text("#verdict-next") == first)
        await bed.run()
        await bed.until(lambda: bed.text("#verdict-words").startswith("✔ Good curve"))
        bed.board.entry.findings.append(Finding("leak", "the pressure falls", "press evenly"))
        bed.board.touch()
        await bed.until(lambda: bed.text("#verdict-words") == "↻ Repeat: the pressure falls")
        assert bed.text("#verdict-next") == "Next: press evenly; then F8"
        bed.board.entry.findings[:] = [Finding("saturated", "it stays", "go lower")]
        bed.board.touch()
        await bed.until(lambda: bed.text("#verdict-words") == "✘ Do not use: it stays")
        region = bed.app.screen.query_one("#verdict").region
        assert bed.app.screen.region.contains_region(region)


@pytest.mark.long
async def test_earlier_repeats_are_behind_the_curve(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.run()
        await bed.run()
        plot = bed.app.screen.query_one(CurvePlot)
        await bed.until(lambda: len(plot.drawn_layers.earlier) == 1)
        await bed.fill("program", "ramp:60@20")
        await bed.run()
        await bed.until(lambda: not plot.drawn_layers.earlier)  # measured otherwise


@pytest.mark.long
async def test_the_second_card_has_the_numbers_of_a_step(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("program", "mode1:100,2,1")
        await bed.run()
        await bed.press("r")
        await bed.until(lambda: "R0–R9" in bed.text("#card-title"))
        card = bed.text("#card-text")
        assert "Ue " in card
        assert "R2 " in card
        assert "R3  -  needs several pulses" in card
        await bed.press("r")
        await bed.until(lambda: "R0–R9" not in bed.text("#card-title"))


# ---- messages, redraw, keys ----------------------------------------


def test_messages_end_and_can_be_read_again():
    board = Board("p")
    board.say(Level.INFO, "saved")
    board.tick(1.0)
    board.tick(2.0)
    assert board.note == "saved"
    board.tick(60.0)
    assert board.note == ""
    assert ("saved", Level.INFO) in board.told
    board.say(Level.WARNING, "look")
    board.tick(61.0)
    board.tick(90.0)
    assert board.note == "look"  # what matters more stays longer
    board.tick(200.0)
    assert board.note == ""


def test_what_takes_longer_is_named():
    board = Board("p")
    board.tick(10.0)
    board.compute("fitting")
    board.tick(10.1)
    assert board.busy == ""
    board.tick(10.6)
    assert board.busy == "fitting together"
    assert "fitting together …" in where_text(board)
    board.see(Done("fitting"))
    assert board.busy == ""


def test_the_rest_between_repeats_is_counted_down():
    board = connected_board()
    board.tick(100.0)
    board.see(Went(Phase.RESTING, Plan(SETUP, 2, 30.0), 29.5))
    assert verdict_text(board).words == "Resting: next repeat in 30 s"
    board.tick(112.0)
    assert board.rest_left_s == 18
    assert "v ends it" in verdict_text(board).following
    board.see(Went(Phase.ARMING, Plan(SETUP, 1, 30.0)))
    assert board.rest_left_s is None


async def test_no_key_is_silent(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("x")
        await bed.until(lambda: bed.board.aside == "x: no meaning here; ? lists the keys")
        await bed.press("f11")
        await bed.until(lambda: bed.board.aside == "F11: no meaning here; ? lists the keys")


@pytest.mark.long
async def test_everything_is_drawn_again_in_another_size_and_theme(bedside):
    async with bedside(size=(80, 24)) as bed:
        await bed.connected()
        await bed.run()
        plot, strip = bed.app.screen.query_one(CurvePlot), bed.app.screen.query_one("#strip")
        await bed.until(lambda: "● measured" in str(plot.render()))
        lines = str(plot.render()).splitlines()
        residual = str(strip.render())
        await bed.pilot.resize_terminal(140, 40)
        await bed.until(lambda: len(str(plot.render()).splitlines()) > len(lines))
        await bed.until(lambda: str(strip.render()) != residual)
        await bed.until(lambda: "X1" in bed.text("#intervals-text"))  # room that is used
        before = bed.screenshot()
        await bed.press("t")
        await bed.until(lambda: bed.screenshot() != before)


@pytest.mark.long
async def test_what_does_not_fit_can_be_scrolled_by_keys_and_says_so(bedside):
    async with bedside(size=(60, 20)) as bed:
        await bed.connected()
        await bed.run()
        card, curves = bed.app.screen.query_one(Card), bed.app.screen.query_one(Curves)
        await bed.until(lambda: "▼ PgDn" in bed.text("#card-title"))
        await bed.press_until(lambda: card.scroll_offset.y == card.max_scroll_y > 0, "pagedown")
        await bed.until(lambda: "▼" not in bed.text("#card-title"))
        await bed.press_until(lambda: "▼ PgDn" in bed.text("#card-title"), "pageup")
        await bed.press_until(lambda: curves.scroll_offset.x > 0, "right")


def test_a_vent_before_the_first_reading_says_that_there_is_no_curve():
    board = connected_board()
    for phase in (Phase.ARMING, Phase.STARTING):
        board.see(Went(phase, Plan(SETUP)))
    board.see(Over("operator; the probe was told to vent", 1))
    assert board.note == "vented, before the first reading: nothing to keep"
    board.see(Went(Phase.ARMING, Plan(SETUP)))
    load(board, ("P01", "arm"))
    board.answer(Level.INFO, "")
    board.see(Over("operator; the probe was told to vent", 1))
    assert board.note == ""


async def test_f8_waits_for_the_letters_that_were_typed_before_it(bedside):
    async with bedside() as bed:
        await bed.connected()
        bed.app.screen.set_focus(bed.app.screen.query_one("#subject"))
        for key in [*"subject-17", "f8"]:
            bed.app.post_message(events.Key(key, key if len(key) == 1 else None))
        await bed.until(lambda: bed.board.review)
        assert bed.board.review.order.subject == "subject-17"
