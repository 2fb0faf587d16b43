"""The real program in a real terminal."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from patience import patient_command

from skinlab.recording.session import Session, read_session
from skinlab.tui.typing_guard import QUIET_S

pytestmark = pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed")

PATIENCE_S = 120.0
GLIMPSE_S = 3.0
LONG = "ramp:100@2"  # 50 s, of which 1 s is waited for


class Terminal:
    """A program in a tmux of its own."""

    def __init__(
        self, folder: Path, size: tuple[int, int], port: str, program: str, *, colour: bool = True
    ) -> None:
        self._colour = {} if colour else {"NO_COLOR": "1"}
        self.sessions = folder / "sessions"
        self._settings = folder / "settings"
        kept = self._settings / "skinlab" / "ui.json"  # of the last time, as if there was one
        kept.parent.mkdir(parents=True)
        kept.write_text(json.dumps({"program": program}))
        self._socket = str(folder / "tmux")
        columns, rows = size
        command = patient_command("skinlab", "ui", "--port", port)
        command += ["--sessions", str(self.sessions)]
        # `sh` stays, so that what is left on the screen can be read.
        line = f"{shlex.join(command)}; echo exit status $?; read end"
        self._tmux(
            "-f", "/dev/null", "new-session", "-d", "-x", str(columns), "-y", str(rows), line
        )

    def _tmux(self, *arguments: str) -> str:
        done = subprocess.run(
            ["tmux", "-S", self._socket, *arguments],
            check=True,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            env={
                **os.environ,
                "OPENBLAS_NUM_THREADS": "1",
                "LC_ALL": "C.UTF-8",
                "SHELL": "/bin/sh",
                "XDG_CONFIG_HOME": str(self._settings),
                **self._colour,
            },
        )
        return done.stdout

    def write_over(self, text: str) -> None:
        """Write to the terminal behind the program's back."""
        Path(self._tmux("list-panes", "-F", "#{pane_tty}").strip()).write_text(text)

    def press(self, *keys: str) -> None:
        self._tmux("send-keys", *keys)

    def send(self, data: bytes) -> None:
        """Let the terminal send these bytes."""
        self._tmux("send-keys", "-H", *(f"{byte:02x}" for byte in data))

    def screen(self) -> str:
        return self._tmux("capture-pane", "-p")

    def until(self, condition: Callable[[str], object]) -> str:
        end = time.monotonic() + PATIENCE_S
        while not condition(screen := self.screen()):
            assert time.monotonic() < end, screen
            time.sleep(0.05)
        return screen

    def await_glimpse(self, word: str) -> None:
        """Wait for what may come and go between two looks, but no longer than that takes."""
        end = time.monotonic() + GLIMPSE_S
        while word not in self.screen() and time.monotonic() < end:
            time.sleep(0.02)

    def until_all(self, *words: str) -> str:
        """Wait for a screen with all of these; a frame may be caught half drawn."""
        return self.until(lambda screen: all(word in screen for word in words))

    def insist(self, key: str, condition: Callable[[str], object]) -> str:
        """Press a key until the screen answers: on a busy computer F9 may come too early."""
        end = time.monotonic() + PATIENCE_S
        while True:
            self.press(key)
            again = time.monotonic() + 4.0
            while time.monotonic() < again:
                if condition(screen := self.screen()):
                    return screen
                time.sleep(0.05)
            assert time.monotonic() < end, screen

    def confirm(self, key: str = "F9") -> str:
        """Confirm what is shown, once nothing was typed for long enough."""
        time.sleep(QUIET_S)
        return self.insist(
            key, lambda screen: "THIS WILL HAPPEN" not in screen and "F9 yes" not in screen
        )

    def program(self) -> int:
        """Process number of the program: the child of the terminal's shell."""
        shell = int(self._tmux("display-message", "-p", "#{pane_pid}"))
        listed = subprocess.run(
            ["ps", "-eo", "pid=,ppid="], check=True, capture_output=True, text=True
        )
        pairs = [[int(number) for number in line.split()] for line in listed.stdout.splitlines()]
        return next(pid for pid, parent in pairs if parent == shell)

    def start(self) -> None:
        """Check, look, and confirm."""
        # While the probe still vents, F8 is answered "not now"
        self.insist("F8", lambda screen: "whose skin" in screen or "THIS WILL" in screen)
        self.insist("F8", lambda screen: "THIS WILL HAPPEN" in screen)
        self.until_all("up to 100 mbar", "repeats")
        self.confirm()

    def start_slow_run(self) -> None:
        """Start a run that takes long, and wait until its curve is drawn."""
        self.until(lambda screen: "READY" in screen)
        self.start()
        self.until(lambda screen: re.search(r"RUNNING.*\b[1-9]\d points", screen, re.DOTALL))

    def quit(self) -> None:
        """Quit, and say yes."""
        self.insist("q", lambda screen: "Quit?" in screen and "F9 yes" in screen)
        self.confirm()

    def session(self) -> Session:
        """The session file, once it is there."""
        end = time.monotonic() + PATIENCE_S
        while not (found := [p for p in self.sessions.glob("*.h5") if p.is_file()]):
            assert time.monotonic() < end, "no session was written"
            time.sleep(0.05)
        return read_session(found[0])

    def kill(self) -> None:
        subprocess.run(
            ["tmux", "-S", self._socket, "kill-server"], check=False, capture_output=True
        )


