"""What an operator does, from the first minute to a comparison, by keys."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest
from textual.widgets import Input

from drivers.link import PortInfo
from skinlab.acquisition.replayer import Replayer
from skinlab.recording.session import example_session, read_session
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.screens.welcome import WelcomeScreen
from skinlab.tui.widgets.curves import Curves

SLOW = "sim://?seed=1&speed=5"
LONG = "ramp:100@2"


async def session_screen(bed):
    await bed.press("s")
    await bed.on(SessionScreen)
    await bed.until(lambda: bed.app.screen.query("#session-text"))


# ---- repeats ----------------------------------------


@pytest.mark.long
async def test_repeats_follow_by_themselves(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("repeats", "3")
        await bed.fill("rest_s", "0")
        await bed.check()
        await bed.until(lambda: "repeats  3" in bed.text("#card-text"))
        await bed.press("f9")
        await bed.until(lambda: len(bed.board.entries) == 3 and bed.board.series is None)
        await bed.until(lambda: bed.board.can_arm)
        await session_screen(bed)
        await bed.until(lambda: "Curves 2, 3" in bed.text("#session-text"))
        assert "later loadings" in bed.text("#session-text")  # the first is not averaged with them
        assert "±" in bed.text("#session-text")
    (path,) = session_files()
    setups = [curve.setup for curve in read_session(path).curves]
    assert [(s.cycle, s.repeat) for s in setups] == [(1, 1), (2, 2), (3, 3)]


@pytest.mark.long
async def test_a_vent_during_the_rest_ends_the_repeats(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("repeats", "2")
        await bed.fill("rest_s", "3600")
        await bed.start()
        await bed.until(lambda: bed.board.phase == "RESTING")
        await bed.press("tab", "x")
        assert not isinstance(bed.app.focused, Input)
        await bed.press("v")
        await bed.until(lambda: bed.board.series is None)
        await bed.connected()
        assert len(bed.board.entries) == 1
        await bed.until(lambda: "vented" in bed.board.note)


@pytest.mark.long
async def test_a_vent_in_a_repeat_ends_the_repeats(bedside):
    async with bedside(SLOW) as bed:
        await bed.connected()
        await bed.fill("program", LONG)
        await bed.fill("repeats", "2")
        await bed.fill("rest_s", "0")
        await bed.start()
        await bed.until(lambda: bed.board.live and len(bed.board.live.curve) > 20)
        await bed.press("escape")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
        assert bed.board.series is None
        assert bed.board.entry.curve.partial


# ---- settings ----------------------------------------


@pytest.mark.long
async def test_the_last_settings_come_back_but_not_the_person(bedside, tmp_path):
    kept = tmp_path / "config" / "ui.json"
    async with bedside(settings=kept) as bed:
        await bed.connected()
        for field, text in (("subject", "P07"), ("site", "arm"), ("thickness_mm", "1.3")):
            await bed.fill(field, text)
        await bed.fill("program", "mode2:50@20")
        await bed.fill("thickness_sd_mm", "0.1")
        await bed.check()
        await bed.until(lambda: "1.3 ± 0.1 mm" in bed.text("#card-text"))
        await bed.press("v")
    async with bedside(settings=kept) as bed:
        await bed.connected()
        values = {str(f.id): f.value for f in bed.app.screen.query(Input)}
        assert values["program"] == "mode2:50@20"
        assert values["thickness_mm"] == "1.0"  # that was of P07's arm
        assert values["subject"] == values["site"] == values["thickness_sd_mm"] == ""
    kept.write_text('{"program": "ramp:9999@1", "thickness_mm": 3, "rest_s": "7"}')
    async with bedside(settings=kept) as bed:
        await bed.connected()
        assert bed.app.screen.query_one("#program", Input).value == "ramp:100@20"
        assert bed.app.screen.query_one("#rest_s", Input).value == "7"


@pytest.mark.long
async def test_f3_goes_to_the_settings_and_back(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.run()
        await bed.until(lambda: not bed.app.screen.query_one("#fields").display)
        await bed.press("f3")
        await bed.until(lambda: bed.app.screen.query_one("#fields").display)
        await bed.until(lambda: bed.app.screen.query_one("#program").has_focus)
        await bed.press("f3")
        await bed.until(lambda: not bed.app.screen.query_one("#fields").display)


# ---- whose result it is ----------------------------------------


@pytest.mark.long
async def test_a_thickness_belongs_to_a_subject_and_a_site(bedside):
    async with bedside() as bed:
        await bed.connected()
        thickness = bed.app.screen.query_one("#thickness_mm", Input)
        await bed.fill("thickness_mm", "1.3")  # typed before the name: of whoever comes
        await bed.fill("subject", "P01")
        await bed.fill("site", "arm")
        assert thickness.value == "1.3"
        await bed.run()
        await bed.fill("subject", "P02")
        await bed.until(lambda: thickness.value == "1.0")
        await bed.check()
        assert "default, not measured" in bed.text("#card-text")
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm and bed.board.review is None)
        await bed.fill("thickness_mm", "0.8")
        await bed.check()
        assert "default" not in bed.text("#card-text")
        await bed.press("f9")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
        await bed.fill("subject", "P01")
        await bed.until(lambda: thickness.value == "1.3")
        await bed.fill("site", "leg")
        await bed.until(lambda: thickness.value == "1.0")
        await bed.fill("subject", "P02")
        await bed.fill("site", "arm")
        await bed.until(lambda: thickness.value == "0.8")


@pytest.mark.long
async def test_without_a_subject_it_asks_once(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("f8")
        await bed.until(lambda: "whose skin" in bed.board.note)
        assert bed.board.review is None
        await bed.until(lambda: bed.app.screen.query_one("#subject").has_focus)
        await bed.run()  # F8 again goes on without
        assert bed.board.entry.visit == ("", "")
        await bed.press("f8")
        await bed.until(lambda: bed.board.review)  # not asked again
        await bed.until(lambda: "NONE GIVEN" in bed.text("#card-text"))


@pytest.mark.long
async def test_card_rows_and_header_say_whose_and_when(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("subject", "P07")
        await bed.fill("site", "forearm")
        await bed.run()
        at = f"{bed.board.entry.at:%H:%M}"
        await bed.until(lambda: "P07, forearm" in bed.text("#card-text"))
        assert at in bed.text("#card-title")
        assert bed.app.screen.query_one(Curves).get_row_at(0)[1:3] == ["P07, forearm", at]
        await bed.until(lambda: bed.text("#where").startswith("P07, forearm  "))
        await session_screen(bed)
        await bed.until(lambda: "P07, forearm, since" in bed.text("#session-title"))


@pytest.mark.long
async def test_a_replay_says_whose_and_when_it_was(bedside):
    async with bedside(None, replay=example_session(), speed=None) as bed:
        await bed.until(lambda: bed.board.phase == "ENDED")
        created = datetime.fromisoformat(read_session(example_session()).meta["created_utc"])
        assert all(e.visit == ("SIM-1", "simulated forearm") for e in bed.board.entries.values())
        assert all(abs((e.at - created).total_seconds()) < 120 for e in bed.board.entries.values())
        await bed.until(lambda: "SIM-1, simulated forearm" in bed.text("#where"))


# ---- live ----------------------------------------


@pytest.mark.long
async def test_what_is_not_of_now_says_when_it_was(bedside):
    async with bedside(SLOW) as bed:
        await bed.connected()
        assert "mbar" not in bed.text("#reading-line")  # nothing was read yet
        await bed.fill("program", LONG)
        await bed.start()
        await bed.until(lambda: "mbar" in bed.text("#reading-line"))
        assert "last" not in bed.text("#reading-line")
        # Of a run with a few samples no curve would be left
        await bed.until(lambda: bed.board.live and len(bed.board.live.curve) > 20)
        await bed.press("v")
        await bed.until(lambda: bed.board.entry and bed.board.can_arm)
        await bed.until(lambda: bed.text("#reading-line").strip().startswith("last: "))
        assert f"mm, {bed.board.latest_at:%H:%M}" in bed.text("#reading-line")


@pytest.mark.long
@pytest.mark.parametrize("size", [(60, 20), (80, 24)])
async def test_the_estimate_forms_in_grey_and_a_vent_ends_the_ramp(bedside, size, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    async with bedside(SLOW, size=size) as bed:
        await bed.connected()
        await bed.fill("program", LONG)
        await bed.start()
        await bed.until(lambda: "so far" in bed.text("#card-title"))
        await bed.until(lambda: "X1" in bed.text("#card-text"))
        await bed.until(lambda: bed.app.screen.query_one("#card").has_class("-forming"))
        await bed.until(lambda: "Hz" in bed.text("#reading-line"))
        await bed.until(lambda: "dotted" in bed.text("#strip"))
        await bed.press("v")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
        await bed.until(lambda: "residual" in bed.text("#strip"))
        await bed.until(lambda: not bed.app.screen.query_one("#card").has_class("-forming"))
        await bed.until(lambda: "Vent" in bed.screenshot())


# ---- the session ----------------------------------------


@pytest.mark.long
async def test_excluding_noting_fitting_and_undoing(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        await bed.run()
        await bed.press("f6")  # the site has rested: both are first loadings
        await bed.run()
        await session_screen(bed)
        await bed.press("delete")
        await bed.until(lambda: isinstance(bed.app.focused, Input))
        assert bed.board.note == "why is curve 1 left out? Enter answers, F8 cancels"
        await bed.press("enter")  # no answer: the question stays
        await bed.until(lambda: "type an answer" in bed.board.note)
        await bed.press(*"bad", "tab", "enter")
        await bed.until(lambda: bed.board.ledger.excluded)
        (number,) = bed.board.ledger.excluded
        assert bed.board.ledger.excluded[number] == "bad"
        await bed.press("u", "x")  # letters only look
        assert bed.board.ledger.excluded
        await bed.press("ctrl+z")
        await bed.until(lambda: not bed.board.ledger.excluded)
        await bed.press("n")
        await bed.until(lambda: isinstance(bed.app.focused, Input))
        await bed.press(*"vj", "enter")
        await bed.until(lambda: "Note: vj" in bed.text("#session-text"))
        assert bed.app.bench.vents == 0  # that v was text
        await bed.press("j")
        await bed.until(lambda: "Together (curve 1, curve 2)" in bed.text("#session-text"))
        await bed.press("v")
        await bed.until(lambda: bed.app.bench.vents == 1)
        await bed.press("s")
        await bed.until(lambda: bed.app.screen is bed.app.screen_stack[0])
    (path,) = session_files()
    from skinlab.recording.audit import entries

    session = read_session(path)
    deeds = [(e.what, e.detail.get("curve")) for e in entries(session.records)]
    assert ("curve excluded", number) in deeds
    assert ("curve included", number) in deeds
    assert ("note", None) in deeds
    assert len(session.curves) == 2


async def test_what_cannot_be_recorded_does_not_stay_on_the_screen(bedside):
    """A curve was left out here, and counted everywhere else."""
    async with bedside() as bed:
        await bed.connected()
        await session_screen(bed)
        await bed.press("n")
        await bed.until(lambda: isinstance(bed.app.focused, Input))
        await bed.press(*"red", "enter")
        await bed.until(lambda: "there is no session to keep this in" in bed.board.note)
        assert not bed.board.ledger.notes
        assert bed.board.ledger.undo() is None


@pytest.mark.long
async def test_comparing_with_an_earlier_session(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.run()
        await session_screen(bed)
        await bed.press("c")
        await bed.until(lambda: isinstance(bed.app.focused, Input))
        bed.app.focused.value = "/no/such/file.h5"
        await bed.press("enter")
        await bed.until(lambda: "no such file" in bed.board.note)


# ---- replay, and the first minute ----------------------------------------


@pytest.mark.long
async def test_a_replay_plays_pauses_steps_and_ends(bedside):
    async with bedside(None, replay=example_session()) as bed:
        board = bed.board
        await bed.until(lambda: board.phase == "REPLAY" and board.live)
        await bed.press("space")
        await bed.until(lambda: board.phase == "PAUSED")
        await bed.until(lambda: "x1" in bed.text("#reading-line"))
        control = bed.app.bench.control
        before = len(board.live.curve)
        await bed.press("full_stop")
        await bed.until(lambda: len(board.live.curve) > before)
        await bed.press("enter", "f2", "f8", "f9")  # nothing can be started
        assert board.order is None
        assert board.review is None
        await bed.press("plus")
        await bed.until(lambda: control.speed == 2.0)
        await bed.press("minus", "minus")
        await bed.until(lambda: control.speed == 0.5)
        while control.speed is not None:
            await bed.press("plus")
        await bed.press("space")
        await bed.until(lambda: board.phase == "ENDED")
        assert len(board.entries) == 2
        assert all(entry.result.parameters for entry in board.entries.values())
        await bed.press("v")
        await bed.until(lambda: "nothing is vented" in board.note)
        await session_screen(bed)
        await bed.press("n")
        await bed.until(lambda: isinstance(bed.app.focused, Input))
        await bed.press("x", "enter")
        await bed.until(lambda: "replay" in board.note)
        await bed.press("s")
        await bed.quit()


@pytest.mark.long
async def test_the_replayed_results_are_those_of_the_session(bedside):
    stored = read_session(example_session()).results
    async with bedside(None, replay=example_session(), speed=None) as bed:
        await bed.until(lambda: bed.board.phase == "ENDED")
        for entry, result in zip(bed.board.entries.values(), stored, strict=True):
            assert entry.result.parameters["X1_MPa"].value == pytest.approx(
                result["parameters"]["X1_MPa"]["value"], rel=1e-6
            )


async def test_a_damaged_record_is_a_sentence(bedside, tmp_path):
    bad = tmp_path / "bad.h5"
    bad.write_bytes(b"no session")
    async with bedside(None, replay=bad) as bed:
        await bed.until(lambda: "bad.h5" in bed.board.note)
        assert "Traceback" not in bed.screenshot()
        await bed.quit()


def offers(bed, *words):
    shown = bed.screenshot().replace("&#160;", " ")
    return all(word in shown for word in words)


@pytest.mark.long
async def test_without_a_port_it_offers_what_there_is(bedside):
    def ports():
        return (PortInfo("/dev/ttyX9", "a bench probe"),)

    async with bedside(None, ports=ports, size=(60, 20)) as bed:
        await bed.on(WelcomeScreen)
        await bed.until(lambda: offers(bed, "Simulated probe", "Recorded example", "/dev/ttyX9"))
        await bed.press("down", "enter")
        await bed.until(lambda: isinstance(bed.app.bench, Replayer) and bed.board.live)
        await bed.until(lambda: "replay of" in bed.text("#where"))
        await bed.until(lambda: "1 mm of skin, ramp:100@20" in bed.text("#settings-line"))


async def test_the_simulated_probe_is_one_key_away(bedside):
    async with bedside(None, ports=tuple) as bed:
        await bed.on(WelcomeScreen)
        # The tour; in a lower window than this there is no room for it
        await bed.until(lambda: offers(bed, "F9     starts it", "v      vents, always"))
        await bed.press("enter")
        await bed.connected()
        assert bed.board.hello.simulated


def test_the_example_is_small_and_simulated():
    path: Path = example_session()
    assert path.stat().st_size < 100_000
    session = read_session(path)
    assert session.meta["instrument"]["simulated"] is True
    assert len(session.curves) == 2
