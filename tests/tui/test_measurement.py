from __future__ import annotations

import shutil
from datetime import datetime, timedelta

import numpy as np
import pytest

from drivers.events import InstrumentState
from skinlab.acquisition.replay import differences, identifier_of, replay
from skinlab.recording.session import example_session, read_session
from skinlab.recording.stream import Identified
from skinlab.tui.card_text import card_text
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.curve_plot import CurvePlot
from skinlab.tui.widgets.curves import Curves

# 50 s of the probe, 10 s here: long enough for any machine, and never waited for
LONG = "ramp:100@2"
SLOW = "sim://?seed=1&speed=5"


def replayed(session):
    results = []

    def keep(message):
        if isinstance(message, Identified):
            results.append(message.result)

    curves = replay(session, identifier_of(session)[0], [keep])
    return differences(session, curves, results)


async def test_whole_measurement_from_arming_to_replay(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        await bed.until(lambda: "SIMULATED" in bed.text("#banner"))
        await bed.type("subject", "P07")
        await bed.check()
        assert bed.app.screen.query_one("#program").disabled is False  # its parent is
        assert not bed.app.screen.query_one("#program").focusable
        await bed.until(lambda: "up to 100 mbar, 5 s under suction" in bed.text("#card-text"))
        await bed.until(lambda: "ramp:100@20" in bed.text("#card-text"))
        await bed.press("f9")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result)
        await bed.until(lambda: "100 of 100 points fitted" in bed.text("#card-text"))
        card = bed.text("#card-text")
        for word in ("X1", "X2", "ν", "ν of linear", "MPa", "rms"):
            assert word in card
        plot, curves = bed.app.screen.query_one(CurvePlot), bed.app.screen.query_one(Curves)
        await bed.until(lambda: plot.drawn_layers.fitted is not None)
        await bed.until(lambda: "● measured" in str(plot.render()))
        await bed.until(lambda: "── fitted" in str(plot.render()))
        await bed.until(lambda: "Good curve" in bed.text("#verdict-words"))
        await bed.until(lambda: bed.text("#verdict-next").startswith("Next: "))
        await bed.until(lambda: curves.row_count == 1)
        assert curves.get_row_at(0)[:2] == ["1", "P07"]
        await bed.until(lambda: curves.get_row_at(0)[3:6] == ["good", "6", "1"])
        assert curves.get_row_at(0)[9] == "ramp:100@20"
        # On disk before anybody quits
        await bed.until(lambda: bed.board.saved is not None)
        early = read_session(bed.board.saved)
        assert early.results[0]["parameters"] is not None
        await bed.quit()
    (path,) = session_files()
    session = read_session(path)
    assert session.meta["subject"] == "P07"
    assert session.meta["instrument"]["simulated"] is True
    assert len(session.curves) == len(session.results) == 1
    assert not session.curves[0].partial
    assert replayed(session) == []


@pytest.mark.long
async def test_the_curve_is_drawn_as_its_points_arrive(bedside):
    async with bedside(SLOW) as bed:
        await bed.connected()
        await bed.fill("program", LONG)
        await bed.start()
        plot = bed.app.screen.query_one(CurvePlot)
        for points in (10, 40, 80):
            await bed.until(
                lambda n=points: plot.drawn_layers.points and len(plot.drawn_layers.points) > n
            )
            assert bed.board.live is not None
            await bed.until(lambda: "points" in bed.text("#reading-line"))
            assert "of 1" in bed.text("#reading-line")


async def test_no_sample_is_lost_on_its_way_to_the_screen(bedside):
    async with bedside() as bed:
        await bed.connected()
        seen = []
        see = bed.board.see

        def spy(news):
            see(news)
            if bed.board.live is not None:
                seen[:] = bed.board.live.curve.pressure_mbar

        bed.board.see = spy
        await bed.run()
        curve = bed.board.entry.curve
        assert np.array_equal(curve.pressure_mbar[: len(seen)], seen)
        assert len(curve) == 100
        assert bed.board.entry.lost == 0


