"""`skinlab ui --serve`: who is let in, and a measurement in a real headless browser."""

from __future__ import annotations

import asyncio
import base64
import os
import re
import shutil
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

from skinlab.recording.session import read_session
from skinlab.tui.typing_guard import QUIET_S

pytest.importorskip("textual_serve")
aiohttp = pytest.importorskip("aiohttp")

PATIENCE_S = 120.0
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)


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


class Page:
    """A page of a headless browser, driven by its own protocol."""

    def __init__(self, socket_) -> None:
        self._socket = socket_
        self._number = 0
        self.seen = b""  # all that came to the page's screen

    async def send(self, method: str, **parameters) -> None:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        await self._socket.send_json(message)

    async def until(self, words: bytes) -> None:
        """Wait until these words came to the screen since the last time."""
        end = time.monotonic() + PATIENCE_S
        while words not in self.seen:
            assert time.monotonic() < end, self.seen[-3000:]
            message = await asyncio.wait_for(self._socket.receive_json(), PATIENCE_S)
            if message.get("method") == "Network.webSocketFrameReceived":
                response = message["params"]["response"]
                data = response["payloadData"]
                binary = response["opcode"] == 2
                frame = base64.b64decode(data) if binary else data.encode()
                self.seen += re.sub(rb"\x1b\[[0-9;?]*[A-Za-z]", b"", frame)
        self.seen = b""

    async def press(self, name: str, code: int, text: str = "") -> None:
        key = {"key": name, "code": name, "windowsVirtualKeyCode": code, "text": text}
        await self.send("Input.dispatchKeyEvent", type="keyDown", **key)
        await self.send("Input.dispatchKeyEvent", type="keyUp", **key)


async def drive(url: str, folder: Path) -> None:
    browser = await asyncio.create_subprocess_exec(
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--window-size=1200,800",
        "--remote-debugging-port=0", f"--user-data-dir={folder}", "about:blank",
        stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        line = b""
        while b"ws://" not in line:
            line = await asyncio.wait_for(browser.stderr.readline(), PATIENCE_S)
            assert line, "the browser ended"
        port = re.search(rb"ws://[^:]*:(\d+)/", line)[1].decode()
        async with aiohttp.ClientSession() as session:
            async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
                pages = await answer.json()
            (target,) = [p["webSocketDebuggerUrl"] for p in pages if p["type"] == "page"]
            async with session.ws_connect(target, max_msg_size=0) as socket_:
                page = Page(socket_)
                await page.send("Network.enable")
                await page.send("Page.navigate", url=url)
                await page.until(b"F8 shows what will happen")
                await asyncio.sleep(0)
                await page.press("F8", 119)
                await page.until(b"whose skin")
                await page.press("F8", 119)
                await page.until(b"THIS WILL HAPPEN")
                await asyncio.sleep(QUIET_S)
                await page.press("F9", 120)
                await page.until(b"Good curve")  # the verdict, and so the card
                await page.press("F8", 119)
                await page.until(b"THIS WILL HAPPEN")
                await asyncio.sleep(QUIET_S)
                await page.press("F9", 120)
                await page.until(b"Measuring curve 2")
                await page.press("v", 86, "v")
                await page.until(b"vent ordered")
                await page.until(b"cut short")
    finally:
        browser.kill()
        await browser.wait()


@pytest.mark.skipif(not CHROMIUM, reason="no browser is installed")
def test_measure_vent_and_read_the_card_in_a_browser(served, tmp_path):
    url, sessions = served
    asyncio.run(drive(url, tmp_path / "browser"))
    end = time.monotonic() + PATIENCE_S
    while not (found := list(sessions.glob("*.h5"))) or len(read_session(found[0]).curves) < 2:
        assert time.monotonic() < end
        time.sleep(0.1)
    curves = read_session(found[0]).curves
    assert [curve.partial for curve in curves] == [False, True]
