"""An instrument that lies, as a process of its own: it says what it likes.

`python tests/lying_instrument.py [--pty] [--log FILE] LIE` prints its URL and serves one host after
the other; the log has a line a word that it had from the host, with the time since Start in s. It
speaks the reference dialect on the real clock and does what a good instrument does, but for its
lie. It has no chamber: the pressure is what it says.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TextIO

sys.path.insert(0, str(Path(__file__).parents[1]))

from drivers.dialects.reference import DIALECT
from drivers.events import (
    PROGRAM_DONE,
    PROGRAM_END,
    Abilities,
    Arm,
    Damaged,
    Hello,
    Identify,
    InstrumentEvent,
    InstrumentFault,
    Load,
    Loaded,
    Refused,
    Sample,
    Start,
    State,
    Vent,
)
from drivers.events import InstrumentState as S
from sim_device.program import Run
from sim_device.serve import PtyHost, TcpHost

INTERVAL_S = 0.02
HELLO = Hello("reference", 1, "liar", "1", "1", 6.0, 500.0, 60.0, 1.0, 1000.0, simulated=False)

# What becomes of time, pressure and segment of a sample; the time is the true one
Lie = Callable[[float, float, int], tuple[float, float, int]]
ENDLESS: dict[str, Lie] = {  # it never says that the program is over
    "holds on": lambda t, p, s: (t, 60.0, 1),
    "vents in words": lambda t, p, s: (t, 60.0, s),
    "passes the height": lambda t, p, s: (t, p, 0),
    "past the end": lambda t, p, s: (t, 60.0, s if t < 1.0 else 7),
    "back again": lambda t, p, s: (t, p, s if t < 1.0 else 0),
    "runs ahead": lambda t, p, s: (2 * t, 60.0, 1),
    "jumps": lambda t, p, s: (t if t < 1.0 else t + 1.5, 60.0, 1),
    "slow": lambda t, p, s: (0.5 * t, 60.0, 1),
    "another program": lambda t, p, s: (t, 60.0, 1),
    "stops": lambda t, p, s: (t if t < 1.0 else 1.0 + 1e-3 * t, 60.0, 1),
    "stands": lambda t, p, s: (min(t, 1.0), 60.0, 1),
    "runs backwards": lambda t, p, s: (t if t < 1.0 else max(0.0, 2.0 - t), 60.0, 1),
    "dips": lambda t, p, s: (t, 3.0 if t % 0.5 < INTERVAL_S else 60.0, 1),
    "frozen pressure": lambda t, p, s: (t, min(p, 30.0), s),
    "creeps up": lambda t, p, s: (t, p + 20.0 * max(0.0, t - 1.0), s),
    "reads nothing": lambda t, p, s: (t, 0.0, s),
    "wrong sign": lambda t, p, s: (t, -p, s),
    "half open": lambda t, p, s: (t, max(p, 40.0), s),
    "refuses to vent": lambda t, p, s: (t, p + 20.0 * max(0.0, t - 1.0), s),
    "old program": lambda t, p, s: (t, 60.0, s),
    "old times": lambda t, p, s: (t + 100.0, p, s),
    "wobbles": lambda t, p, s: (t + (0.9 if t > 1.0 and int(50 * t) % 2 else 0.0), p, s),
}
OTHERS: dict[str, Lie] = {
    "truth": lambda t, p, s: (t, p, s),
    "stays high": lambda t, p, s: (t, max(p, 60.0), s),
    "no pause": lambda t, p, s: (t, 3.0 if t % 0.5 < INTERVAL_S else 60.0, s),
    "starts by itself": lambda t, p, s: (t, p, s),
    "starts again": lambda t, p, s: (t, p, s),
    "pulls between runs": lambda t, p, s: (t, p, s),
    "done": lambda t, p, s: (t, 60.0, s),
    "frozen height": lambda t, p, s: (t, p, s),
    "says all twice": lambda t, p, s: (t, p, s),
    "counts back": lambda t, p, s: (t, p, s),
    "arms late": lambda t, p, s: (t, p, s),
    "never starts": lambda t, p, s: (t, p, s),
    "hostile names": lambda t, p, s: (t, p, s),
    "hello again": lambda t, p, s: (t, p, s),
    "vents in silence": lambda t, p, s: (t, p, s),
    "fault in name": lambda t, p, s: (t, 60.0, s),
    "states only": lambda t, p, s: (t, p, s),
    "floods": lambda t, p, s: (t, p, s),
    "floods with lines": lambda t, p, s: (t, p, s),
    "babbles": lambda t, p, s: (t, p, s),
    "floods for a name": lambda t, p, s: (t, p, s),
    "answers another": lambda t, p, s: (t, 60.0, s),
    "streams early": lambda t, p, s: (t, 30.0, s),
    "leaks shut": lambda t, p, s: (t, max(p, 7.0), s),
    "vents in name": lambda t, p, s: (t, p + 20.0 * max(0.0, t - 1.0), s),
}
EVIL = "e\x1b]0;evil\x07\x9b2J\u202e\r\n[red]x[/]"  # what acts on a terminal
FLOOD = {  # bytes in one turn
    "floods": b"A" * 65_536,
    "floods with lines": b"\r\n" * 32_768,
    "babbles": DIALECT.encode_event(Refused("Load", "no"), 1) * 2_000,
    "floods for a name": b"$HELLO,1," + b"A" * 65_536,
}
LATE_S = 3.0  # longer than a host waits for an answer


class Liar:
    """The instrument; `out` is what it wants to send."""

    def __init__(self, lie: str, log: TextIO | None = None) -> None:
        self.lie = lie
        self.log = log
        self.late: list[tuple[float, InstrumentEvent]] = []  # what is to be said at a time
        self.alter = {**ENDLESS, **OTHERS}[lie]
        self.state = S.IDLE
        self.load: Load | None = None
        self.run: Run | None = None
        self.started = 0.0
        self.count = 0
        self.said_mbar = 0.0
        self.floods = False
        self.out = bytearray()

    def say(self, event: InstrumentEvent, number: int | None = None) -> None:
        self.out += DIALECT.encode_event(event, number)
        if self.lie == "says all twice":
            self.out += DIALECT.encode_event(event, number)

    def enter(self, state: S, reason: str) -> None:
        self.state = state
        self.say(State(state, reason, 0.0))

    def obey(self, frame: bytes) -> None:
        command, number = DIALECT.decode_command(frame)
        if self.log is not None:
            since_s = time.monotonic() - self.started if self.started else 0.0
            self.log.write(f"{since_s:.3f} {type(command).__name__} {self.said_mbar:g}\n")
            self.log.flush()
        match command:
            case Identify() if self.lie == "floods for a name":
                self.floods = True
            case Identify():
                hostile = {"model": EVIL, "firmware": EVIL, "serial_number": EVIL}
                self.say(replace(HELLO, **hostile) if self.lie == "hostile names" else HELLO)
                if self.lie == "passes the height":
                    self.say(Abilities(until=True))
                self.say(State(self.state, "identify", 0.0))
            case Load(segments, rate_hz, pressure, suction):
                self.load = command
                self.say(Loaded(segments, rate_hz, pressure, suction), number)
                self.enter(S.LOADED, "loaded")
                if self.lie == "streams early":
                    self.run, self.started = Run(command), time.monotonic()
                if self.lie == "another program":  # said again, and longer
                    self.say(Loaded((*segments, *segments[-1:] * 5), rate_hz, 500.0, 60.0), number)
            case Start() if self.lie == "answers another":
                self.start()
            case Arm() if self.lie == "arms late":
                self.late.append((time.monotonic() + LATE_S, State(S.ARMED, "armed", 0.0)))
            case Arm():
                self.enter(S.ARMED, "armed")
                if self.lie == "starts by itself":
                    self.start()
            case Start() if self.lie == "never starts":
                pass
            case Start() if self.state is S.ARMED:
                self.start()
            case Vent() if self.lie == "refuses to vent":
                self.say(Refused("VENT", "not now"), 0)
            case Vent():
                if self.lie != "vents in name":
                    self.run = None
                self.enter(S.VENTING, "host")
                self.enter(S.LOADED, "vented")
            case _:
                pass

    def start(self) -> None:
        assert self.load is not None
        self.run, self.started, self.count = Run(self.load), time.monotonic(), 0
        self.enter(S.ARMED if self.lie == "answers another" else S.RUNNING, "started")

    def live(self) -> None:
        """Say the samples that are due."""
        while self.late and time.monotonic() > self.late[0][0]:
            self.say(self.late.pop(0)[1])
        if self.lie == "pulls between runs" and self.run is None and self.count:
            at_s = time.monotonic() - self.started
            if at_s > 1.5 and at_s > self.count * INTERVAL_S:
                self.count = round(at_s / INTERVAL_S) + 1
                self.said_mbar = 30.0
                self.say(Sample(self.count, at_s, self.said_mbar, 0.1, 0))
        while self.run is not None and time.monotonic() - self.started >= self.count * INTERVAL_S:
            at_s = self.count * INTERVAL_S
            self.run.advance(round(1e6 * at_s), 0.0)
            if self.run.ended and self.lie not in ENDLESS and self.state is S.RUNNING:
                self.end()
                continue
            time_s, pressure, segment = self.alter(at_s, self.run.set_point_mbar, self.run.index)
            pressure = pressure if self.count else 0.0  # nothing can be there at once
            height_mm = (5e-3 if self.lie == "passes the height" else 1e-4) * self.count
            if self.lie == "frozen height":
                height_mm = min(height_mm, 25e-4)  # from 0.5 s on
            number = self.count % 40 if self.lie == "counts back" else self.count
            if self.lie == "hello again" and self.count == 50:
                self.say(HELLO)
            if self.lie == "states only" and self.count > 50:
                self.say(State(S.RUNNING, "running", pressure))
                self.count += 1
                continue
            if self.lie in FLOOD and self.count == 50:
                self.floods = True
            if self.floods and self.lie != "babbles":
                self.count += 1
                continue
            self.say(Sample(number, time_s, pressure, height_mm, segment))
            if self.lie == "hostile names" and self.count == 50:
                self.say(InstrumentFault(EVIL, EVIL))
                self.enter(S.FAULT, EVIL)
            self.said_mbar = pressure
            self.count += 1

        if self.floods:
            self.out += FLOOD[self.lie]

    def end(self) -> None:
        if self.lie == "vents in silence":
            self.say(State(S.VENTING, PROGRAM_END, 60.0))
            self.run = None
            return
        self.enter(S.FAULT if self.lie == "fault in name" else S.VENTING, PROGRAM_END)
        if self.lie == "fault in name":
            return
        stays = self.lie in {"stays high", "leaks shut"}
        if not stays:
            self.enter(S.LOADED, PROGRAM_DONE)
        if self.lie == "starts again":
            self.enter(S.ARMED, "armed")
            self.start()
        elif not stays and self.lie != "done":
            self.run = None


def main() -> None:
    log = None
    if "--log" in sys.argv:
        log = Path(sys.argv[sys.argv.index("--log") + 1]).open("w")  # noqa: SIM115 -- until it is killed
    liar = Liar(sys.argv[-1], log)
    waiting = bytearray()
    with PtyHost() if "--pty" in sys.argv else TcpHost(0) as host:
        sys.stdout.write(f"{host.url}\n")
        sys.stdout.flush()
        while True:
            waiting += host.wait(0.005)
            while (frame := DIALECT.take(waiting)) is not None:
                if not isinstance(frame, Damaged):
                    liar.obey(frame)
            liar.live()
            host.send(bytes(liar.out))
            liar.out.clear()


if __name__ == "__main__":
    main()
