from __future__ import annotations

from pathlib import Path

from drivers.connection import STATES
from drivers.dialects import get_dialect
from drivers.dialects.reference import crc16
from drivers.events import (
    Abilities,
    Arm,
    Command,
    Hello,
    Identify,
    InstrumentFault,
    InstrumentState,
    KeepAlive,
    Load,
    Loaded,
    Refused,
    Reset,
    Sample,
    Segment,
    SegmentKind,
    Start,
    State,
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


# ---- test vectors, and every command in every state ----------------------------------------------

HELLO = Hello(
    "reference", 1, "rig, 2nd", "0.9", "№ 7", 6.0, 450.0, 30.0, 1.0, 1000.0, False, 20.0
)  # fmt: skip
WHOLE = (
    Segment(SegmentKind.RAMP, target_mbar=100, rate_mbar_per_s=20),
    Segment(SegmentKind.HOLD, duration_s=1.5),
    Segment(SegmentKind.RELEASE),
    Segment(SegmentKind.REST, duration_s=2),
)
TO_A_HEIGHT = (
    Segment(SegmentKind.UNTIL, target_mbar=150, rate_mbar_per_s=20, height_mm=0.4),
    Segment(SegmentKind.HOLD, duration_s=1),
)
VECTORS = (
    (Identify(), 0),
    (Load(WHOLE, 20, 100, 6.5), 7),
    (Load(TO_A_HEIGHT, 20, 150, 8.5), 7),
    (Arm(), 8),
    (Start(), 9),
    (Vent(), 0),
    (KeepAlive(), 0),
    (Reset(), 65535),
    (HELLO, 0),
    (Abilities(until=True), 0),
    (Loaded(WHOLE, 20, 100, 6.5), 7),
    (State(InstrumentState.RUNNING, "started", 0.0), 0),
    (State(InstrumentState.VENTING, "program end", -0.2), 0),
    (State(InstrumentState.IDLE, "", None), 0),
    (Sample(120, 6.0, 99.9, 1.234567, 1), 0),
    (Sample(121, 6.05, -0.1, -0.003, 4), 0),
    (InstrumentFault("pressure", "112.3 mbar, above 100"), 0),
    (Refused("Load", "rate 5000 Hz is outside 1 to 1000 Hz"), 3),
)


def vectors() -> str:
    dialect = get_dialect("reference")
    lines = []
    for said, number in VECTORS:
        command = isinstance(said, Command)
        encode = dialect.encode_command if command else dialect.encode_event
        frame = encode(said, number).decode("ascii").rstrip()
        lines.append(f"{'>' if command else '<'} {frame}")
    return "\n".join(lines)


def in_state(make_bench, state):
    """A bench whose device is in this state."""
    bench = make_bench()
    load = Load(
        (Segment(SegmentKind.RAMP, target_mbar=90, rate_mbar_per_s=900), *PROGRAM), 5, 90, 9
    )
    steps = {
        InstrumentState.IDLE: [],
        InstrumentState.LOADED: [load],
        InstrumentState.ARMED: [load, Arm()],
        InstrumentState.RUNNING: [load, Arm(), Start()],
        InstrumentState.VENTING: [load, Arm(), Start()],
        InstrumentState.FAULT: [load, Arm(), Start()],
    }[state]
    bench.tell(*steps)
    if state in {InstrumentState.VENTING, InstrumentState.FAULT}:
        bench.device.process(0.12)
        if state is InstrumentState.VENTING:
            bench.tell(Vent())
        else:
            bench.device.plant.pressure_mbar = 300.0
            bench.device.process(0.002)
    bench.hear()
    assert bench.device.state is state
    return bench


ASKED = {"ID": Identify(), "LOAD": None, "ARM": Arm(), "START": Start(), "RESET": Reset(),
         "VENT": Vent(), "KEEP": KeepAlive()}  # fmt: skip
SHORT = {Hello: "HELLO", Abilities: "CAN", Loaded: "LOADED", Refused: "REFUSED", Sample: "S"}


def answers(make_bench) -> str:
    lines = []
    for word, command in ASKED.items():
        cells = []
        for state in InstrumentState:
            bench = in_state(make_bench, state)
            asked = Load(PROGRAM, 20, 10, 0.2) if command is None else command
            said = [
                f"STATE {event.state}" if isinstance(event, State) else SHORT[type(event)]
                for event in bench.tell(asked)
            ]
            cells.append(", ".join(said) or "–")
        lines.append(f"| {word} | {' | '.join(cells)} |")
    return "\n".join(lines)


def test_the_vectors_in_the_documentation_are_the_codes():
    assert vectors() in WIRE.read_text(encoding="utf-8")
    dialect = get_dialect("reference")
    for line, (said, _) in zip(vectors().splitlines(), VECTORS, strict=True):
        frame = line[2:].encode("ascii") + b"\r\n"
        decode = dialect.decode_command if line[0] == ">" else dialect.decode_event
        assert decode(frame)[0] == said


def test_the_answers_in_the_documentation_are_the_devices(make_bench):
    assert answers(make_bench) in WIRE.read_text(encoding="utf-8")
