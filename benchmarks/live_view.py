"""What the bedside screen does to a live curve, in a pseudo terminal. Prints and saves JSON.

    python benchmarks/live_view.py [--rate-hz 100] [--size 80x24] [--curves 5] [--apart]

The program is the real one, `skinlab ui`, and this is its terminal: it presses the keys, answers
what a terminal is asked, and notes when which bytes came. The probe is simulated, at 100 Hz, in the
same process, or (`--apart`) in a process of its own.

- frames: what the program wrote while the curve ran, between two marks of synchronised output.
- input to screen: from the byte of a key to the end of the first frame that shows its effect:
  s (the session opens), b (it closes), v and Esc (vented; of a run that goes on). The last two also
  in tmux with its own settings, which holds a lone Esc back.
- start: from the command to the first frame of the main screen, and to a connected probe. With
  compiled modules, as an installed program has them, so behind a start that is not counted.
- completion: from the moment at which the host had the curve's last sample, by the session file,
  to the end of the first frame with its verdict, which comes with the card. All by the one clock
  that both processes have (Linux).
- cut short: curves that a watchdog ended, on a machine that is busy with other things.
- lost: counters of samples that are missing in the file.

What the file has of other sizes, measured in the same way, stays in it.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import re
import select
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from bisect import bisect_left
from contextlib import suppress
from fcntl import ioctl
from operator import itemgetter
from pathlib import Path
from termios import TIOCSWINSZ
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from skinlab.recording.session import read_session, sample_rows

FOLDER = Path(__file__).resolve().parent
BYTECODE = Path(tempfile.gettempdir()) / "skinlab-live-view-bytecode"
PATIENCE_S = 60.0
LONG = "ramp:100@2"  # for keys that are pressed while a curve runs
_VENTED = b"VENTING|vent ordered|vented|cut short|READY"
_COMPLETE = b"saved:|cut short|Repeat: |Good curve"
_VERDICT = b"Repeat: |Good curve|Do not use"
_TYPED_S = 0.1  # between two keys
_READ_S = 1.3  # longer than after typed letters
_F8, _F9 = b"\x1b[19~", b"\x1b[20~"
_END = b"\x1b[?2026l"  # of a frame
# What a bedside needs at 100 Hz in every size, by the worst of all curves
AIMS = {"completion_to_card_ms": 200.0, "vent_ms": 80.0, "frames_per_s": 20.0, "lost_samples": 0}


class Terminal:
    """The program, and the terminal that it believes to have."""

    def __init__(self, command: list[str], columns: int, rows: int, folder: Path) -> None:
        environment = {
            **{k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"},
            "PYTHONPYCACHEPREFIX": str(BYTECODE),
            "TERM": "xterm-256color",
            "COLORTERM": "truecolor",
            **{f"XDG_{kind}_HOME": str(folder / kind) for kind in ("CONFIG", "STATE", "CACHE")},
        }
        self.process, self._file = pty.fork()
        if self.process == 0:
            os.execvpe(command[0], command, environment)
        ioctl(self._file, TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.chunks: list[tuple[float, bytes]] = []
        self.marked = "tmux" not in command[0]

    def pump(self, seconds: float) -> None:
        """Take what comes within this time, and something at all events."""
        end = time.monotonic() + seconds
        while select.select([self._file], [], [], max(end - time.monotonic(), 0.0))[0]:
            try:
                data = os.read(self._file, 1 << 16)
            except OSError:
                return  # it has ended
            self.chunks.append((time.monotonic(), data))
            if b"\x1b[?2026$p" in data:
                os.write(self._file, b"\x1b[?2026;2$y")  # synchronised output: known, and off

    def press(self, keys: bytes) -> float:
        """Press, and return when."""
        at = time.monotonic()
        os.write(self._file, keys)
        return at

    def until(self, pattern: bytes, since_s: float) -> float:
        """Return the end of the first frame since then that contains this."""
        end = time.monotonic() + PATIENCE_S
        while True:
            for at_s, frame in self.frames(since_s):
                if re.search(pattern, frame):
                    return at_s
            if time.monotonic() > end:
                text = b"".join(f for _, f in self.frames(since_s))[-3000:]
                raise TimeoutError(f"{pattern!r} did not come; {text!r}")
            self.pump(0.002)

    def frames(self, since_s: float, until_s: float = float("inf")) -> list[tuple[float, bytes]]:
        """Return (end, bytes) of the frames of a time, text without its styles."""
        found, rest = [], b""
        for at_s, data in self.chunks[bisect_left(self.chunks, since_s, key=itemgetter(0)) :]:
            parts = (rest + data).split(_END)
            # A terminal between the two, such as tmux, passes no marks on
            rest = parts.pop() if self.marked else b""
            found += [(at_s, re.sub(rb"\x1b\[[0-9;?]*[a-zA-Z]", b"", part)) for part in parts]
        return [(at_s, frame) for at_s, frame in found if at_s <= until_s]

    def end(self) -> None:
        """End the program."""
        with suppress(ProcessLookupError):
            os.kill(self.process, signal.SIGTERM)
        os.waitpid(self.process, 0)
        os.close(self._file)


def spread(values_s: list[float]) -> dict[str, float]:
    """Return median and largest, in ms."""
    return {
        "median_ms": round(1e3 * float(np.median(values_s)), 1),
        "largest_ms": round(1e3 * max(values_s), 1),
        "count": len(values_s),
    }


def set_program(terminal: Terminal, program: str) -> None:
    """Type another program into its field, as fast as a person."""
    # F3, to the end, delete all before
    for keys in (b"\x1bOR", b"\x05", b"\x15", *(bytes([c]) for c in program.encode())):
        terminal.press(keys)
        terminal.pump(_TYPED_S)


def check_and_start(terminal: Terminal) -> float:
    """Return when the run was seen to begin."""
    asked = terminal.press(_F8)
    terminal.until(b"THIS WILL HAPPEN|whose skin", asked)
    if not any(b"THIS WILL HAPPEN" in frame for _, frame in terminal.frames(asked)):
        terminal.until(b"THIS WILL HAPPEN", terminal.press(_F8))  # without a subject it asks once
    terminal.pump(_READ_S)
    return terminal.until(b"RUNNING", terminal.press(_F9))


def measure(port: str, columns: int, rows: int, curves: int, folder: Path) -> dict[str, Any]:
    """Return the figures of one size of terminal."""
    load = os.getloadavg()[0]
    folder = folder / f"{columns}x{rows}"  # with settings of its own
    sessions = folder / "sessions"
    command = [sys.executable, "-m", "skinlab", "ui", "--port", port, "--sessions", str(sessions)]
    for counted in (False, True):
        begin = time.monotonic()
        terminal = Terminal(command, columns, rows, folder)
        if not counted:
            terminal.until(b"connected; F8 shows", begin)
            terminal.end()
    try:
        screen = terminal.until(b"CONNECTING|READY", begin)
        ready = terminal.until(b"connected; F8 shows", begin)
        runs: list[tuple[float, float]] = []
        for _ in range(curves):
            started = check_and_start(terminal)
            shown = terminal.until(_VERDICT, started + 1.0)
            runs.append((started, shown))
            terminal.until(_COMPLETE, shown)
            terminal.pump(1.0)
        set_program(terminal, LONG)
        keys: dict[str, list[float]] = {"s": [], "b": [], "v": [], "Esc": []}
        for name, byte in (("v", b"v"), ("Esc", b"\x1b")):
            for _ in range(curves):
                check_and_start(terminal)
                terminal.pump(1.5)
                for key, says in ((b"s", b"Session:"), (b"b", b"deflection")):
                    at = terminal.press(key)
                    keys[key.decode()].append(terminal.until(says, at) - at)
                terminal.pump(0.3)
                at = terminal.press(byte)
                keys[name].append(terminal.until(_VENTED, at) - at)
                terminal.until(_COMPLETE, at)
                terminal.pump(1.0)
    finally:
        terminal.end()
    session = read_session(next(sessions.glob("*.h5")))
    return {
        "size": f"{columns}x{rows}",
        "load_average": load,
        "start_to_screen_s": round(screen - begin, 2),
        "start_to_ready_s": round(ready - begin, 2),
        **_of_session(session, terminal, runs),
        "input_to_screen": {name: spread(values) for name, values in keys.items()},
    }


def sizes_saved(path: Path, results: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what the file has of other sizes, measured in the same way."""
    if not path.exists():
        return []
    saved = json.loads(path.read_text(encoding="utf-8"))
    now = {one["size"] for one in results["sizes"]}
    alike = all(saved[key] == results[key] for key in ("command", "rate_hz", "cores"))
    return [one for one in saved["sizes"] if one["size"] not in now] if alike else []


