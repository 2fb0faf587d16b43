"""Captures: written, read, decoded; and the worked example of docs/dialects.md."""

from __future__ import annotations

import importlib.util
import os
import stat
from pathlib import Path

import pytest

from drivers.capture import CaptureWriter, Chunk, Side, decode_capture, read_capture
from drivers.errors import LinkError, LocalProtocolError
from drivers.events import Damaged, Hello, Identify, InstrumentState, Sample, Start, State, Vent
from drivers.link import open_link
from drivers.passthrough import listen, open_software_side
from drivers.stream import StreamConnection, connect

HERE = Path(__file__).parent
CHUNKS = [
    Chunk(0.0, Side.SOFTWARE, b"?\r\n"),
    Chunk(0.25, Side.INSTRUMENT, bytes(range(256))),
    Chunk(1.123456, Side.INSTRUMENT, b"x"),
]


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "c.jsonl"
    with CaptureWriter(path, {"port": "COM3"}) as writer:
        for chunk in CHUNKS:
            writer.write(chunk)
            assert read_capture(path)[1][-1] == chunk  # on disk at once, not at the end
        assert writer.bytes_of == {Side.SOFTWARE: 3, Side.INSTRUMENT: 257}
    return path


def test_a_capture_reads_back(written):
    facts, chunks = read_capture(written)
    assert facts == {"schema": "skinlab.capture/1", "port": "COM3"}
    assert chunks == CHUNKS
    assert stat.S_IMODE(written.stat().st_mode) == 0o600


def test_a_line_that_was_cut_off_is_left_out(written):
    written.write_bytes(written.read_bytes()[:-1])
    assert read_capture(written)[1] == CHUNKS[:-1]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no such device here")
def test_a_full_disk_is_of_a_file_that_is_named(tmp_path):
    writer = CaptureWriter(tmp_path / "c.jsonl", {})
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, writer._file.fileno())
    os.close(full)
    for act in (lambda: writer.write(CHUNKS[0]), writer.close):
        with pytest.raises(OSError, match="No space left") as caught:
            act()
        assert caught.value.filename == str(tmp_path / "c.jsonl")


def test_a_capture_is_never_overwritten(written):
    with pytest.raises(FileExistsError):
        CaptureWriter(written, {})
    assert read_capture(written)[1] == CHUNKS


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("{}\n", "line 1"),
        ('{"schema": "other/1"}\n', "schema 'other/1'"),
        ('{"schema": "skinlab.capture/1"}\n{"time_s": 0, "from": "me", "hex": ""}\n', "line 2"),
        ('{"schema": "skinlab.capture/1"}\n[]\n', "line 2"),
        ("not json\n", "line 1"),
    ],
)
def test_what_is_no_capture_is_refused(tmp_path, text, says):
    path = tmp_path / "c.jsonl"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"c\.jsonl") as caught:
        read_capture(path)
    assert says in str(caught.value)


# ---- standing between ----------------------------------------------------------------------------


class Script:
    """A link that gives these pieces, one a read, and keeps what is written; then it is lost."""

    def __init__(self, *pieces):
        self.pieces = list(pieces)
        self.written = b""

    def read(self, max_bytes, timeout_s):
        if not self.pieces:
            raise LinkError("lost")
        return self.pieces.pop(0)

    def write(self, data):
        self.written += data

    def close(self):
        pass


def test_bytes_pass_both_ways_and_are_recorded():
    instrument, software = Script(b"", b"one", b"", b"two"), Script(b"?", b"", b"go", b"")
    seen: list[Chunk] = []
    times = iter(range(100))
    with pytest.raises(LinkError):
        listen(instrument, software, seen.append, lambda: next(times))
    assert instrument.written == b"?go"
    assert software.written == b"onetwo"
    assert [(chunk.side, chunk.data) for chunk in seen] == [
        (Side.SOFTWARE, b"?"), (Side.INSTRUMENT, b"one"), (Side.SOFTWARE, b"go"),
        (Side.INSTRUMENT, b"two"),
    ]  # fmt: skip
    assert [chunk.time_s for chunk in seen] == sorted(chunk.time_s for chunk in seen)


