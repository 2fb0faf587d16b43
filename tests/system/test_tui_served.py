"""`skinlab ui --serve`: who is let in. What comes through the page is in test_tui_browser."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from patience import patient_command

pytest.importorskip("textual_serve")

PATIENCE_S = 120.0


@pytest.fixture
def served(tmp_path) -> Iterator[tuple[str, Path]]:
    """The address, and the folder of the sessions."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    sessions = tmp_path / "sessions"
    command = patient_command(
        "skinlab", "ui", "--serve", "--serve-port", str(port), "--port", "sim://?seed=1&speed=10",
        "--sessions", str(sessions),
    )  # fmt: skip
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "XDG_CONFIG_HOME": str(tmp_path)}
    program = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment, text=True
    )
    try:
        url = program.stdout.readline().strip()
        assert url.startswith(f"http://127.0.0.1:{port}/?token=")
        end = time.monotonic() + PATIENCE_S
        while not answers(port):
            assert time.monotonic() < end
            time.sleep(0.05)
        yield url, sessions
    finally:
        program.send_signal(signal.SIGINT)
        program.wait(PATIENCE_S)
        program.stdout.close()


def answers(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def status(url: str, headers: dict[str, str] | None = None) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers or {})) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_only_the_token_opens_the_page(served):
    url, _ = served
    plain, token = url.split("?token=")
    assert status(plain) == 403
    assert status(plain + "ws") == 403
    assert status(f"{plain}?token={token[:-1]}") == 403
    cookie = {"Cookie": f"skinlab={token}"}
    assert status(plain, cookie) == 200
    assert status(plain + "ws", {**cookie, "Origin": "http://elsewhere"}) == 403
