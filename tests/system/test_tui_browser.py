"""The UI behind `textual serve`: its driver's packets over pipes, and no terminal."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Iterator

import pytest
from patience import patient_command

from skinlab.recording.session import read_session
from skinlab.tui.typing_guard import LOOK_S


class Browser:
    """What textual-serve is to the program that it starts."""

    def __init__(self, command: list[str]) -> None:
        environment = {
            **os.environ,
            "TEXTUAL_DRIVER": "textual.drivers.web_driver:WebDriver",
            "COLUMNS": "80",
            "ROWS": "24",
        }
        pipe = subprocess.PIPE
        self.program = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=environment
        )

    def ready(self) -> None:
        """Wait for the line with which such a program begins."""
        assert self.program.stdout.readline() == b"__GANGLION__\n"

    def send(self, kind: bytes, payload: bytes) -> None:
        self.program.stdin.write(kind + len(payload).to_bytes(4, "big") + payload)
        self.program.stdin.flush()

    def until(self, words: bytes) -> None:
        seen = b""
        while words not in seen:
            kind, size = self.program.stdout.read(1), self.program.stdout.read(4)
            assert kind, seen[-2000:]
            payload = self.program.stdout.read(int.from_bytes(size, "big"))
            seen += payload if kind == b"D" else b""


@pytest.fixture
def browser(tmp_path) -> Iterator[Browser]:
    port, sessions = "sim://?seed=1", str(tmp_path / "sessions")
    command = patient_command("skinlab", "ui", "--port", port, "--sessions", sessions)
    found = Browser(command)
    yield found
    found.program.kill()
    found.program.communicate()


def test_a_closed_page_vents_and_saves(browser, tmp_path):
    browser.ready()
    browser.until(b"connected;")
    browser.send(b"D", b"\x1b[19~")
    browser.until(b"whose skin")
    browser.send(b"D", b"\x1b[19~")
    browser.until(b"THIS WILL HAPPEN")
    time.sleep(2 * LOOK_S)
    browser.send(b"D", b"\x1b[20~")
    browser.until(b"not final")
    browser.send(b"M", json.dumps({"type": "quit"}).encode())
    while browser.program.stdout.read(4096):
        pass
    assert browser.program.wait(120.0) == 0
    (path,) = (tmp_path / "sessions").glob("*.h5")
    assert read_session(path).curves[0].partial
