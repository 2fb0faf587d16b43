"""An instrument that only streams, as a process of its own: a person starts it, nobody else.

`python tests/streaming_instrument.py [--tcp]` prints its port; then each line of its standard input
is a person at the instrument: `run PEAK` (a ramp to PEAK mbar and back, 20 mbar/s), `up PEAK` (to
PEAK, and it stays there), `zero N` (N readings at rest), `say TEXT` (a line of any text), `off`.
It speaks the lines of examples/dialects/plain_line.toml, as fast as they are taken; its clock goes
20 ms a reading, and on between runs.
"""

from __future__ import annotations

import socket
import sys
import threading
from pathlib import Path
from typing import Protocol

sys.path.insert(0, str(Path(__file__).parents[1]))

from drivers.errors import LinkError

STEP_MS = 20
RATE_MBAR_PER_S = 20.0
AT_REST = 60  # readings before and behind each run


class Way(Protocol):
    def sendall(self, data: bytes, /) -> None: ...


def deflection_mm(mbar: float) -> float:
    """A skin, roughly."""
    return float(0.5 * (max(0.0, mbar) / 100) ** 0.6)


def line(count: int, mbar: float, mm: float) -> bytes:
    payload = b"P %07.3f D %.6f T %06d" % (mbar, mm, STEP_MS * count)
    checksum = 0
    for byte in payload:
        checksum ^= byte
    return payload + b"*%02X\r\n" % checksum


def ramp(peak_mbar: float) -> list[float]:
    step = RATE_MBAR_PER_S * STEP_MS / 1000
    n = round(peak_mbar / step)
    return [k * step for k in range(n + 1)]


class Instrument:
    """Keeps its clock from one order to the next."""

    def __init__(self, way: Way) -> None:
        self.way = way
        self.count = 0

    def show(self, pressures: list[float]) -> None:
        for mbar in pressures:
            self.way.sendall(line(self.count, mbar, deflection_mm(mbar)))
            self.count += 1

    def order(self, text: str) -> bool:
        word, _, rest = text.strip().partition(" ")
        match word:
            case "run":
                up = ramp(float(rest))
                self.show([0.0] * AT_REST + up + up[-2::-1] + [0.0] * AT_REST)
            case "up":
                self.show([0.0] * AT_REST + ramp(float(rest)))
            case "zero":
                self.show([0.0] * int(rest))
            case "say":
                self.way.sendall(rest.encode() + b"\r\n")
            case _:
                return False
        return True


# Its lines, without the checksum, and without a limit of silence
TEXT = r"""
[dialect]
name = "plain"
pattern = 'P (?P<pressure>\S+) D (?P<deflection>\S+) T (?P<time>\d+)\*..'
[columns.pressure]
unit = "kPa"
scale = 0.1
[columns.deflection]
unit = "mm"
[columns.time]
unit = "ms"
[stream]
silent_s = 600
"""


class Wire:
    """The same instrument as a link inside a test; what the host writes is kept."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.unplugged = False
        self.hangs_up = False  # behind its last line
        self.endless = False  # a reading at rest with every turn that has no other
        self._lines = bytearray()
        self._count = 0
        self._lock = threading.Lock()

    def put(self, pressures: list[float]) -> None:
        with self._lock:
            for mbar in pressures:
                self._lines += line(self._count, mbar, deflection_mm(mbar))
                self._count += 1

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        threading.Event().wait(0.001)
        with self._lock:
            if self.unplugged or (self.hangs_up and not self._lines):
                raise LinkError("unplugged")
            if self.endless and not self._lines:
                self._lines += line(self._count, 0.0, 0.0)
                self._count += 1
            data = bytes(self._lines[:200])
            del self._lines[:200]
        return data

    def open(self, _: str) -> Wire:
        if self.unplugged or self.hangs_up:
            raise LinkError("still unplugged")
        return self

    def write(self, data: bytes) -> None:
        self.sent.append(data)

    def close(self) -> None:
        pass


class PtyWay:
    def __init__(self) -> None:
        import os
        import tty

        self.mine, other = os.openpty()
        tty.setraw(other)
        self.url = os.ttyname(other)
        self._other = other

    def sendall(self, data: bytes) -> None:
        import os

        while data:
            data = data[os.write(self.mine, data) :]


def say(url: str) -> None:
    sys.stdout.write(url + "\n")
    sys.stdout.flush()


def main() -> None:
    if "--tcp" in sys.argv:
        listener = socket.create_server(("127.0.0.1", 0))
        say(f"socket://127.0.0.1:{listener.getsockname()[1]}")
        way: Way = listener.accept()[0]
    else:
        way = PtyWay()
        say(way.url)
    instrument = Instrument(way)
    for text in sys.stdin:
        if not instrument.order(text):
            return


if __name__ == "__main__":
    main()