def test_alone_it_sends_nothing_and_ends_in_time():
    instrument = Script(b"one", b"", b"two", b"never")
    seen: list[Chunk] = []
    times = iter([0.0, 0.1, 0.1, 0.2, 0.3, 0.3, 0.9])
    listen(instrument, None, seen.append, lambda: next(times), seconds=0.5)
    assert [chunk.data for chunk in seen] == [b"one", b"two"]
    assert instrument.written == b""


@pytest.mark.parametrize("where", ["pty", "tcp"])
def test_the_softwares_side_is_a_port_like_any_other(where):
    url, side = open_software_side(where)
    try:
        side.write(b"into the void: nobody is there yet")
        for _ in range(2):  # a program can leave, and another one come
            software = open_link(url)
            software.write(b"hello")
            got = b""
            while len(got) < 5:
                got += side.read(100, 1.0)
            assert got == b"hello"
            side.write(b"answer\x00\xff")
            got = b""
            while not got.endswith(b"answer\x00\xff"):
                got += software.read(100, 0.1)
            software.close()
            if where == "tcp":
                assert side.read(100, 1.0) == b""  # it sees that nobody is there any more
    finally:
        side.close()


@pytest.mark.parametrize("where", ["tcp:70000", "tcp:x", "/dev/no-such-port"])
def test_a_place_that_cannot_be_is_refused(where):
    with pytest.raises(LinkError):
        open_software_side(where)


# ---- the worked example of docs/dialects.md ------------------------------------------------------


def toy_dialect():
    spec = importlib.util.spec_from_file_location("toy_dialect", HERE / "toy_dialect.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.DIALECT


SAMPLES = [
    Sample(0, 0.0, 0.0, 0.0, 0),
    Sample(1, 0.1, 10.1, 0.101, 0),
    Sample(2, 0.2, 20.0, 0.163, 0),
    Sample(4, 0.4, 40.1, 0.241, 0),
    Sample(5, 0.5, 49.9, 0.268, 0),
    Sample(6, 0.6, 60.0, 0.290, 0),
]


def test_the_toy_capture_says_what_the_docs_say():
    _, chunks = read_capture(HERE / "toy_capture.jsonl")
    said = list(decode_capture(chunks, toy_dialect()))
    software = [what for _, side, what in said if side is Side.SOFTWARE]
    assert software == [Identify(), Start(), Vent()]
    instrument = [what for _, side, what in said if side is Side.INSTRUMENT]
    assert isinstance(instrument[0], Hello)
    assert [what for what in instrument if isinstance(what, Sample)] == SAMPLES
    (damaged,) = [what for what in instrument if isinstance(what, Damaged)]
    assert damaged.data == b"\x00\x7fN 3 P 30.2 D 0.207\n"


def test_a_connection_reads_the_toy_dialect():
    _, chunks = read_capture(HERE / "toy_capture.jsonl")
    connection = connect(toy_dialect())
    assert isinstance(connection, StreamConnection)
    samples = []
    for chunk in chunks:
        if chunk.side is Side.INSTRUMENT and chunk.time_s < 1.9:
            connection.receive_data(chunk.data)
            while (event := connection.next_event()) is not None:
                samples += [event] if isinstance(event, Sample) else []
    assert samples == SAMPLES
    assert connection.send(Vent()) == b"STOP\n"
    with pytest.raises(LocalProtocolError, match="not under our control"):
        connection.send(Start())


def test_the_toys_own_frames_round_trip():
    toy = toy_dialect()
    for event in [*SAMPLES, State(InstrumentState.RUNNING, "GO")]:
        assert toy.decode_event(toy.encode_event(event))[0] == event
    for command in (Identify(), Start(), Vent()):
        assert toy.decode_command(toy.encode_command(command, 0))[0] == command