async def test_vent_in_the_middle_keeps_the_partial_curve(bedside):
    async with bedside(SLOW) as bed:
        await bed.connected()
        await bed.fill("program", LONG)
        await bed.start()
        await bed.until(lambda: bed.board.live and len(bed.board.live.curve) > 20)
        await bed.press("v")
        await bed.until(lambda: bed.board.entries and bed.board.can_arm)
        entry = bed.board.entries[1]
        assert entry.curve.partial
        assert entry.cut is not None
        assert entry.curve.pressure_mbar.max() < 100
        await bed.until(lambda: entry.result is not None)
        assert "partial_curve" in entry.result.flags
        await bed.until(lambda: "cut short" in bed.text("#card-text"))


async def test_escape_vents_as_well_and_withdraws(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        await bed.check()
        await bed.press("escape")
        await bed.until(lambda: bed.app.bench.vents == 1 and bed.board.review is None)
        await bed.press("f9")
        await bed.until(lambda: "F8 first" in bed.board.note)
        assert bed.board.instrument in {None, InstrumentState.IDLE}
        await bed.quit()
    assert session_files() == []  # shown only: nothing to keep


async def test_quit_while_running_vents_and_saves_what_there_is(bedside, session_files):
    async with bedside(SLOW) as bed:
        await bed.connected()
        await bed.fill("program", LONG)
        await bed.start()
        await bed.until(lambda: bed.board.live and len(bed.board.live.curve) > 20)
        await bed.quit()
    (path,) = session_files()
    session = read_session(path)
    assert len(session.curves) == 1
    assert session.curves[0].partial
    assert replayed(session) == []


async def test_an_app_that_just_ends_vents_and_saves_too(bedside, session_files):
    async with bedside(SLOW) as bed:
        await bed.connected()
        await bed.fill("program", LONG)
        await bed.start()
        await bed.until(lambda: bed.board.live and len(bed.board.live.curve) > 20)
        bed.app.interrupt()
        await bed.until(lambda: bed.app.return_code is not None)
    assert bed.app.return_code == 130
    (path,) = session_files()
    assert read_session(path).curves[0].partial


@pytest.mark.long
async def test_two_curves_and_looking_back_at_the_first(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        await bed.run()
        await bed.until(lambda: "100 of 100 points" in bed.text("#card-text"))  # no estimate
        first = bed.text("#card-text")
        await bed.run()  # counted by the program
        await bed.until(lambda: "this is loading 2" in bed.text("#card-text"))
        assert bed.board.shown == 2
        curves = bed.app.screen.query_one(Curves)
        curves.focus()
        await bed.until(lambda: curves.has_focus and curves.cursor_row == 1)
        await bed.press("up")
        await bed.until(lambda: bed.text("#card-text") == first)
        assert bed.board.shown == 1
    (path,) = session_files()
    assert [c.setup.cycle for c in read_session(path).curves] == [1, 2]


@pytest.mark.long
async def test_another_subject_begins_another_session(bedside, session_files):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.run()
        await bed.fill("subject", "P02")
        await bed.until(lambda: bed.text("#card-title") == "a new visit")
        curves = bed.app.screen.query_one(Curves)
        await bed.until(lambda: curves.row_count == 0)  # nothing of P01 under this name
        await bed.until(lambda: "P02" in bed.text("#where"))
        await bed.fill("subject", "P01")
        await bed.until(lambda: "P01" in bed.text("#card-text"))
        await bed.fill("subject", "P02")
        await bed.check()
        assert bed.board.session == 2
        assert bed.board.entries == {}
        await bed.press("f9")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
    subjects = [read_session(path).meta["subject"] for path in session_files()]
    assert subjects == ["P01", "P02"]


async def test_another_day_begins_another_session(bedside, session_files):
    """A screen that was left open dated the next day's curve to the day before."""
    later = timedelta(0)
    async with bedside(now=lambda: datetime.now() + later) as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.run()
        for hours, session, cycle in ((0.0, 1, 2), (24.0, 2, 1)):
            later = timedelta(hours=hours)
            await bed.press("v")
            await bed.until(lambda: bed.board.can_arm and bed.board.review is None)
            await bed.check()
            assert bed.board.session == session
            assert f"loading  {cycle} of this site" in bed.text("#card-text")
        assert "another day" in " ".join(note for note, _ in bed.board.told)
        await bed.press("f9")
        await bed.until(lambda: bed.board.entry and bed.board.entry.result and bed.board.can_arm)
    loadings = [[c.setup.cycle for c in read_session(p).curves] for p in session_files()]
    assert loadings == [[1], [1]]


def test_a_visit_goes_on_over_midnight_and_not_into_the_next_day():
    board = Board("p")
    board.begun_at = datetime(2026, 3, 1, 22, 0)
    ends = [(datetime(2026, 3, 1, 23, 50), False), (datetime(2026, 3, 2, 0, 30), False)]
    for now, over in [*ends, (datetime(2026, 3, 2, 2, 1), True), (datetime(2026, 3, 2, 8), True)]:
        assert board.is_over(now) is over
    assert not Board("p").is_over(datetime(2026, 3, 2))


async def test_a_journal_that_a_crash_left_is_told_of_at_the_start(bedside, tmp_path):
    (tmp_path / "2026-01-01-1.h5.journal").write_bytes(b"")
    async with bedside() as bed:
        await bed.connected()
        told = [note for note, _ in bed.board.told]
        assert any("2026-01-01-1.h5.journal" in n and "skinlab recover" in n for n in told)
        # It stays in view: "connecting" had covered it before anybody could read it
        assert "2026-01-01-1.h5.journal was left by a crash" in bed.board.note


@pytest.mark.parametrize(("later_h", "noted"), [(1.0, True), (13.0, False)])
async def test_a_site_that_was_loaded_before_the_start_is_told_of(
    bedside, tmp_path, later_h, noted
):
    """After a crash the summary said "loading 1 of this site", as for one that has rested."""
    meta = read_session(example_session()).meta
    shutil.copy(example_session(), tmp_path / "morning.h5")
    begun = datetime.fromisoformat(meta["created_utc"])
    now = (begun + timedelta(hours=later_h)).astimezone().replace(tzinfo=None)
    async with bedside(now=lambda: now) as bed:
        await bed.connected()
        await bed.fill("subject", meta["subject"])
        await bed.fill("site", meta["site"])
        await bed.check()
        assert ("morning.h5" in bed.board.review.before) is noted
        assert any("NOTE" in line for line in card_text(bed.board, 80).lines) is noted


@pytest.mark.long
async def test_a_link_that_is_lost_and_comes_back(bedside, tmp_path):
    faults = tmp_path / "faults" / "FAULTS.toml"
    faults.parent.mkdir()
    faults.write_text('[[fault]]\nkind = "unplug"\nat_s = 2.0\nfor_s = 4.0\n')
    async with bedside(f"sim://?seed=1&speed=5&faults={faults}") as bed:
        await bed.connected()
        await bed.start()
        await bed.until(lambda: bed.board.alarm is not None)
        assert "lift the probe" in bed.board.alarm
        await bed.until(lambda: bed.board.phase == "READY")
        await bed.until(lambda: "the link is back" in bed.board.note)
        assert bed.board.entries[1].cut is not None
        await bed.confirm()  # the alarm is acknowledged ...
        await bed.until(lambda: bed.board.can_arm)
        await bed.check()
        await bed.until(lambda: "loading  2 of this site" in bed.text("#card-text"))
        await bed.run()  # ... and the cut repeat is taken again, in the same session
        assert [bed.board.entries[n].cut is None for n in (1, 2)] == [False, True]
    (path,) = tmp_path.glob("*.h5")
    curves = read_session(path).curves
    assert [curve.partial for curve in curves] == [True, False]
    assert [(c.setup.cycle, c.setup.repeat) for c in curves] == [(1, 1), (2, 1)]
