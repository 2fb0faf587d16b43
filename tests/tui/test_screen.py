from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest
from textual import events
from textual.widgets import Input, OptionList

from drivers.events import (
    Alarm,
    HostVented,
    InstrumentState,
    LinkLost,
    Sample,
    State,
    VentConfirmed,
)
from skinlab.acquisition.messages import Heard
from skinlab.curves.probe_file import read_probe
from skinlab.recording.stream import Happened
from skinlab.tui.screens.alarm import AlarmScreen
from skinlab.tui.screens.help import HelpScreen
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.screens.ports import PortsScreen
from skinlab.tui.ui_state import Level

PROBE = Path(__file__).parents[1] / "data" / "inputs" / "probe.toml"

SMALL_AND_LARGE = [(80, 24), (60, 20), (160, 50)]


async def test_a_bad_program_is_said_under_its_field_and_is_not_armed(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.type("program", "ramp:900@20")
        await bed.until(lambda: "0–500 mbar" in bed.text("#wrong-program"))
        assert bed.app.screen.query_one("#wrong-program").display
        await bed.press("escape", "f8")
        await bed.until(lambda: "0–500 mbar" in bed.board.note)
        assert not bed.board.moving
        await bed.until(lambda: bed.app.screen.query_one("#program").has_focus)
        await bed.fill("program", "ramp:50@20,hold:1,ramp:0@20,rest:1,boo:3")
        # The few lines there are not filled by the program itself
        await bed.until(lambda: "program '…': 'boo:3'" in bed.text("#wrong-program"))
        await bed.fill("program", "ramp:50@20")
        await bed.until(lambda: not bed.app.screen.query_one("#wrong-program").display)
        await bed.check()


async def test_other_fields_are_checked_as_they_are_typed(bedside):
    async with bedside() as bed:
        await bed.connected()
        for field, text, good, words in (
            ("aperture_mm", "5", "6", "expected one of 2, 4, 6, 8"),
            ("thickness_mm", "99", "1.0", "expected 0.1–10 mm"),
            ("thickness_mm", "x", "1.0", "expected a number"),
            ("cycle", "0", "1", "expected 1"),
            ("port", " ", "sim://", "expected a port"),
        ):
            await bed.type(field, text)
            row = {"port": "#wrong-port", "cycle": "#wrong-cycle"}.get(field, "#wrong-aperture_mm")
            await bed.until(lambda r=row, w=words: w in bed.text(r))
            assert bed.app.screen.query_one(f"#{field}").has_class("-wrong")
            await bed.fill(field, good)
            await bed.until(lambda r=row: not bed.app.screen.query_one(r).display)


async def test_a_missing_port_is_a_sentence_and_another_one_can_be_tried(bedside):
    async with bedside("/dev/no-such-port") as bed:
        await bed.until(lambda: "no such port" in bed.board.note)
        await bed.until(lambda: "NO PROBE" in bed.text("#phase"))
        assert not bed.app.screen.query_one("#banner").display
        assert "Traceback" not in bed.screenshot()
        await bed.fill("port", "sim://?seed=1&speed=20")
        await bed.check()  # connects first
        assert bed.board.hello is not None


async def test_a_probe_with_another_opening_is_not_armed_by_mistake(bedside):
    async with bedside("/dev/no-such-port") as bed:
        await bed.until(lambda: bed.board.doing is None)
        await bed.fill("port", "sim://?seed=1&speed=20&aperture_mm=2")
        await bed.press("f8", "f8")
        await bed.connected()
        assert "2 mm" in bed.board.note
        assert not bed.board.moving
        assert bed.app.screen.query_one("#aperture_mm", Input).value == "2"
        await bed.check()


async def test_letters_are_text_in_a_field_and_keys_elsewhere(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.type("site", "vq? t arm")
        site = bed.app.screen.query_one("#site", Input)
        await bed.until(lambda: site.value == "vq? t arm")
        assert bed.app.bench.vents == 0
        await bed.press("escape")
        await bed.until(lambda: bed.app.bench.vents == 1 and bed.app.focused is None)
        await bed.press("v")
        await bed.until(lambda: bed.app.bench.vents == 2)


async def test_fields_take_no_text_while_it_is_shown_what_will_happen(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.type("site", "arm")
        await bed.check()
        await bed.press("x", "y", "z", "tab", "x")
        assert bed.app.screen.query_one("#site", Input).value == "arm"
        assert not isinstance(bed.app.focused, Input)
        await bed.press("v")
        await bed.until(lambda: bed.board.review is None)
        await bed.type("site", "leg")
        await bed.until(lambda: bed.app.screen.query_one("#site", Input).value == "leg")


async def test_enter_and_space_start_nothing(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("enter", "space", "f9")
        await bed.until(lambda: "F8 first" in bed.board.note)
        assert bed.board.doing is None
        assert bed.board.live is None


@pytest.mark.parametrize("key", ["question_mark", pytest.param("f1", marks=pytest.mark.long)])
async def test_help_opens_and_closes(bedside, key):
    async with bedside() as bed:
        await bed.connected()
        await bed.press(key)
        await bed.on(HelpScreen)
        await bed.press("enter")
        await bed.on(MainScreen)
        assert not bed.board.moving  # that Enter did not arm


async def test_v_vents_through_the_help(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.check()
        await bed.press("f1")
        await bed.on(HelpScreen)
        await bed.press("v")
        await bed.on(MainScreen)
        await bed.until(lambda: bed.board.can_arm)


async def alarmed(bed):
    await bed.connected()
    alarm = Heard((Happened(Alarm("the pressure did not fall: lift the probe")),))
    bed.app.post_message(bed.app.Said(alarm))
    await bed.on(AlarmScreen)
    return alarm


async def test_the_alarm_stays_until_it_is_acknowledged(bedside):
    async with bedside() as bed:
        alarm = await alarmed(bed)
        bed.app.post_message(bed.app.Said(alarm))
        await bed.press("enter", "space", "escape", "v", "f1", "q", "a", "f8", "f9")
        await bed.until(lambda: bed.app.bench.vents >= 2)
        assert isinstance(bed.app.screen, AlarmScreen)
        assert not bed.board.can_arm
        await bed.press("question_mark")  # it names no key that would say the same
        await bed.until(lambda: bed.board.aside.startswith("?: not before the alarm is"))
        assert bed.board.aside.endswith("(F9)")
        await bed.confirm()
        await bed.on(MainScreen)
        await bed.until(lambda: bed.board.alarm is None)
        await bed.connected()


async def test_an_alarm_says_that_the_suction_has_been_seen_to_end(bedside):
    """It went on to say "cannot be checked" while the link was back and the skin free."""
    sample = Sample(device_time_s=0.1, pressure_mbar=30.0, deflection_mm=0.2, segment=0, sequence=1)
    async with bedside() as bed:
        await bed.connected()
        for event, said in (
            (Alarm("the vacuum cannot be checked: lift the probe"), False),
            (VentConfirmed(0.42), True),
            (HostVented("operator"), False),
            (VentConfirmed(0.42), True),
            (State(InstrumentState.FAULT, "valve", 12.0), False),
            (VentConfirmed(0.42), True),
            (LinkLost("the link is lost"), False),
            (VentConfirmed(0.42), True),
            (sample, False),
        ):
            bed.app.post_message(bed.app.Said(Heard((Happened(event),))))
            await bed.on(AlarmScreen)
            await bed.until(
                lambda said=said: ("is off (0.4 mbar)" in bed.text("#alarm-text")) is said
            )
            assert bed.text("#alarm-text").startswith("the vacuum cannot be checked")
        await bed.confirm()
        await bed.until(lambda: bed.board.alarm is None)


async def test_an_alarm_that_comes_back_keeps_nobody(bedside):
    """A valve that stays stuck raised it a second after each F9, and q was refused."""
    async with bedside() as bed:
        alarm = await alarmed(bed)
        await bed.press("ctrl+c")
        await bed.on(ConfirmScreen)
        assert bed.app.bench.vents >= 1
        bed.app.post_message(bed.app.Said(alarm))
        await bed.press("f8")
        await bed.on(AlarmScreen)
        await bed.press("ctrl+c")
        await bed.on(ConfirmScreen)
        await bed.confirm()
        await bed.until(lambda: bed.board.doing is None)
        await bed.on(AlarmScreen)
        await bed.confirm()
        await bed.until(lambda: bed.app.return_code is not None)


@pytest.mark.long
async def test_ports_offers_the_simulated_probes(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("f2")
        await bed.on(PortsScreen)
        await bed.until(lambda: isinstance(bed.app.focused, OptionList))
        await bed.press("end", "enter")
        await bed.until(lambda: bed.board.hello and bed.board.hello.aperture_mm == 8)
        main = bed.app.screen_stack[0]
        await bed.until(lambda: main.query_one("#aperture_mm", Input).value == "8")
        assert "aperture_mm=8" in main.query_one("#port", Input).value


def whole(main, part):
    region = main.query_one(part).region
    return region.width > 0 and region.height > 0 and main.region.contains_region(region)


@pytest.mark.long
async def test_every_size_shows_a_measurement(bedside):
    parts = ("#settings-line", "#card", "#plot-panel", "#strip", "#reading", "#curves", "#note")
    async with bedside(size=SMALL_AND_LARGE[0]) as bed:
        await bed.connected()
        await bed.run()
        await bed.until(lambda: "X1" in bed.text("#card-text"))
        await bed.until(lambda: "READY" in bed.text("#phase"))
        for size in SMALL_AND_LARGE:
            await bed.pilot.resize_terminal(*size)
            keys = ("Check", "Vent", "Help" if size[0] < 80 else "Quit")  # Help names all keys
            for word in ("SIMULATED", "READY", "X1", "X2", "ν", "mbar", *keys):
                await bed.until(lambda w=word: w in bed.screenshot().replace("&#160;", " "))
            main = bed.app.screen
            assert (main.region.width, main.region.height) == size
            await bed.until(lambda m=main: all(whole(m, part) for part in parts))


async def test_nothing_starts_where_what_will_happen_does_not_fit(bedside):
    async with bedside(size=(30, 8)) as bed:
        await bed.connected()
        await bed.press("f8", "f8")
        await bed.until(lambda: bed.board.review)
        await bed.pilot.pause()
        bed.clock.now_s += 2.0
        await bed.press("f9")
        await bed.until(lambda: "make it larger" in bed.board.note)
        assert not bed.board.moving
        await bed.pilot.resize_terminal(80, 24)
        await bed.start()


@pytest.mark.long
async def test_a_program_of_many_parts_fits_too(bedside):
    async with bedside(size=(60, 20)) as bed:
        await bed.connected()
        await bed.fill("program", "mode1:100,0.1,0.1,30")
        await bed.check()
        assert "120 parts in all" in bed.text("#card-text")
        await bed.press("f9")
        await bed.until(lambda: bed.board.live or bed.board.entries)


@pytest.mark.long
async def test_tab_and_enter_go_round_in_the_fields(bedside):
    async with bedside() as bed:
        await bed.connected()
        count = len(bed.app.screen.query(Input))
        for key, steps in (("tab", count), ("shift+tab", count), ("enter", count)):
            await bed.press("f3")
            await bed.until(lambda: bed.app.screen.query_one("#program").has_focus)
            seen = []
            for _ in range(steps):
                await bed.press(key)
                seen.append(bed.app.focused.id)
            assert len(set(seen)) == count
            assert seen[-1] == "program"
            await bed.press("f3")
        assert not bed.board.moving


async def test_tab_begins_with_the_subject_and_leaves_the_port_alone(bedside):
    async with bedside() as bed:
        await bed.connected()
        port = bed.app.screen.query_one("#port", Input).value
        await bed.press("tab", *"A1", "tab", *"arm")
        subject, site = (bed.app.screen.query_one(f, Input) for f in ("#subject", "#site"))
        await bed.until(lambda: (subject.value, site.value) == ("A1", "arm"))
        assert bed.app.screen.query_one("#port", Input).value == port


async def test_what_is_typed_at_once_behind_a_tab_goes_to_the_next_field(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("f8")  # asks for a subject
        await bed.until(lambda: bed.app.screen.query_one("#subject").has_focus)
        for key in ("P", "7", "tab", "a", "r", "m"):
            bed.app.post_message(events.Key(key, key if len(key) == 1 else None))
        site, subject = (bed.app.screen.query_one(f, Input) for f in ("#site", "#subject"))
        await bed.until(lambda: site.value == "arm")
        assert subject.value == "P7"


@pytest.mark.long
async def test_resizing_while_the_curve_is_drawn(bedside):
    async with bedside("sim://?seed=1&speed=10") as bed:
        await bed.connected()
        await bed.fill("program", "ramp:100@4")
        await bed.start()
        await bed.until(lambda: bed.board.live or bed.board.entries)
        for size in [(60, 20), (20, 5), (120, 40)]:
            before = len(bed.board.live.curve) if bed.board.live else 0
            await bed.pilot.resize_terminal(*size)
            await bed.until(lambda n=before: not bed.board.live or len(bed.board.live.curve) > n)
        await bed.until(lambda: bed.board.entry and bed.board.entry.result)
        assert bed.board.entry.cut is None


@pytest.mark.long
async def test_dark_and_light(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.run()
        await bed.press("t")
        await bed.until(lambda: not bed.app.current_theme.dark)
        await bed.until(lambda: "X1" in bed.screenshot())
        await bed.press("t")
        await bed.until(lambda: bed.app.current_theme.dark)


async def test_a_bug_in_a_handler_vents_and_shows_no_traceback(bedside, capsys):
    def broken(news):
        raise ZeroDivisionError("a bug")

    async def start_with_the_bug():
        async with bedside() as bed:
            await bed.connected()
            await bed.check()
            bed.board.see = broken
            found.append(bed)
            await bed.press("f9")
            await bed.until(lambda: bed.app.failure is not None)

    found = []
    with pytest.raises(ZeroDivisionError):
        await start_with_the_bug()
    (bed,) = found
    assert bed.app.bench.vents >= 1
    assert isinstance(bed.app.failure, ZeroDivisionError)
    output = capsys.readouterr()
    assert "Traceback" not in output.out + output.err


async def test_whether_the_probe_was_checked_is_said_when_it_is_there(bedside, tmp_path):
    path = tmp_path / "files" / "probe.toml"
    path.parent.mkdir()
    path.write_bytes(PROBE.read_bytes().replace(b"2027", b"9999"))
    known = read_probe(path)
    async with bedside(calibration=known) as bed:
        await bed.connected()
        await bed.until(lambda: "P-9 was not checked yet" in bed.board.note)
        assert bed.board.level is Level.WARNING
    known.keep_check(datetime.now(UTC), agrees=True)
    async with bedside(calibration=known) as bed:
        await bed.connected()
        await bed.until(lambda: "P-9 agreed with its calibration" in bed.board.note)
