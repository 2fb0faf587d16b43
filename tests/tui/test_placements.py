"""A probe that is lifted and put on again: another placement, and the count of loadings goes on."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import pytest
from shown import entry_of

from drivers.events import Hello
from skinlab.acquisition.messages import Connected
from skinlab.curves.curve import Setup
from skinlab.curves.placement import placements_of
from skinlab.curves.program import parse_program
from skinlab.recording.load_inputs import read_input
from skinlab.recording.session import read_session
from skinlab.tui.card_text import verdict_text
from skinlab.tui.screens.palette import PaletteScreen
from skinlab.tui.text import program_extent
from skinlab.tui.ui_state import Board

HELLO = Hello("reference", 1, "rig", "1.0", "7", 8.0, 500.0, 60.0, 1.0, 1000.0, simulated=False)


async def test_the_operator_says_that_the_probe_was_put_on_anew(bedside, tmp_path):
    """It could not be said: the curve counted as a later loading of the placement before."""
    async with bedside(now=lambda: datetime(2026, 3, 1, 9, 5, 7)) as bed:
        await bed.connected()
        await bed.press("insert")
        assert "the first curve of a visit begins a placement" in bed.board.note
        await bed.fill("subject", "P01")
        await bed.fill("repeats", "1")
        await bed.run()
        await bed.until(lambda: bed.board.saved)  # which has a note of its own
        await bed.check()
        assert "loading  2 of this site, probe not lifted (else Ins)" in bed.text("#card-text")
        await bed.press("insert")
        assert bed.board.review is None
        assert "the next curve is loading 2, of another placement" in bed.board.note
        await bed.press("insert")
        assert "taken back" in bed.board.note
        await bed.press("insert")
        await bed.check()
        assert "loading  2 of this site, probe put on anew" in bed.text("#card-text")
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm and bed.board.review is None)
        await bed.run()  # the vent has not taken it back
        await bed.run()
        await bed.press("f6")
        await bed.run()
        assert [e.setup.placement for e in bed.board.entries.values()] == [
            None, "2 (09:05:07)", "2 (09:05:07)", None,
        ]  # fmt: skip
        await bed.quit()
    (path,) = tmp_path.glob("*.h5")
    curves = read_session(path).curves
    assert [curve.setup.cycle for curve in curves] == [1, 2, 3, 1]
    assert placements_of(read_input(path, None).curves) == [0, 1, 1, 2]


def test_a_session_that_goes_on_counting_begins_a_placement():
    """With the session before it would have been one placement: its cycles go up."""
    board, nine = Board("p"), datetime(2026, 3, 1, 9)
    assert board.next_placement(Setup(6.0, 1.0), nine) == (None, "")
    assert board.next_placement(Setup(6.0, 1.0, cycle=3), nine) == ("1 (09:00:00)", "")


@pytest.mark.long
async def test_after_a_lost_link_only_what_is_left_is_taken_again(bedside, tmp_path):
    """Loadings were counted meanwhile, so all repeats were taken again: one suction too many."""
    faults = tmp_path / "faults" / "FAULTS.toml"
    faults.parent.mkdir()
    faults.write_text('[[fault]]\nkind = "unplug"\nat_s = 8.0\nfor_s = 4.0\n')
    async with bedside(f"sim://?seed=1&speed=5&faults={faults}") as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.fill("repeats", "2")
        await bed.fill("rest_s", "0")
        await bed.start()
        await bed.until(lambda: bed.board.alarm is not None)
        await bed.until(lambda: "the link is back" in bed.board.note)
        assert bed.board.left.repeats == 1
        await bed.confirm()
        await bed.until(lambda: bed.board.can_arm)
        await bed.check()
        said = bed.text("#card-text")
        assert "loading  3 of this site, probe not lifted (else Ins)" in said
        assert "repeats  once" in said
        await bed.press("insert")  # the alarm said that it is to be lifted
        await bed.run()
        assert bed.board.left is None
        setups = [e.setup for e in bed.board.entries.values()]
    assert [(s.cycle, s.repeat, s.placement is None) for s in setups] == [
        (1, 1, True), (2, 2, True), (3, 2, False),
    ]  # fmt: skip


def test_another_opening_counts_for_the_joint_fit_only_where_it_has_it():
    """After a later loading `j` was said to fit both openings, and left the second one out."""
    board = Board("p")
    board.see(Connected("p", HELLO))
    first, second = entry_of(1), entry_of(2)
    other = replace(second.curve.setup, aperture_mm=8.0)
    for cycle, words in ((2, "another opening after a rest (F6, F8)"), (1, "s, then j: fit")):
        second.curve = replace(second.curve, setup=replace(other, cycle=cycle))
        board.entries = {1: first, 2: second}
        board.shown = 2
        assert verdict_text(board).following.startswith(words)


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("ramp:400@16,ramp:0@16", "up to 400 mbar, 50 s under suction"),
        ("mode4:100@20,2,3", "up to 100 mbar, 15 s under suction, 5 s without a pause"),
    ],
)
def test_the_way_down_is_suction_too(program, words):
    """The summary said 25 s without a pause, of 50."""
    assert program_extent(parse_program(program)) == words


async def test_the_list_of_commands_has_it_where_a_keyboard_has_not(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("ctrl+p")
        await bed.on(PaletteScreen)
        await bed.press(*"anew", "enter")
        await bed.until(lambda: "begins a placement in any case" in bed.board.note)


async def test_what_is_to_be_put_on_several_times_says_how_that_is_told(bedside):
    async with bedside() as bed:
        await bed.connected()
        bed.app._missing_keys.load(8.0, "ramp:100@20", 3)
        assert bed.board.note == (
            "loaded: ramp:100@20, 8 mm opening; F8 goes on; put the probe on 3 times "
            "(Ins says so, or F6 once rested)"
        )
