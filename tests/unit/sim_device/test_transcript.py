from __future__ import annotations

from pathlib import Path

from drivers.connection import STATES
from drivers.dialects.reference import crc16
from drivers.events import (
    Arm,
    Identify,
    InstrumentState,
    KeepAlive,
    Load,
    Segment,
    SegmentKind,
    Start,
    Vent,
)

WIRE = Path(__file__).parents[3] / "docs" / "wire.md"
PROGRAM = (
    Segment(SegmentKind.RAMP, target_mbar=10, rate_mbar_per_s=100),
    Segment(SegmentKind.HOLD, duration_s=0.1),
)
WORDS = {"Load": "LOAD", "Arm": "ARM", "Start": "START", "KeepAlive": "KEEP", "Reset": "RESET"}
VALVE = {"running": "as programmed"}


def transcript(bench) -> str:
    lines = []

    def said():
        lines.extend("< " + line for line in bench.device.transmit().decode("ascii").splitlines())

    def say(command, number=0):
        frame = bench.dialect.encode_command(command, number)
        lines.append("> " + frame.decode("ascii").rstrip())
        bench.device.receive(frame)
        said()

    say(Identify())
    say(Load(PROGRAM, 20, 10, 0.2), 0)
    say(Arm(), 1)
    say(Start(), 2)
    for _ in range(3):
        bench.device.process(0.1)
        said()
        say(KeepAlive())
    say(Load(PROGRAM, 5000, 10, 0.2), 3)
    say(Vent())
    bench.device.process(0.1)
    said()
    return "\n".join(lines)


def state_rows() -> str:
    rows = []
    for state in InstrumentState:
        row = STATES[state]
        commands = [WORDS[kind.__name__] for kind in row.commands if kind.__name__ in WORDS]
        rows.append(
            f"| {state} | {VALVE.get(state, 'open')} | {', '.join(sorted(commands)) or '–'} "
            f"| {', '.join(sorted(row.followers))} |"
        )
    return "\n".join(rows)


def test_the_transcript_in_the_documentation_is_what_the_code_says(make_bench):
    assert transcript(make_bench()) in WIRE.read_text(encoding="utf-8")


def test_the_state_table_in_the_documentation_is_the_codes():
    assert state_rows() in WIRE.read_text(encoding="utf-8")


def test_the_checksum_in_the_documentation():
    text = WIRE.read_text(encoding="utf-8")
    assert crc16(b"123456789") == 0x29B1
    assert "`29B1`" in text
    assert f"`{crc16(b'VENT'):04X}`" in text
    assert f"`$VENT*{crc16(b'VENT'):04X}`" in text
    assert crc16(b"VENT") == c_example(b"VENT")


def c_example(payload):
    """The C of the documentation."""
    crc = 0xFFFF
    for byte in payload:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc
