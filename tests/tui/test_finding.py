"""Visits, pick-lists, goals, the palette, messages, help, colours: finding one's way."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from textual import events
from textual.widgets import DataTable, Input, OptionList

from skinlab.acquisition.replay_control import ReplayControl
from skinlab.curves.program import check_measurable, parse_program
from skinlab.errors import InputError
from skinlab.inference.result import Advice, Value
from skinlab.recording.pseudonym import check_site
from skinlab.recording.session import example_session, read_session, write_session
from skinlab.recording.visit_index import NAME, visit_before, visits
from skinlab.report.rounding import half_width_percent
from skinlab.studies.change import Changed
from skinlab.tui.card_text import verdict_text
from skinlab.tui.choices import PROGRAMS, SITES, body_map, nearest_site
from skinlab.tui.goal import ChangeDistance, ChangeGoal, Distance, Following, Goal
from skinlab.tui.screens.help import HelpScreen
from skinlab.tui.screens.line import LineScreen, seconds
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.messages import MessagesScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.screens.palette import PaletteScreen
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.screens.visits import VisitsScreen
from skinlab.tui.text import TIMELINE
from skinlab.tui.themes import ORDER
from skinlab.tui.visits import at_control, cells, found, series, trend_lines, when
from skinlab.tui.widgets.hints import KeyHint

# ---- visits ----------------------------------------


@pytest.fixture
def folder(tmp_path) -> Path:
    shutil.copy(example_session(), tmp_path / "monday.h5")
    shutil.copy(example_session(), tmp_path / "friday.h5")
    (tmp_path / "bad.h5").write_bytes(b"no session")
    return tmp_path


def test_the_index_is_a_cache_that_may_be_deleted(folder):
    first = visits(folder)
    assert [v.file for v in first][-1] == "bad.h5"
    assert first[-1].problem
    why = cells(first[-1])[5]  # without the folder, which left no room for the reason
    assert why.startswith(f"{first[-1].file}: ")
    assert first[0].subject == "SIM-1"
    assert first[0].simulated
    assert {"X1_MPa", "X2_MPa"} <= first[0].parameters.keys()
    index = folder / NAME
    assert index.stat().st_mode & 0o777 == 0o600
    opened = []
    assert visits(folder, lambda done, of: opened.append(done)) == first
    assert opened == []  # nothing is read twice
    index.write_bytes(b"damaged")
    assert visits(folder) == first
    index.unlink()
    (folder / "friday.h5").unlink()
    assert [v.file for v in visits(folder)] == ["monday.h5", "bad.h5"]
    assert visits(folder / "nowhere") == []


def test_a_link_to_nowhere_is_no_visit(folder):
    """It was an internal error, for which the bedside program vents."""
    (folder / "gone.h5").symlink_to(folder / "nowhere.h5")
    assert "gone.h5" not in [v.file for v in visits(folder)]


def test_visits_are_searched_and_followed(folder):
    rows = visits(folder)
    assert [v.file for v in found(rows, "FOREARM sim-1 monday")] == ["monday.h5"]
    assert found(rows, "leg") == []
    same = series(rows, rows[0])
    assert len(same) == 2
    text = "\n".join(trend_lines(same, 80, None))
    assert "2 visits" in text
    assert "X1 (MPa)  stiffness at small stretch" in text
    assert text.count("●") >= 6
    assert "two visits" in trend_lines(same[:1], 80, None)[0]


@pytest.mark.long
async def test_the_list_of_visits_by_keys(bedside, folder):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("f5")
        await bed.on(VisitsScreen)
        table = bed.app.screen.query_one(DataTable)
        await bed.until(lambda: table.row_count == 3)
        await bed.press("m", "down", "c")
        await bed.until(lambda: "could have been shown" in bed.text("#visits-text"))
        await bed.press("t")
        await bed.until(lambda: "░ no change could be shown within it" in bed.text("#visits-text"))
        await bed.press("enter")
        await bed.until(lambda: "curve 1: 6 mm" in bed.text("#visits-text"))
        await bed.press("slash", *"bad")
        await bed.until(lambda: table.row_count == 1)
        await bed.press("enter", "enter")
        await bed.until(lambda: "bad.h5" in bed.text("#visits-text"))
        vents = bed.app.bench.vents
        await bed.press("v")  # also from here
        await bed.until(lambda: bed.app.bench.vents > vents)
        await bed.on(MainScreen)
        await bed.quit()


@pytest.mark.long
async def test_a_control_site_and_a_study_count_in_the_list_of_visits(bedside, folder):
    one = read_session(example_session())
    write_session(folder / "cheek.h5", replace(one, meta={**one.meta, "site": "cheek"}))
    parts = [("within", 0.0064, 40), ("visit", 0.0025, 20), ("operator", 0.01, 2)]
    where = f'"6 mm, {one.curves[0].setup.program}"'
    lines = [f"{where},{q},log,{n},{v},{f}" for q in ("X1_MPa", "X2_MPa") for n, v, f in parts]
    lines += [f"{where},nu,linear,{n},{v},{f}" for n, v, f in parts]
    head = "condition,quantity,scale,component,variance,freedom"
    (folder / "components.csv").write_text("\n".join([head, *lines]))
    async with bedside() as bed:
        await bed.connected()
        bed.app.board.study = folder
        await bed.press("f5")
        await bed.on(VisitsScreen)
        table = bed.app.screen.query_one(DataTable)
        await bed.until(lambda: table.row_count == 4)
        await bed.press("m", "down", "c")
        await bed.until(lambda: "components of variance" in bed.text("#visits-text"))
        assert "less the change" not in bed.text("#visits-text")
        await bed.press("down", "k")
        await bed.until(lambda: "Control site" in bed.text("#visits-text"))
        assert [table.get_row_at(k)[0] for k in range(4)] == ["●", "", "○", ""]
        await bed.press("up", "c")
        await bed.until(lambda: "less the change of the control" in bed.text("#visits-text"))
        await bed.press("b")
        await bed.on(MainScreen)
        await bed.quit()


def test_a_control_that_was_not_measured_that_day_is_said(folder):
    rows = visits(folder)
    with pytest.raises(InputError, match=r"cheek of SIM-1 was not measured on 20\d\d"):
        at_control(rows, rows[0], "cheek")


@pytest.fixture
def imports(folder) -> Path:
    """Two imported sessions more: one whose day is stated, before the others, one without."""
    one = read_session(folder / "monday.h5")
    for name, more in (("stated", {"measured_utc": "2020-03-01"}), ("open", {})):
        meta = {n: v for n, v in one.meta.items() if n != "created_utc"}
        meta |= {"created_utc": "2031-01-01T00:00:00+00:00", "imported": [], **more}
        write_session(folder / f"{name}.h5", replace(one, meta=meta))
    return folder


def test_visits_stand_at_the_day_they_were_measured_not_imported(imports):
    rows = {v.file: v for v in visits(imports)}
    assert list(rows) == ["monday.h5", "friday.h5", "stated.h5", "open.h5", "bad.h5"]
    assert when(rows["stated.h5"]) == "2020-03-01"
    assert when(rows["open.h5"]) == "imported 2031-01-01"
    same = series(rows.values(), rows["open.h5"])
    assert [v.file for v in same] == ["stated.h5", "friday.h5", "monday.h5", "open.h5"]
    text = trend_lines(same, 80, None)
    assert text[0].endswith("3 visits")
    assert text[1].startswith("1 imported visit left out: no day")
    with pytest.raises(InputError, match=r"open\.h5: imported, and nobody said when"):
        at_control(list(rows.values()), rows["open.h5"], "forearm")


def test_what_nobody_says_the_day_of_is_before_and_after_nothing(imports):
    row = next(v for v in visits(imports) if v.file == "open.h5")

    def before(name):
        whose = (row.subject, row.site)
        found = visit_before(imports, whose, imports / name, simulated=row.simulated)
        return None if found is None else found.name

    assert before("monday.h5") == before("friday.h5") == "stated.h5"
    assert before("open.h5") is None
    assert before("stated.h5") is None
    again = read_session(imports / "stated.h5")
    meta = {**again.meta, "measured_utc": "2020-03-01T10:20:00+00:00"}
    write_session(imports / "noon.h5", replace(again, meta=meta))
    assert before("noon.h5") is None  # of one day, the day alone does not tell which was first


# ---- pick-lists ----------------------------------------


def test_what_is_offered_can_be_measured():
    for _, program in PROGRAMS:
        check_measurable(parse_program(program))
    names = [site.name for site in SITES]
    assert len(set(names)) == len(names)
    for site in SITES:
        check_site(site.name)
        assert nearest_site(site.column, site.row) == site
        assert body_map(site.name).count("●") == 1
    assert "●" not in body_map("")


@pytest.mark.long
async def test_a_site_a_program_and_an_opening_are_picked(bedside):
    async with bedside() as bed:
        await bed.connected()
        bed.app.screen.query_one("#site").focus()
        await bed.until(lambda: bed.app.focused and bed.app.focused.id == "site")
        await bed.press("f4")
        await bed.on(PickScreen)
        await bed.press("down", "down")
        await bed.until(lambda: "●" in bed.text("#body"))
        await bed.press("enter")
        site = bed.app.screen_stack[0].query_one("#site", Input)
        await bed.until(lambda: site.value == SITES[2].name)
        bed.app.screen.set_focus(None)
        await bed.press("f4")
        await bed.on(PickScreen)
        await bed.press("down", "enter")
        program = bed.app.screen_stack[0].query_one("#program", Input)
        await bed.until(lambda: program.value == PROGRAMS[1][1])
        await bed.press("f4")
        await bed.on(PickScreen)
        await bed.press("f8")  # nothing chosen, nothing changed
        await bed.on(MainScreen)
        assert program.value == PROGRAMS[1][1]
        assert bed.board.review is None


# ---- goals ----------------------------------------


def test_a_goal_says_how_far_it_is():
    goal = Goal("X1_MPa", 5.0)
    assert half_width_percent(Value(0.025, 0.02, 0.03125)) == pytest.approx(25.0)
    advice = Advice(2.0, "ramp:300@20", {"X1_MPa": 0.4})
    words = Distance(goal, 20.0, advice).words
    assert "± 20 % now" in words
    assert "F7 loads 2 mm, ramp:300@20 (expected ± 8 %)" in words
    assert "will not help" in Distance(goal, 20.0, None).words
    assert "reached" in Distance(goal, 4.9, None).words
    assert "no interval" in Distance(goal, None, None).words


@pytest.mark.long
async def test_a_visit_with_a_goal_says_what_to_measure_next(bedside, monkeypatch):
    async with bedside() as bed:
        await bed.connected()
        await bed.until(lambda: bed.app.bench.analysis.law)
        await bed.press("g")
        await bed.on(PickScreen)
        await bed.press("down", "enter")
        await bed.until(lambda: bed.board.goal == Goal("X1_MPa", 3.0))
        await bed.run()
        await bed.until(lambda: bed.board.goal_is is not None)
        await bed.until(lambda: "goal X1 to ± 3 %" in bed.text("#verdict-next"))
        noted = []
        monkeypatch.setattr(bed.app.bench, "audit", lambda what, **said: noted.append((what, said)))
        await bed.press("f7")
        following = bed.board.goal_is.following
        program = bed.app.screen.query_one("#program", Input)
        await bed.until(lambda: program.value == following.program)
        assert noted == [
            ("measurement advised", {"aperture_mm": following.aperture_mm,
             "program": following.program, "because": "X1 to ± 3 %"})
        ]  # fmt: skip
        assert not bed.board.moving


# ---- palette, messages, help, colours ----------------------------------------


@pytest.mark.long
async def test_the_palette_finds_and_starts_nothing(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("ctrl+p")
        await bed.on(PaletteScreen)
        found = bed.app.screen.query_one(OptionList)
        everything = [found.get_option_at_index(i).id for i in range(found.option_count)]
        assert not {"want('start')", "want('early')", "want('check')"} & set(everything)
        await bed.press(*"joint")
        await bed.until(lambda: found.option_count == 1)
        await bed.press("enter")
        await bed.on(SessionScreen)
        await bed.press("ctrl+p")
        await bed.on(PaletteScreen)
        await bed.press(*"misses", "enter")
        await bed.until(lambda: "means nothing at this moment" in bed.board.note)
        assert isinstance(bed.app.screen, MainScreen)
        await bed.press("f5")
        await bed.on(VisitsScreen)
        await bed.press("ctrl+p")
        await bed.on(PaletteScreen)
        found = bed.app.screen.query_one(OptionList)
        assert not any("confirm" in found.get_option_at_index(i).id for i in range(5))
        await bed.press(*"here: trend", "enter")  # what the screen itself can do
        await bed.on(VisitsScreen)


@pytest.mark.long
async def test_messages_can_be_read_again(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("x", "w")
        await bed.on(MessagesScreen)
        shown = " ".join(str(s.render()) for s in bed.app.screen.query("#help Static"))
        assert "x: no meaning here" in shown
        await bed.press("enter")
        await bed.on(MainScreen)


@pytest.mark.long
async def test_help_begins_with_the_keys_of_the_screen_it_was_asked_for_on(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("f5")
        await bed.on(VisitsScreen)
        await bed.press("f1")
        await bed.on(HelpScreen)
        here = bed.text("#help-here")
        for words in ("Trend", "Compare", "Search", "Mark"):
            assert words in here


@pytest.mark.long
async def test_colours_are_changed_and_kept(bedside, tmp_path):
    kept = tmp_path / "config" / "ui.json"
    async with bedside(settings=kept) as bed:
        await bed.connected()
        assert bed.app.theme == ORDER[0]
        for name in (*ORDER[1:], ORDER[0], ORDER[1]):
            await bed.press("t")
            await bed.until(lambda n=name: bed.app.theme == n)
    async with bedside(settings=kept) as bed:
        await bed.connected()
        assert bed.app.theme == ORDER[1]


# ---- jumping in a replay ----------------------------------------


def test_a_replay_jumps_by_time_and_to_the_next_event():
    now, slept = [0.0], []

    def sleep(seconds):
        slept.append(seconds)
        now[0] += seconds

    control = ReplayControl(1.0, clock=lambda: now[0], sleep=sleep)
    assert control.wait(100.0, sample=True)
    control.jump(5.0)
    for k in range(1, 6):
        assert control.wait(100.0 + k, sample=True)
    assert sum(slept) == 0.0  # all of it at once
    assert control.wait(106.0, sample=True)
    assert sum(slept) == pytest.approx(1.0, abs=0.1)  # and then at its pace
    control.to_next_event()
    slept.clear()
    assert control.wait(110.0, sample=True)
    assert control.wait(120.0, sample=False)
    assert sum(slept) == 0.0
    assert control.paused


def test_a_replay_begins_with_what_is_not_waited_for():
    slept = []
    control = ReplayControl(1.0, ahead_s=5.0, paused=True, clock=lambda: 0.0, sleep=slept.append)
    assert all(control.wait(100.0 + k, sample=True) for k in range(6))
    assert not slept
    control.step()
    assert control.wait(105.1, sample=True)
    assert control.at_s == pytest.approx(105.1)
    assert control.paused


SKIN = "[skin]\nX1_MPa = {x1}\nX2_MPa = 1.0\nnu = 0.3\nthickness_mm = 1.0\n"


async def measured(bedside, skin, times=1, goal=False):
    """Visit P01's arm with this skin; return what the goal's line says after each curve."""
    said = []
    async with bedside(f"sim://?seed=3&speed=20&skin={skin}", size=(120, 30)) as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.fill("site", "arm")
        if goal:
            await bed.press("g")
            await bed.on(PickScreen)
            await bed.press("end", "enter")
            await bed.until(lambda: isinstance(bed.board.goal, ChangeGoal))
        for _ in range(times):
            await bed.press("f6")
            bed.board.goal_is = None
            await bed.run()
            if goal:
                await bed.until(lambda: bed.board.goal_is is not None)
                said.append(bed.board.goal_is)
        await bed.quit()
    return said


@pytest.mark.long
async def test_the_goal_says_whether_the_skin_has_changed(bedside, tmp_path):
    soft, stiff = tmp_path / "soft.toml", tmp_path / "stiff.toml"
    soft.write_text(SKIN.format(x1=0.02))
    stiff.write_text(SKIN.format(x1=0.05))
    (nothing,) = await measured(bedside, soft, goal=True)
    assert "no earlier visit" in nothing.words
    (same,) = await measured(bedside, soft, goal=True)
    assert same.found.verdict != "changed"
    assert same.found.low < 0 < same.found.high
    (other,) = await measured(bedside, stiff, goal=True)
    assert other.found.verdict == "changed"
    assert other.found.low > 0
    assert other.reached
    assert "changed since session-" in other.words


def test_a_question_of_change_says_what_to_measure_and_when_more_will_not_help():
    found = Changed("stiffness", "log", 0.05, -0.35, 0.45, 0.4, "cannot_say")
    again = ChangeDistance(ChangeGoal(), "a.h5", found, Following(6.0, "ramp:100@20"), 35.0)
    assert "not before 49 % of stiffness" in again.words
    assert "F7: 6 mm, ramp:100@20 (then 35 %)" in again.words
    assert "will not help" in ChangeDistance(ChangeGoal(), "a.h5", found).words
    shown = replace(found, verdict="not_shown")
    assert "no change of stiffness is shown" in ChangeDistance(ChangeGoal(), "a.h5", shown).words


# ---- mouse, undo, a time of a replay ----------------------------------------


async def test_the_next_step_can_be_clicked_and_never_starts_suction(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.until(lambda: "F8 shows what will happen" in bed.text("#verdict-next"))
        await bed.pilot.click("#verdict-next")
        await bed.until(lambda: bed.board.review)
        bed.clock.now_s += 2.0
        await bed.pilot.click("#verdict")
        assert bed.board.review
        assert not bed.board.moving
        await bed.press("v")


@pytest.mark.long
async def test_undo_says_what_it_undid(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.run()
        await bed.press("s")
        await bed.on(SessionScreen)
        await bed.until(lambda: bed.board.note.startswith("saved: "))
        await bed.press("ctrl+z")
        await bed.until(lambda: bed.board.note == "there is nothing to undo")
        await bed.press("delete")
        await bed.until(lambda: isinstance(bed.app.focused, Input))
        bed.app.focused.value = "slipped"
        await bed.press("enter")
        await bed.until(lambda: bed.board.ledger.excluded)
        await bed.press("ctrl+z")
        await bed.until(lambda: bed.board.note == "undone: curve 1 is used again")
        await bed.press("b")
        await bed.quit()


@pytest.mark.parametrize(
    ("text", "s"), [("12.5", 12.5), ("12,5", 12.5), ("1:30", 90.0), ("soon", None), ("-1", None)]
)
def test_a_time_is_typed_in_seconds_or_minutes(text, s):
    assert seconds(text) == s


@pytest.mark.long
async def test_a_replay_goes_on_to_a_time(bedside):
    async with bedside(None, replay=example_session(), speed=0.01) as bed:
        await bed.until(lambda: bed.board.playing and bed.board.playing.length_s > 4)
        await bed.press("j")
        await bed.on(LineScreen)
        await bed.press("9", "9", "9", "9", "enter")
        await bed.until(lambda: "expected 0 to" in bed.board.note)
        await bed.press("j")
        await bed.on(LineScreen)
        await bed.press("4", "enter")
        await bed.until(lambda: bed.board.playing.at_s > 3.5)
        assert not bed.board.playing.ended


async def test_a_replay_says_of_no_vent_where_no_probe_is(bedside):
    async with bedside(None, replay=example_session(), speed=0.01) as bed:
        await bed.until(lambda: bed.board.live)
        assert verdict_text(bed.board).following == "Space pauses"
        await bed.until(lambda: "Faster" in bed.screenshot())
        assert "Vent" not in bed.screenshot()
        await bed.press("v")
        await bed.until(lambda: "nothing is vented" in bed.board.note)
        await bed.press("q")
        await bed.on(ConfirmScreen)
        assert bed.text("#question-text") == "The program ends."
        await bed.press("f8")


async def click_time(bed, share):
    """Click on the time line of a replay."""
    line = bed.app.screen.query_one("#reading-line")
    await bed.until(lambda: re.search(TIMELINE, str(line.content)))
    bar = re.search(TIMELINE, str(line.content))
    at = line.gutter.left + bar.start() + round(share * (len(bar[0]) - 1))
    await bed.pilot.click("#reading-line", offset=(at, 0))


@pytest.mark.long
async def test_a_click_on_the_time_line_goes_there_and_back_again(bedside):
    async with bedside(None, replay=example_session(), speed=0.01) as bed:
        await bed.until(lambda: bed.board.playing and bed.board.playing.length_s > 4)
        whole_s = bed.board.playing.length_s
        await bed.press("space")
        await bed.until(lambda: bed.board.phase == "PAUSED")
        await click_time(bed, 0.75)
        await bed.until(lambda: bed.board.playing.at_s > 0.6 * whole_s)
        assert bed.board.entries
        await click_time(bed, 0.25)
        await bed.until(lambda: 0.1 * whole_s < bed.board.playing.at_s < 0.5 * whole_s)
        await bed.until(lambda: bed.board.live is not None)
        assert bed.board.phase == "PAUSED"  # as it was
        assert not bed.board.entries  # what came after that is still to come
        await bed.press("9")
        await bed.until(lambda: bed.board.playing.at_s > 0.8 * whole_s)


@pytest.mark.long
async def test_what_is_open_can_be_left_by_a_click_on_its_keys(bedside):
    async with bedside() as bed:
        await bed.connected()
        for key in ("f1", "w", "f4", "ctrl+p", "f2"):
            await bed.press(key)
            await bed.until(lambda: bed.app.screen.query(KeyHint))
            await bed.until(lambda: bed.app.screen.query(KeyHint).last().size.width)
            await bed.pilot.click(bed.app.screen.query(KeyHint).last())
            await bed.on(MainScreen)
        await bed.press("q")
        await bed.on(ConfirmScreen)
        await bed.until(lambda: bed.app.screen.query(KeyHint).first().size.width)
        await bed.pilot.click(bed.app.screen.query(KeyHint).first())  # yes, at once
        await bed.until(lambda: "press F9 again" in bed.text("#question-why"))
        await bed.pilot.click(bed.app.screen.query(KeyHint).last())  # no
        await bed.on(MainScreen)


@pytest.mark.long
async def test_suction_ends_by_a_click_where_it_says_so(bedside):
    async with bedside("sim://?seed=1&speed=2") as bed:
        await bed.connected()
        await bed.fill("program", "ramp:100@2")
        await bed.start()
        await bed.until(lambda: bed.text("#suction") == "SUCTION: v vents")
        await bed.pilot.click("#suction")
        await bed.until(lambda: bed.app.bench.vents == 1)
        await bed.until(lambda: not bed.board.suction)


@pytest.mark.long
async def test_no_key_is_silent_on_any_screen(bedside):
    said = "F10: no meaning here"
    async with bedside() as bed:
        await bed.connected()
        for key in ("f1", "w", "f4", "f2", "f5", "q"):
            await bed.press(key)
            await bed.until(lambda: not isinstance(bed.app.screen, MainScreen))
            # Again, where that the Esc before has vented is said over it
            await bed.press_until(lambda: bed.text("#note").startswith(said), "f10")
            await bed.press("escape")
            await bed.on(MainScreen)


async def test_what_closes_a_screen_closes_no_other(bedside):
    """A second Enter that came at once ended the program."""
    async with bedside() as bed:
        await bed.connected()
        await bed.press("f4")
        await bed.on(PickScreen)
        for _ in range(3):
            bed.app.post_message(events.Key("enter", "\r"))
        await bed.until(lambda: isinstance(bed.app.screen, MainScreen))
        await bed.settle()
        assert bed.app.is_running