def against_aims(sizes: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the worst of all sizes beside what is aimed at."""
    found = {
        "completion_to_card_ms": max(s["completion_to_card"]["largest_ms"] for s in sizes),
        "vent_ms": max(s["input_to_screen"]["v"]["largest_ms"] for s in sizes),
        "frames_per_s": min(s["frames_per_s"]["least"] for s in sizes),
        "lost_samples": max(s["lost_samples"] for s in sizes),
    }
    return {
        name: {
            "aim": aim,
            "worst": found[name],
            "met": bool(found[name] >= aim if name == "frames_per_s" else found[name] <= aim),
        }
        for name, aim in AIMS.items()
    }


def vent_keys_in_tmux(port: str, curves: int, folder: Path) -> dict[str, Any]:
    """Return how late v and Esc are seen to vent where the program runs in tmux as it comes."""
    folder = folder / "in-tmux"
    folder.mkdir()
    sessions, socket = folder / "sessions", str(folder / "socket")
    ui = [sys.executable, "-m", "skinlab", "ui", "--port", port, "--sessions", str(sessions)]
    tmux = ["tmux", "-S", socket]
    command = [*tmux, "-f", "/dev/null", "new-session", shlex.join(ui)]
    terminal = Terminal(command, 80, 24, folder)
    keys: dict[str, list[float]] = {"v": [], "Esc": []}
    try:
        terminal.until(b"connected; F8 shows", time.monotonic())
        for name, byte in (("v", b"v"), ("Esc", b"\x1b")):
            for _ in range(curves):
                check_and_start(terminal)
                terminal.pump(1.5)
                at = terminal.press(byte)
                keys[name].append(terminal.until(_VENTED, at) - at)
                terminal.pump(2.0)
    finally:
        subprocess.run([*tmux, "kill-server"], check=False)
        terminal.end()
    version = subprocess.run(["tmux", "-V"], check=True, capture_output=True, text=True).stdout
    return {"version": version.strip(), **{name: spread(found) for name, found in keys.items()}}


def _of_session(session: Any, terminal: Terminal, runs: list[tuple[float, float]]) -> Any:
    rows = np.array(sample_rows(session))
    sequence, host_s = rows[:, 0], rows[:, 5]
    jumps = np.diff(sequence)
    frames_per_s, gaps, completion, points = [], [], [], []
    for curve, (started, shown) in zip(session.curves, runs, strict=False):
        if curve.partial:
            continue
        mine = (host_s > started - 1.0) & (host_s < shown)
        last = host_s[mine][len(curve) - 1]
        ends = [at for at, _ in terminal.frames(started, last)]
        frames_per_s.append(len(ends) / (last - started))
        gaps += np.diff(ends).tolist()
        completion.append(shown - last)
        points.append(len(curve))
    return {
        "points_of_each_curve": points,
        "cut_short": len(runs) - len(points),  # by a watchdog, where the machine is too busy
        "samples_in_file": len(rows),
        "lost_samples": int((jumps[jumps > 0] - 1).sum()),
        "frames_per_s": {
            "least": round(min(frames_per_s), 1),
            "each": np.round(frames_per_s, 1).tolist(),
        },
        "between_frames": spread(gaps),
        "completion_to_card": spread(completion),
    }


def main() -> None:
    """Run and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument("--size", action="append", help="COLUMNSxROWS [80x24 and 160x50]")
    parser.add_argument("--curves", type=int, default=5)
    parser.add_argument("--apart", action="store_true", help="the probe in a process of its own")
    parser.add_argument("--save", type=Path, default=FOLDER / "results" / "live_view.json")
    options = parser.parse_args()
    results: dict[str, Any] = {
        "command": "python benchmarks/live_view.py" + (" --apart" if options.apart else ""),
        "rate_hz": options.rate_hz,
        "cores": os.cpu_count(),
        "sizes": [],
    }
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        skin = folder / "skin.toml"
        skin.write_text(
            "[skin]\nX1_MPa = 0.025\nX2_MPa = 2.95\nnu = 0.28\n"
            f"[sensor]\nrate_hz = {options.rate_hz}\n"
        )
        for size in options.size or ["80x24", "160x50"]:
            columns, rows = (int(n) for n in size.split("x"))
            port, probe = f"sim://?seed=1&skin={skin}", None
            if options.apart:
                probe = subprocess.Popen(
                    [sys.executable, "-m", "sim_device", "--pty", "--skin", str(skin)],
                    stdout=subprocess.PIPE,
                    text=True,
                )
                assert probe.stdout is not None
                port = probe.stdout.readline().strip()
            try:
                results["sizes"].append(measure(port, columns, rows, options.curves, folder))
            finally:
                if probe is not None:
                    probe.terminate()
                    probe.wait()
        results["sizes"] = [*sizes_saved(options.save, results), *results["sizes"]]
        results["aims"] = against_aims(results["sizes"])
        if shutil.which("tmux"):
            port = f"sim://?seed=1&skin={skin}"
            results["in_tmux"] = vent_keys_in_tmux(port, options.curves, folder)
    text = json.dumps(results, indent=1)
    print(text)
    options.save.parent.mkdir(parents=True, exist_ok=True)
    options.save.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
