"""Import on a terminal and in a pipe, watch and capture as processes."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.capture import Side, decode_capture, read_capture
from drivers.connection import Connection
from drivers.dialects import get_dialect
from drivers.events import Identify, State
from drivers.link import open_link
from skinlab.recording.session import read_session

SKINLAB = [sys.executable, "-m", "skinlab"]
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
SKIN = ["--aperture-mm", "6", "--thickness-mm", "1"]
PATIENCE_S = 300.0
UNCLEAR, ANOTHER = (  # of two curves: a copy is refused
    "t (s);pressure;w (mm)\n" + "".join(f"{0.1 * i:.1f};{i};{slope * i:.3f}\n" for i in range(51))
    for slope in (0.006, 0.005)
)


def start(cwd: Path, *arguments: str, **more) -> subprocess.Popen[str]:
    more.setdefault("stdin", subprocess.DEVNULL)
    return subprocess.Popen(
        [*SKINLAB, *arguments],
        cwd=cwd,
        env={**ENVIRONMENT, "XDG_CONFIG_HOME": str(cwd / "settings")},
        stdout=subprocess.PIPE,
        stderr=more.pop("stderr", subprocess.PIPE),
        text=True,
        **more,
    )


@pytest.mark.long
def test_what_is_ambiguous_fails_in_a_pipe_and_is_asked_for_on_a_terminal(tmp_path):
    (tmp_path / "a.txt").write_text(UNCLEAR)
    (tmp_path / "b.txt").write_text(ANOTHER)
    arguments = ["import", "a.txt", "b.txt", *SKIN, "--out", "s.h5"]
    piped = start(tmp_path, *arguments)
    out, err = piped.communicate(timeout=PATIENCE_S)
    assert (piped.returncode, out) == (3, "")
    assert "a.txt: line 1: the unit of the pressure (column 'pressure') is not known" in err
    assert "--pressure-unit mbar or bar or hPa or kPa or Pa or mmHg" in err
    assert not (tmp_path / "s.h5").exists()

    terminal, its_end = pty.openpty()
    process = start(tmp_path, *arguments, stdin=its_end, stderr=its_end)
    os.close(its_end)
    shown = b""
    while b"--pressure-unit" not in shown:
        shown += os.read(terminal, 1000)
    os.write(terminal, b"lunch\nkPa\n")
    try:
        while chunk := os.read(terminal, 1000):
            shown += chunk
    except OSError:
        pass  # Linux says so when the other end is closed: the process has ended
    out, _ = process.communicate(timeout=PATIENCE_S)
    os.close(terminal)
    assert (process.returncode, out) == (0, "session: s.h5\n")
    assert b"'lunch' is not one of" in shown
    assert shown.count(b"is not known") == 1  # the second file has the same answer
    for curve in read_session(tmp_path / "s.h5").curves:
        assert curve.pressure_mbar[-1] == 500.0

    piped = start(tmp_path, *arguments[:-1], "t.h5")  # the answer was kept
    _, err = piped.communicate(timeout=PATIENCE_S)
    assert piped.returncode == 0, err
    assert err.count("--pressure-unit kPa, as answered before") == 2
    out, _ = start(tmp_path, "import", "--show-answers").communicate(timeout=PATIENCE_S)
    assert "files with the headings t (s); pressure; w (mm): --pressure-unit kPa" in out
    piped = start(tmp_path, *arguments[:-1], "u.h5", "--ask-again")
    assert piped.communicate(timeout=PATIENCE_S)[0] == ""
    assert piped.returncode == 3


@pytest.mark.long
def test_watch_takes_files_as_they_land_and_keeps_them_when_interrupted(tmp_path):
    exports = tmp_path / "exports"
    exports.mkdir()
    good, more = (text.replace("pressure", "p (mbar)") for text in (UNCLEAR, ANOTHER))
    (exports / "old.txt").write_text(good)
    process = start(
        tmp_path, "watch", "exports", *SKIN, "--settle-s", "0.1", "--out", "s.h5", "--json"
    )
    assert process.stderr is not None

    def wait_for(words: str) -> None:
        for line in process.stderr:
            if words in line:
                return
        pytest.fail(f"the watch ended before it said {words!r}")

    wait_for("exports/old.txt: UTF-8")
    (exports / "bad.txt").write_text("rubbish")
    wait_for("skinlab: exports/bad.txt: no table found")
    (tmp_path / "new").write_text(more)
    (tmp_path / "new").rename(exports / "new.txt")
    wait_for("exports/new.txt: UTF-8")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in err
    document = json.loads(out)
    assert [entry["file"] for entry in document["curves"]] == ["old.txt", "bad.txt", "new.txt"]
    assert [entry["error"] is None for entry in document["curves"]] == [True, False, True]
    assert document["session"] == "s.h5"
    session = read_session(tmp_path / "s.h5")
    assert [curve.name for curve in session.curves] == ["old.txt", "new.txt"]
    assert [result["file"] for result in session.results] == ["old.txt", "new.txt"]


@pytest.mark.parametrize("through", ["pty", "tcp"])
def test_capture_stands_between_a_probe_and_its_software(tmp_path, through):
    capture = start(
        tmp_path, "capture", "--port", "sim://?seed=1", "--through", through, "--out", "c.jsonl"
    )
    assert capture.stdout is not None
    software = open_link(capture.stdout.readline().strip())
    connection = Connection(get_dialect("reference"))
    software.write(connection.send(Identify()))
    heard = []
    while State not in map(type, heard):
        connection.receive_data(software.read(4096, 0.1))
        while (event := connection.next_event()) is not None:
            heard.append(event)
    software.close()
    capture.send_signal(signal.SIGINT)
    _, err = capture.communicate(timeout=PATIENCE_S)
    assert capture.returncode == 130
    assert "bytes from the instrument" in err
    assert "Traceback" not in err
    facts, chunks = read_capture(tmp_path / "c.jsonl")
    assert facts["through"] == through
    said = [(side, what) for _, side, what in decode_capture(chunks, get_dialect("reference"))]
    assert said == [
        (Side.SOFTWARE, Identify()),
        *((Side.INSTRUMENT, event) for event in heard),
    ]
