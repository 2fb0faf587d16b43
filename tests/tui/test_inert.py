"""Hostile text in every field of the screen: shown as symbols, and never as markup."""

from __future__ import annotations

import dataclasses
import html
import re
import unicodedata

from rich.segment import Segment
from textual.color import Color

from drivers.events import Alarm, HostVented, InstrumentFault
from skinlab.acquisition.messages import Connected, Heard
from skinlab.recording.stream import Happened
from skinlab.tui.inert import InertText

EVIL = "\x1b]0;evil\x07\x9b2J\u202e[red]x[/]"


def test_a_line_stays_as_wide_as_it_was_laid_out():
    line = [Segment("ab\x1b[31m"), Segment("  cd     ")]
    shown = InertText().apply(line, Color(0, 0, 0))
    assert Segment.get_line_length(shown) == Segment.get_line_length(line)
    assert "".join(s.text for s in shown).startswith("ab␛[31m  cd")
    plain = [Segment("plain ░▒ 漢")]
    assert InertText().apply(plain, Color(0, 0, 0)) is plain


def shown(bed) -> str:
    text = re.sub(r"<[^>]*>", "", bed.screenshot())
    return html.unescape(text).replace("\xa0", " ")


async def test_instrument_notes_and_reasons_cannot_act_on_the_terminal(bedside):
    async with bedside(size=(140, 40)) as bed:
        await bed.connected()
        board = bed.board
        hello = dataclasses.replace(board.hello, model=EVIL, firmware="1")
        board.see(Connected(board.port, hello, goes_on=True))
        for event in (HostVented(EVIL), InstrumentFault(7, EVIL)):
            board.see(Heard((Happened(event),)))
        bed.app.screen.draw()
        await bed.until(lambda: "instrument fault 7: ␛]0;evil" in shown(bed))
        assert "[red]x[/]" in shown(bed)
        assert not {unicodedata.category(c) for c in shown(bed)} & {"Cf", "Cs", "Zl", "Zp"}
        assert not {c for c in shown(bed) if unicodedata.category(c) == "Cc"} - {"\n"}
        await bed.press("s")
        await bed.until(lambda: bed.app.screen.query("#session-curves"))
        await bed.press("n")
        await bed.until(lambda: bed.app.screen.query_one("#session-line").has_focus)
        bed.app.screen.query_one("#session-line").value = "Anna Schmidt came [red]late[/]"
        await bed.press("enter")
        await bed.until(lambda: "looks like a name" in board.note)
        assert board.ledger.notes == []


async def test_an_alarm_with_hostile_text(bedside):
    async with bedside() as bed:
        await bed.connected()
        bed.app.post_message(bed.app.Said(Heard((Happened(Alarm(EVIL)),))))
        await bed.until(lambda: "␛]0;evil" in shown(bed))
        await bed.press("a")
