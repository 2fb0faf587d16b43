"""A study's protocol at the bedside: the screen walks through it, marks, and records."""

from __future__ import annotations

import pytest
from textual.widgets import Input

from skinlab.acquisition.protocol import read_protocol
from skinlab.recording.audit import entries
from skinlab.recording.session import read_session
from skinlab.report.session_report import SessionReport
from skinlab.tui.screens.protocol import ProtocolScreen

TEXT = """
[study]
title = "Winter forearms"
sites = ["forearm, volar, left", "forearm, volar, right"]

[conditions]
room_temperature_c = [20.0, 24.0]
operator = true

[acceptance]
verdict = "any"

[[step]]
name = "first"
aperture_mm = 6.0
program = "ramp:50@20"
rest_s = 1.0

[[step]]
aperture_mm = 6.0
program = "ramp:100@20"
rest_before_s = 60.0
"""


@pytest.fixture
def protocol(tmp_path):
    folder = tmp_path / "study"
    folder.mkdir()
    path = folder / "p.toml"
    path.write_text(TEXT)
    return read_protocol(path)


async def state(bed, *answers):
    """State the conditions, one after the other."""
    await bed.press("p")
    await bed.on(ProtocolScreen)
    await bed.press("e")
    for answer in answers:
        line = bed.app.screen.query_one(Input)
        await bed.until(lambda line=line: line.has_focus)
        line.value = answer
        await bed.press("enter")
    return bed.app.screen


@pytest.mark.long
async def test_a_protocol_is_walked_through_marked_and_recorded(
    bedside, protocol, tmp_path, identifier, empty_pictures
):
    async with bedside(protocol=protocol, size=(100, 40)) as bed:
        await bed.connected()
        await bed.fill("subject", "P01")
        await bed.until(
            lambda: "protocol step 1 of 2: first; F7 loads it" in bed.text("#verdict-next")
        )
        await bed.press("f7")
        await bed.until(lambda: bed.app.screen.query_one("#program").value == "ramp:50@20")
        site = bed.app.screen.query_one("#site")
        await bed.until(lambda: site.value == "forearm, volar, left")
        await bed.check()
        await bed.until(lambda: "protocol step 1 of 2: first" in bed.text("#card-text"))
        assert "not stated: room temperature, operator" in bed.text("#card-text")
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm and bed.board.review is None)

        await state(bed, "warm")
        await bed.until(lambda: "expected -20 to 60 °C" in bed.text("#protocol-question"))
        bed.app.screen.query_one(Input).value = "26"
        await bed.press("enter")
        bed.app.screen.query_one(Input).value = "OP-1"
        await bed.press("enter")
        await bed.until(lambda: "operator OP-1" in bed.text("#protocol-text"))
        assert "! room temperature 26 °C, not 20 to 24" in bed.text("#protocol-text")
        await bed.press("p")
        await bed.run()  # it is marked, and not refused
        await bed.until(lambda: "protocol step 2 of 2" in bed.text("#verdict-next"))

        await bed.press("f7")
        await bed.until(lambda: bed.app.screen.query_one("#program").value == "ramp:100@20")
        await bed.check()
        await bed.until(lambda: "the site is to rest" in bed.text("#card-text"))
        await bed.press("f9")
        await bed.until(lambda: len(bed.board.entries) == 2)
        await bed.until(lambda: bed.board.entry.result is not None and bed.board.can_arm)
        await bed.until(lambda: "F7 goes on to forearm, volar, right" in bed.text("#verdict-next"))
        await bed.fill("program", "ramp:80@20")
        await bed.check()
        await bed.until(lambda: "no step asks for this" in bed.text("#card-text"))
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm and bed.board.review is None)
        await bed.press("f7")
        await bed.until(lambda: site.value == "forearm, volar, right")
        await bed.until(lambda: bed.app.screen.query_one("#program").value == "ramp:50@20")
        await bed.quit()

    (path,) = tmp_path.glob("*.h5")
    session = read_session(path)
    trail = entries(session.records)
    assert [e.detail["title"] for e in trail if e.what == "protocol"] == ["Winter forearms"]
    otherwise = [e.detail["text"] for e in trail if e.what == "protocol deviation"]
    assert otherwise[0] == "room temperature 26 °C, not 20 to 24"
    assert any("is to rest" in text for text in otherwise)
    page = SessionReport(session, identifier).html()
    assert "Winter forearms. All steps are done." in page
    assert "26 °C, not 20 to 24" in page
    assert "1 × 6 mm, ramp:50@20" in page


async def test_without_a_protocol_p_says_how_to_follow_one(bedside):
    async with bedside() as bed:
        await bed.connected()
        await bed.press("p")
        await bed.until(lambda: "skinlab ui --protocol FILE" in bed.board.aside)
        await bed.quit()


@pytest.mark.long
async def test_conditions_belong_to_a_subject_and_the_operator_stays(bedside, protocol):
    async with bedside(protocol=protocol) as bed:
        await bed.connected()
        await state(bed, "22", "OP-1")  # before anybody is named: for whoever comes next
        await bed.press("p")
        await bed.fill("subject", "P01")
        await bed.until(lambda: bed.board.who[0] == "P01")
        assert bed.board.stated["room_temperature_c"] == "22"
        await bed.run()
        await bed.fill("subject", "P02")
        await bed.until(lambda: bed.board.who[0] == "P02")
        assert bed.board.stated == {"operator": "OP-1"}
        await bed.fill("subject", "P01")
        await bed.until(lambda: bed.board.stated.get("room_temperature_c") == "22")
        await bed.quit()
