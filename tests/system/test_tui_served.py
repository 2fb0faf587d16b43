"""`skinlab ui --serve`: who is let in, and a visit in a real browser without a head."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from patience import patient_command

from skinlab.recording.session import Session, read_session
from skinlab.tui.typing_guard import LOOK_S, QUIET_S

pytest.importorskip("textual_serve")

PATIENCE_S = 120.0
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture
def served(tmp_path) -> Iterator[tuple[str, Path]]:
    """The address, and the folder of the sessions."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    sessions = tmp_path / "sessions"
    command = patient_command(
        "skinlab", "ui", "--serve", "--serve-port", str(port), "--port", "sim://?seed=1&speed=2",
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
        with error:
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


# ---- in a browser -------------------------------------------------------------------------------


class Tablet:
    """The page in a browser, and what has come to it."""

    def __init__(self, page) -> None:
        self.page = page
        self.errors: list[str] = []
        self.asked: list[str] = []
        self._shown = b""
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda said: said.type == "error" and self.errors.append(said.text))
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("websocket", lambda one: one.on("framereceived", self._frame))

    def _frame(self, payload: bytes | str) -> None:
        self._shown += payload if isinstance(payload, bytes) else b""

    def until(self, *words: str) -> None:
        """Wait until these words were drawn since the last time."""
        self.wait(lambda: all(word.encode() in self._shown for word in words), *words)
        self._shown = b""

    def wait(self, condition: Callable[[], object], *why: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, (why, self._shown[-2000:])
            self.page.wait_for_timeout(50)

    def touch(self, name: str) -> None:
        self.page.locator(f"#keys .{name}").click()

    def start(self) -> None:
        self.touch("check")
        self.until("THIS WILL HAPPEN", "repeats")
        self.page.wait_for_timeout(1000 * (LOOK_S + QUIET_S))
        self.touch("start")

    def closed(self) -> bool:
        return self.page.locator("#again").is_visible()


@pytest.fixture
def browser():
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip("no Chromium is installed")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield chromium
        chromium.close()


def only_session(folder: Path) -> Session:
    (path,) = folder.glob("*.h5")
    return read_session(path)


@pytest.mark.long
def test_a_visit_on_a_tablet(served, browser):
    url, sessions = served
    tablet = Tablet(browser.new_page(viewport={"width": 1024, "height": 768}))
    tablet.page.goto(url)
    tablet.until("connected;")
    assert "token" not in tablet.page.url  # it stays in no history
    tablet.touch("check")
    tablet.until("whose skin")
    tablet.page.keyboard.type("T1")
    tablet.start()
    tablet.until("Measuring", "SUCTION")
    tablet.touch("vent")
    tablet.until("cut short", "suction off")
    tablet.start()
    tablet.until("Good curve", "MPa", "stiffness at small stretch", "T1", "SIMULATED")
    picture = tablet.page.screenshot()
    assert len(set(picture)) > 200  # of 256 bytes: a picture, not a blank page

    second = Tablet(browser.new_page())
    second.page.goto(url)
    second.wait(second.closed)  # one page at a time
    assert "Another page is open" in second.page.locator("#words").inner_text()
    second.page.close()

    tablet.page.keyboard.press("q")
    tablet.until("Quit?", "F9 yes")
    tablet.page.wait_for_timeout(1000 * (LOOK_S + QUIET_S))
    tablet.page.keyboard.press("F9")
    tablet.wait(tablet.closed)
    assert "what was measured is saved" in tablet.page.locator("#words").inner_text()

    session = only_session(sessions)
    assert session.meta["subject"] == "T1"
    assert [curve.partial for curve in session.curves] == [True, False]
    assert tablet.errors == []
    assert {address.split("?")[0].rsplit("/", 1)[0] for address in tablet.asked} <= {
        url.split("/?")[0] + path for path in ("", "/static/css", "/static/js", "/static/fonts")
    }


def test_a_page_that_falls_silent_vents(served, browser):
    url, sessions = served
    tablet = Tablet(browser.new_page())
    tablet.page.goto(url)
    tablet.until("connected;")
    tablet.touch("edit")
    tablet.page.keyboard.press("Control+u")
    tablet.until("mode4")  # what the empty field says may be typed
    tablet.page.keyboard.type("ramp:100@20,hold:50")
    tablet.touch("check")
    tablet.until("whose skin")
    tablet.start()
    tablet.until("Measuring", "SUCTION")
    tablet.page.evaluate("send = () => {}")  # asleep; its socket stays open
    tablet.until("cut short", "suction off")
    tablet.page.close()
    end = time.monotonic() + PATIENCE_S
    while not list(sessions.glob("*.h5")):
        assert time.monotonic() < end
        time.sleep(0.05)
    assert only_session(sessions).curves[0].partial