def alive(process: int) -> bool:
    state = subprocess.run(
        ["ps", "-o", "stat=", "-p", str(process)], check=False, capture_output=True, text=True
    ).stdout.strip()
    return bool(state) and not state.startswith("Z")


@pytest.fixture
def open_terminal(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    opened: list[Terminal] = []

    def open_it(
        size: tuple[int, int] = (80, 24),
        port: str = "sim://?seed=1&speed=10",
        program: str = "ramp:100@20",
        *,
        colour: bool = True,
    ) -> Terminal:
        opened.append(Terminal(tmp_path, size, port, program, colour=colour))
        return opened[-1]

    yield open_it
    for terminal in opened:
        terminal.kill()


@pytest.mark.parametrize(
    "size", [(80, 24), pytest.param((160, 50), marks=pytest.mark.long)], ids=["80x24", "160x50"]
)
def test_a_measurement_by_keys(open_terminal, size):
    terminal = open_terminal(size)
    terminal.until_all("READY", "SIMULATED", "connected;")
    terminal.press("w", "o", "r", "d", "Enter", "Space", "Enter")
    terminal.await_glimpse(
        "Enter closes"
    )  # what the word has opened, and its Enter may have closed
    terminal.until_all("suction off")
    terminal.insist("v", lambda screen: "Enter closes" not in screen)
    terminal.start()
    terminal.until_all("Good curve", "X1", "X2", "ν", "MPa", "measured", "fitted")
    terminal.insist("NPage", lambda screen: "ν of linear" in screen)  # below the fold at 80x24
    terminal.until_all("deflection, mm", "mbar", "ramp:100@20")
    terminal.quit()
    last = terminal.until_all("exit status 0", "session:")
    assert "Traceback" not in last
    assert terminal.session().results[0]["parameters"] is not None


def test_bytes_that_are_no_text_end_nothing(open_terminal):
    terminal = open_terminal((60, 20))
    terminal.until_all("READY", "SIMULATED", "Next: F8")
    terminal.send(b"\xff\xfe\xfcber\x00\xc3")
    terminal.insist("F8", lambda screen: "whose skin" in screen)


def test_what_another_program_writes_over_the_screen_does_not_stay(open_terminal):
    terminal = open_terminal((60, 20))
    terminal.until_all("READY", "SIMULATED", "Next: F8")
    terminal.write_over("\n\n\nBroadcast message\n\n\n\n")
    terminal.await_glimpse("Broadcast")
    terminal.until(lambda screen: "Broadcast" not in screen and "Next: F8" in screen)


@pytest.mark.long
def test_three_visits_with_the_left_hand_alone_in_a_small_window_without_colour(open_terminal):
    terminal = open_terminal((60, 20), "sim://?seed=1&speed=2", colour=False)
    terminal.until_all("READY", "SIMULATED", "Next: F8")
    for number, subject in enumerate(("A1", "A2", "A3"), start=1):
        terminal.until_all("READY")  # before, the fields take no text
        terminal.press("F3")  # goes to the program; back over the fields to the subject
        for _ in range(8):
            terminal.press("BTab")
        terminal.press(*subject)  # in the place of what is there
        terminal.until(lambda screen, s=subject: f"Subject {s}" in screen)
        terminal.press("F3", "C-t")
        terminal.until_all("THIS WILL HAPPEN", f"subject  {subject}", "loading  1", "repeats")
        terminal.confirm("C-g")
        terminal.until_all("Good curve", f"{subject}", "Next: ", "MPa")
        if number == 2:  # once more, and vented
            terminal.insist("C-t", lambda screen: "THIS WILL HAPPEN" in screen)
            terminal.until_all("loading  2 of this site", "repeats")
            terminal.confirm("C-g")
            # Of a run without samples nothing would be left
            terminal.until(lambda screen: re.search(r"mm  [2-9]\d points", screen))
            terminal.press("v")
            terminal.until_all("Repeat: it was cut short")
    terminal.press("F5")
    terminal.until_all("Visits in", "A2", "A1")
    terminal.press("v")
    terminal.until_all("Next: ", "A3")
    terminal.press("q")
    terminal.until_all("Quit?", "F9 yes")
    terminal.confirm("C-g")
    last = terminal.until_all("exit status 0")
    assert "Traceback" not in last
    sessions = [read_session(path) for path in sorted(terminal.sessions.glob("*.h5"))]
    assert [s.meta["subject"] for s in sessions] == ["A1", "A2", "A3"]
    assert [[c.partial for c in s.curves] for s in sessions] == [[False], [False, True], [False]]


def test_a_terminated_program_vents_and_saves(open_terminal):
    terminal = open_terminal(port="sim://?seed=1", program=LONG)
    terminal.start_slow_run()
    os.kill(terminal.program(), signal.SIGTERM)
    last = terminal.until_all("exit status 130")
    assert "Traceback" not in last
    assert terminal.session().curves[0].partial


def test_a_closed_terminal_vents_and_saves(open_terminal):
    terminal = open_terminal(port="sim://?seed=1", program=LONG)
    terminal.start_slow_run()
    program = terminal.program()
    terminal.kill()
    assert terminal.session().curves[0].partial
    end = time.monotonic() + PATIENCE_S
    while alive(program):
        assert time.monotonic() < end, "the program goes on without its terminal"
        time.sleep(0.05)


def test_a_missing_port_is_a_sentence(open_terminal):
    terminal = open_terminal(port="/dev/no-such-port")
    terminal.until_all("no such port", "NO PROBE")
    terminal.quit()
    terminal.until_all("exit status 0")
