"""Dialects that are one TOML file: what is read, and what is refused with the field's name."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.capabilities import Capabilities
from drivers.capture import decode_capture, read_capture
from drivers.dialects import (
    describe_dialect,
    described_dialect,
    dialect_names,
    get_dialect,
    split_dialect,
)
from drivers.errors import DialectFileError, RemoteProtocolError, UnknownDialectError
from drivers.events import Damaged, KeepAlive, Reading, Sample, Start, State, Vent
from drivers.line_dialect import CHECKSUMS, IGNORED, line_dialect
from drivers.probe import choose_dialect
from drivers.stream import StreamConnection, follow_mark

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[2] / "examples" / "dialects" / "plain_line.toml"

PLAIN = r"""
[dialect]
name = "mine"
pattern = '(?P<pressure>\S+) (?P<deflection>\S+)'
[columns.pressure]
unit = "mbar"
[columns.deflection]
unit = "mm"
[stream]
rate_hz = 50
"""


def plain(old: str = "", new: str = "", *, more: str = "") -> str:
    assert old in PLAIN
    return PLAIN.replace(old, new) + more


def reading(text: str, line: str) -> Reading:
    event, number = line_dialect(text, "mine.toml").decode_event(line.encode("latin-1") + b"\n")
    assert isinstance(event, Reading)
    assert number is None
    return event


def test_the_example_reads_its_captured_transcript():
    _, chunks = read_capture(HERE / "plain_line_capture.jsonl")
    dialect = get_dialect(str(EXAMPLE))
    said = [what for _, _, what in decode_capture(chunks, dialect)]
    readings = [what for what in said if isinstance(what, Reading)]
    assert readings[0] == Reading(0.0, 0.0, 0.0)
    assert readings[-1] == Reading(12.5, 0.1304, 0.625)
    reasons = [what.reason for what in said if isinstance(what, Damaged)]
    assert reasons == [IGNORED, "checksum '00', not 5F"]

    connection = StreamConnection(dialect)
    connection.mark(follow_mark(None))
    events = []
    for chunk in chunks:
        connection.receive_data(chunk.data)
        while (event := connection.next_event()) is not None:
            events.append(event)
    states = [event.state.value for event in events if isinstance(event, State)]
    assert states == ["armed", "running"]
    assert [e.pressure_mbar for e in events if isinstance(e, Sample)][-1] == 12.5


@pytest.mark.parametrize(
    ("unit", "mbar"),
    [("mbar", 25.0), ("hPa", 25.0), ("Pa", 0.25), ("kPa", 250.0), ("mmHg", 33.330596)],
)
def test_units_of_pressure(unit, mbar):
    found = reading(plain('"mbar"', f'"{unit}"'), "25 0.1").pressure_mbar
    assert found == pytest.approx(mbar, rel=1e-6)


@pytest.mark.parametrize(("unit", "mm"), [("mm", 250.0), ("µm", 0.25), ("um", 0.25)])
def test_units_of_deflection(unit, mm):
    assert reading(plain('"mm"', f'"{unit}"'), "1 250").deflection_mm == mm


@pytest.mark.parametrize(("unit", "s"), [("s", 1500.0), ("ms", 1.5), ("µs", 0.0015)])
def test_units_of_time(unit, s):
    text = plain(r"(?P<deflection>\S+)", r"(?P<deflection>\S+) (?P<time>\d+)")
    text += f'[columns.time]\nunit = "{unit}"\n'
    assert reading(text, "1 0.1 1500").time_s == s


def test_scale_offset_decimal_comma_and_count():
    text = plain('name = "mine"', 'name = "mine"\ndecimal = ","').replace(
        'unit = "mbar"', 'unit = "mbar"\nscale = -1\noffset = 1013.25'
    )
    text = text.replace(r"(?P<deflection>\S+)", r"(?P<deflection>\S+) (?P<sequence>\d+)")
    found = reading(text + "[columns.sequence]\n", "1003,25 0,25 7")
    assert found == Reading(10.0, 0.25, None, 7)


@pytest.mark.parametrize(
    ("kind", "check"),
    [("xor8", 0x31), ("sum8", 0xDD), ("crc16-ccitt-false", 0x29B1), ("crc16-xmodem", 0x31C3),
     ("crc16-modbus", 0x4B37)],
)  # fmt: skip
def test_checksums_have_their_published_check_values(kind, check):
    assert CHECKSUMS[kind](b"123456789") == check
    text = (
        plain(r"(?P<deflection>\S+)", r"(?P<deflection>\S+) (?P<checksum>[0-9A-F]+)")
        + f'[checksum]\nkind = "{kind}"\n'
    )
    good = CHECKSUMS[kind](b"12 0.5 ")
    assert reading(text, f"12 0.5 {good:02X}").pressure_mbar == 12.0
    with pytest.raises(RemoteProtocolError, match="checksum"):
        reading(text, f"12 0.6 {good:02X}")


def test_commands_are_known_and_start_is_never_sent():
    text = plain(more='[commands]\nstart = "GO\\r"\nvent = "OPEN\\r"\nkeep_alive = "."\n')
    dialect = line_dialect(text, "mine.toml")
    assert dialect.capabilities == Capabilities(vent=True, keep_alive=True)
    assert not dialect.capabilities.controllable
    assert dialect.encode_command(Vent(), 0) == b"OPEN\r"
    assert dialect.decode_command(b"GO\r\n")[0] == Start()  # in a capture
    connection = StreamConnection(dialect)
    assert connection.send(KeepAlive()) == b"."
    with pytest.raises(Exception, match="not under our control"):
        connection.send(Start())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[dialect", "no TOML"),
        (plain("name", "nmae"), "dialect.name is missing"),
        (plain(more="[strem]\n"), "strem is not known; expected one of: dialect"),
        (plain('"mine"', '"my dialect"'), "dialect.name is 'my dialect'"),
        (plain('"mine"', '"mine"\nversion = "1"'), "dialect.version is '1'; expected a whole"),
        (plain('"mbar"', '"bar"'), "columns.pressure.unit is 'bar'; expected one of: mbar"),
        (plain("<pressure>", "<pres>"), "no group (?P<pressure>...)"),
        (plain(r"\S+)'", r"\S+)(?P<foo>x)'"), "a group 'foo', which is not a column"),
        (plain(r"\S+)'", r"\S+)(?P<sequence>\d)'"),
         "columns.sequence is missing: dialect.pattern has a group 'sequence'; expected a table"),
        (plain(r"\S+)'", r"\S+'"), "dialect.pattern is not a regular expression"),
        (plain(r"(?P<pressure>\S+)", r"(?P<pressure>(?:\d+)+)"), "a group is repeated"),
        (plain(r"(?P<pressure>\S+)", r"(?P<pressure>(a|a)*)"), "a group is repeated"),
        (plain(r"(?P<pressure>\S+)", r"(?P<pressure>\d*[0-9]*\d*[0-9]*x)"),
         "dialect.pattern: 4 repeats in a row may each take '9'; expected 3 at most"),
        (plain(r"(?P<pressure>\S+)", r"(?P<pressure>%sx)" % (r"\d{0,8}[0-9]{0,8}" * 4)),
         "8 repeats in a row"),
        (plain(r"(?P<pressure>\S+)", r"(?P<pressure>[\d.]*[\d ]?[\d.]+(a|\d*)[^x]*x)"),
         "4 repeats in a row"),
        (plain(r"\S+) ", r"\S+).*,.*,.*,"), "`.` is repeated 3 times"),
        (plain(r"(?P<pressure>\S+)", r"(?P<pressure>%s)" % ("1?" * 30)), "`?` stands 30 times"),
        (plain("rate_hz = 50"), "stream.rate_hz is missing"),
        (plain("rate_hz = 50", "rate_hz = -1"), "stream.rate_hz must be positive"),
        (plain("rate_hz = 50", "rate_hz = 50\naperture_mm = 5"),
         "stream.aperture_mm is 5; expected one of 2, 4, 6, 8 (the diameter)"),
        (plain("rate_hz = 50", "rate_hz = 50\naperture_mm = 0"), "aperture_mm is 0; expected one"),
        (plain("rate_hz = 50", "rate_hz = 50\naperture_mm = nan"), "aperture_mm is nan; expected"),
        (plain("rate_hz = 50", "rate_hz = 50\nzero_mbar = 9"), "must be below begin_mbar"),
        (plain(more='[checksum]\nkind = "md5"\n'), "checksum.kind is 'md5'; expected one of: xor8"),
        (plain(more='[commands]\nvent = ""\n'), "commands.vent is ''"),
        (plain(more='[[example]]\nline = "x"\npressure_mbar = 1\ndeflection_mm = 1\n'),
         "example 1: 'x' is not understood"),
        (plain(more='[[example]]\nline = "1 1"\npressure_mbar = 2\ndeflection_mm = 1\n'),
         "example 1: pressure_mbar is read as 1.0; expected 2"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said_in_a_sentence(text, words):
    with pytest.raises(DialectFileError) as raised:
        line_dialect(text, "mine.toml")
    assert str(raised.value).startswith("mine.toml: ")
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_an_example_may_be_rounded():
    more = '[[example]]\nline = "75.006 512.3"\npressure_mbar = 100\ndeflection_mm = 0.512\n'
    line_dialect(plain('"mbar"', '"mmHg"', more=more).replace('"mm"', '"µm"'), "mine.toml")


def test_lines_without_an_end_do_not_fill_the_memory():
    dialect = line_dialect(PLAIN, "mine.toml")
    buffer = bytearray(b"1" * 10_000)
    while dialect.take(buffer) is not None:
        pass
    assert len(buffer) <= 250


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_pieces_do_not_matter(cut):
    dialect = line_dialect(PLAIN, "mine.toml")
    data = b"1 2\r\n\r\n" + b"x" * 300 + b"\n3 4\n\xff\n"
    buffer, taken = bytearray(), []
    for k in range(0, len(data), cut):
        buffer += data[k : k + cut]
        while (item := dialect.take(buffer)) is not None:
            taken.append(item)
    assert [t for t in taken if isinstance(t, bytes)] == [b"1 2\r\n", b"x" * 60 + b"\n", b"3 4\n",
                                                          b"\xff\n"]  # fmt: skip


@pytest.mark.parametrize("line", ["", "nan 1", "inf 1", "1e99 1", "1_0 1", "1", "1 2 3", "½ 1"])
def test_damaged_lines_blame_the_other_side(line):
    with pytest.raises(RemoteProtocolError):
        reading(PLAIN, line)


def test_a_session_keeps_all_that_is_needed_to_read_it_again():
    dialect = line_dialect(PLAIN, "mine.toml")
    said = describe_dialect(dialect)
    again = described_dialect(said)
    assert (again.name, again.capabilities) == ("mine", dialect.capabilities)
    with pytest.raises(ValueError, match="does not agree with its hash"):
        described_dialect({**said, "toml": PLAIN + "# more\n"})
    with pytest.raises(ValueError, match="needs version 2"):
        described_dialect({**describe_dialect(get_dialect("reference")), "version": 2})
    for nonsense in (None, {}, {"name": 3}, {"name": "../x.toml", "version": 1}):
        with pytest.raises(ValueError, match=r"dialect"):
            described_dialect(nonsense)


@pytest.mark.parametrize(
    ("url", "port", "name"),
    [
        ("/dev/ttyUSB0", "/dev/ttyUSB0", None),
        ("/dev/ttyUSB0?dialect=mine.toml", "/dev/ttyUSB0", "mine.toml"),
        ("/dev/ttyUSB0?baud=9600&dialect=a%20b.toml", "/dev/ttyUSB0?baud=9600", "a b.toml"),
        ("socket://h:1?dialect=x&logging=debug", "socket://h:1?logging=debug", "x"),
        ("sim://?skin=a/b.toml&seed=1", "sim://?skin=a/b.toml&seed=1", None),
    ],
)
def test_a_url_names_its_dialect(url, port, name):
    assert split_dialect(url) == (port, name)


def test_an_unknown_dialect_lists_those_that_there_are():
    for url, name in (("COM3", "klingon"), ("COM3?dialect=klingon", None)):
        with pytest.raises(UnknownDialectError) as raised:
            choose_dialect(url, name)
        for known in dialect_names():
            assert known in str(raised.value)
    for url in ("COM3?dialect=", "COM3?dialect=a&dialect=b"):
        with pytest.raises(UnknownDialectError, match="once"):
            choose_dialect(url)
    with pytest.raises(UnknownDialectError, match="was asked for"):
        choose_dialect("COM3?dialect=a", "b")


def test_a_number_that_nobody_can_read_is_a_sentence():
    with pytest.raises(DialectFileError, match=r"a\.toml: no TOML"):
        line_dialect(f"[dialect]\nversion = {'9' * 5000}\n", "a.toml")


def test_a_pattern_that_python_warns_of_is_a_sentence():
    text = plain(r"(?P<pressure>\S+)", "(?P<pressure>[0--9]+)")
    with pytest.raises(DialectFileError, match="not a regular expression: Possible set difference"):
        line_dialect(text, "a.toml")
