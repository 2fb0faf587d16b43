"""A probe over an in-memory link: time runs only while the probe's thread reads."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from drivers.events import Event, Load, TimedEvent
from drivers.probe import Probe
from sim_device.device import Device
from sim_device.files import SensorSection

PATIENCE_S = 120.0


class PowerSkin:
    """A dome that grows with the pressure; quick, and nothing else."""

    def __init__(self) -> None:
        self.prepared: list[tuple[float, float]] = []
        self.frozen_at: float | None = None

    def prepare(self, aperture_mm: float, load: Load) -> None:
        self.prepared.append((aperture_mm, load.max_pressure_mbar))

    def start(self) -> None:
        pass

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        if self.frozen_at is not None:
            pressure_mbar = min(pressure_mbar, self.frozen_at)
        return 0.05 * pressure_mbar**0.7


class LoopLink:
    """Device and clock on one thread; `hook` runs before each read, and may break anything."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.now = 100.0
        self.hook: Callable[[LoopLink], None] = lambda link: None
        self.written: list[bytes] = []
        self.deaf = False  # nothing reaches the host any more
        self.lose: list[bytes] = []  # one write that begins like this is lost
        self.closed = False

    def clock(self) -> float:
        return self.now

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        self.hook(self)
        self.now += timeout_s
        self.device.process(timeout_s)
        data = self.device.transmit()
        return b"" if self.deaf else data

    def write(self, data: bytes) -> None:
        self.written.append(data)
        for start in self.lose:
            if data.startswith(start):
                self.lose.remove(start)
                return
        self.device.receive(data)

    def close(self) -> None:
        self.closed = True


class Bench:
    """A probe, the device behind it, and all that happened."""

    def __init__(self, device: Device, skin: PowerSkin, **options: object) -> None:
        self.skin = skin
        self.device = device
        self.link = LoopLink(device)
        self.probe = Probe(
            "loop", clock=self.link.clock, open_link=lambda url: self.link, **options
        )
        self.seen: list[TimedEvent] = []

    def until(self, wanted: Callable[[Event], bool]) -> Event:
        """Wait for an event that is `wanted`; fails if the stream falls silent."""
        while True:
            timed = self.probe.next_event(PATIENCE_S)
            assert timed is not None, [t.event for t in self.seen[-20:]]
            self.seen.append(timed)
            if wanted(timed.event):
                return timed.event

    def rest(self) -> list[Event]:
        """What is left after close."""
        while (timed := self.probe.next_event(0)) is not None:
            self.seen.append(timed)
        return [timed.event for timed in self.seen]

    def of(self, kind: type[Event]) -> list[Event]:
        return [timed.event for timed in self.seen if isinstance(timed.event, kind)]


@pytest.fixture
def make_bench():
    benches = []

    def make(*, noise: bool = True, device_type: type[Device] = Device, **options: object) -> Bench:
        skin = PowerSkin()
        sensor = SensorSection() if noise else SensorSection(noise_um=0, pressure_noise_mbar=0)
        bench = Bench(device_type(skin, sensor, seed=1), skin, **options)
        benches.append(bench)
        return bench

    yield make
    for bench in benches:
        bench.probe.close()
