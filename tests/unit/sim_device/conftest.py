from __future__ import annotations

import pytest

from drivers.dialects import get_dialect
from drivers.events import Arm, Damaged, KeepAlive, Load, Start
from sim_device.device import Device
from sim_device.files import SensorSection


class PowerSkin:
    """A dome that grows with the pressure; quick, and nothing else."""

    def prepare(self, aperture_mm: float, load: Load) -> None:
        pass

    def start(self) -> None:
        pass

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        return 0.05 * pressure_mbar**0.7


class Bench:
    """A device and the plainest host: a counter and the grammar."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.dialect = get_dialect("reference")
        self.number = 0
        self.raw = b""

    def tell(self, *commands):
        """Send commands; what the device has to say at once."""
        for command in commands:
            self.device.receive(self.dialect.encode_command(command, self.number))
            self.number += 1
        return self.hear()

    def hear(self):
        data = self.device.transmit()
        self.raw += data
        buffer = bytearray(data)
        events = []
        while (frame := self.dialect.take(buffer)) is not None:
            assert not isinstance(frame, Damaged)
            events.append(self.dialect.decode_event(frame)[0])
        assert not buffer
        return events

    def wait(self, seconds, step=0.1):
        """Let time pass, with keep-alive; all that the device says."""
        events = []
        for _ in range(round(seconds / step)):
            self.device.process(step)
            events += self.tell(KeepAlive())
        return events

    def run(self, load):
        return self.tell(load, Arm(), Start())


@pytest.fixture
def make_bench():
    def make(*, seed=0, skin=None, sensor=None, **options):
        skin = PowerSkin() if skin is None else skin
        sensor = SensorSection() if sensor is None else sensor
        return Bench(Device(skin, sensor, seed=seed, **options))

    return make
