"""An instrument that only streams, at the screen: it is waited for, and never started."""

from __future__ import annotations

import pytest
from streaming_instrument import AT_REST, TEXT, Wire, ramp

from drivers.line_dialect import line_dialect
from drivers.probe import Probe
from skinlab.acquisition.replay import differences, identifier_of, replay
from skinlab.recording.session import read_session
from skinlab.recording.stream import Identified


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
