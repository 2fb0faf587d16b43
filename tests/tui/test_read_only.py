"""An instrument that only streams, at the screen: it is waited for, and never started."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shown import AT, HELLO, NoProbe
from streaming_instrument import AT_REST, TEXT, Wire, ramp

from drivers.events import HostVented, InstrumentState, Sample, State
from drivers.line_dialect import line_dialect
from drivers.probe import Probe
from skinlab.acquisition.messages import Connected, Heard
from skinlab.acquisition.replay import differences, identifier_of, replay
from skinlab.recording.session import read_session
from skinlab.recording.stream import Happened, Identified
from skinlab.report.verdict import judge
from skinlab.tui.app import SkinlabApp
from skinlab.tui.commands import commands_for
from skinlab.tui.screens.alarm import AlarmScreen
from skinlab.tui.shown import Playing
from skinlab.tui.text import suction_text
from skinlab.tui.ui_state import Board

READ_ONLY = replace(HELLO, simulated=False, read_only=True)


def connected(hello=READ_ONLY):
    board = Board("COM99")
    board.see(Connected("COM99", hello))
    return board


def hear(board, *events):
    board.see(Heard(tuple(map(Happened, events)), AT))


# ---- what is said of suction that nothing here can end ----------------------------------------


def test_suction_is_shown_before_the_first_curve_and_behind_one():
    board = connected()
    assert suction_text(board) == "no reading yet"
    hear(board, Sample(0, 0.0, 0.2, 0.0, 0))
    assert suction_text(board) == "suction off"
    hear(board, State(InstrumentState.IDLE, "given up"), Sample(1, 0.1, 60.0, 0.4, 0))
    assert suction_text(board) == "SUCTION: end it at the instrument"
    assert board.latest.pressure_mbar == 60.0
    assert board.latest_at == AT


def test_a_vent_command_that_may_not_work_is_not_called_vented():
    board = connected()
    hear(board, HostVented("operator"))
    assert board.note == "a vent was asked for, and may not work: watch the pressure"


def test_who_gave_the_curve_up_is_said():
    assert "given up by the operator" in judge(None, [], "operator", partial=True).words


def test_the_palette_offers_what_there_is():
    board = connected(HELLO)
    assert ("v", "Vent") in [(c.key, c.words) for c in commands_for(board)]
    assert ("v", "Give the curve up") in [(c.key, c.words) for c in commands_for(connected())]
    board.playing = Playing()
    keys = {command.key for command in commands_for(board)}
    assert "s" in keys
    assert not keys & {"v", "F2", "F3", "F4", "F6", "F7", "Ins", "g", "p"}


async def test_no_screen_promises_a_vent(tmp_path):
    app = SkinlabApp("COM99", tmp_path, NoProbe)
    async with app.run_test(size=(80, 24)) as pilot:
        app.post(Connected("COM99", READ_ONLY))
        app.post(Heard((Happened(Sample(0, 0.0, 60.0, 0.4, 0)),), AT))
        await pilot.pause()
        vents = [a.binding for k, a in app.screen.active_bindings.items() if k == "v"]
        assert [binding.description for binding in vents] == ["Give up"]
        suction = app.screen.query_one("#suction")
        assert suction.content_size.width >= len("SUCTION: end it at the instrument")
        await pilot.press("q")
        await pilot.pause()
        assert "is not vented from here" in str(app.screen.query_one("#question-text").render())
    alarm = AlarmScreen(app.board, app.guard, "too much")
    assert [words for words, _ in alarm._keys] == ["F9 acknowledges"]


# ---- a curve ----------------------------------------------------------------------------------


async def test_a_session_is_saved_while_the_readings_go_on(bedside, tmp_path):
    """It waited for a silence that never came: after a crash there was the journal alone."""
    wire = Wire()
    wire.endless = True

    def make_probe(port, **arguments):
        dialect = line_dialect(TEXT, "plain.toml")
        return Probe(port, dialect=dialect, open_link=wire.open, **arguments)

    async with bedside("COM99", make_probe=make_probe) as bed:
        await bed.connected()
        await bed.fill("program", "ramp:60@20,ramp:0@20")
        await bed.check()
        await bed.press("f9")
        await bed.until(lambda: bed.board.phase == "WAITING")
        up = ramp(60.0)
        wire.put(up + up[-2::-1])
        await bed.until(lambda: bed.board.entry and bed.board.entry.result)
        await bed.until(lambda: list(tmp_path.glob("*.h5")))
        (path,) = tmp_path.glob("*.h5")
        assert len(read_session(path).curves) == 1
        await bed.quit()


@pytest.mark.long
async def test_a_curve_that_somebody_starts(bedside, session_files):
    wire = Wire()

    def make_probe(port, **arguments):
        dialect = line_dialect(TEXT, "plain.toml")
        return Probe(port, dialect=dialect, open_link=wire.open, **arguments)

    async with bedside("COM99", make_probe=make_probe) as bed:
        await bed.connected()
        await bed.until(lambda: "not under our control" in bed.text("#banner"))
        await bed.fill("program", "ramp:60@20,ramp:0@20")
        await bed.check()
        assert "waits for you to start the instrument" in bed.board.note
        await bed.press("f9")
        await bed.until(lambda: bed.board.phase == "WAITING")
        assert not bed.board.suction
        up = ramp(60.0)
        wire.put([0.0] * AT_REST + up)
        await bed.until(lambda: bed.board.live is not None)
        await bed.until(lambda: "end it at the instrument" in bed.text("#suction"))
        assert bed.board.note == ""  # no word of starting it any more
        assert bed.board.suction
        wire.put(up[-2::-1] + [0.0] * AT_REST)
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
        assert bed.board.entry.cut is None
        assert bed.board.entry.curve.pressure_mbar.max() == 60.0

        await bed.start()  # and give it up while it is waited for
        await bed.until(lambda: bed.board.phase == "WAITING")
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm)
        await bed.quit()
    assert wire.sent == []
    (path,) = session_files()
    session = read_session(path)
    assert session.meta["dialect"]["toml"] == TEXT
    results = []
    identifier = identifier_of(session)[0]
    curves = replay(
        session,
        identifier,
        [lambda m: results.append(m.result) if isinstance(m, Identified) else 0],
    )
    assert len(curves) == 1
    assert differences(session, curves, results) == []
