"""pyserial's handler of `sim://?skin=FILE&faults=FILE&seed=N&speed=X&aperture_mm=6&phantom=NAME`.

The port is the device, in this process: opening makes a new one, closing takes it away. Only one
that was unplugged stays, and is what the same URL finds when it is plugged in again.
"""

from __future__ import annotations

import errno
import time
from urllib.parse import parse_qsl, urlsplit

from serial import PortNotOpenError, SerialBase, SerialException

from drivers.numbers import number_in
from sim_device.build import build_device
from sim_device.device import Device
from sim_device.timing import TIMING

_TICK_S = 0.002
_KEYS = ("skin", "faults", "seed", "speed", "aperture_mm", "phantom")


class _World:
    """A device and its time."""

    def __init__(self, device: Device, speed: float, now_s: float) -> None:
        self.device = device
        self._speed = speed
        self._last_s = now_s

    def advance(self, now_s: float) -> None:
        """Let the device live up to now."""
        self.device.process((now_s - self._last_s) * self._speed)
        self._last_s = now_s


_unplugged: dict[str, _World] = {}  # by URL: they live on while no host can reach them


class Serial(SerialBase):
    """A port behind which a simulated probe lives; it moves when the port is read or written."""

    _world: _World | None = None

    def open(self) -> None:
        """Make the device that the URL describes.

        Raises ValueError for a wrong URL, SerialException where a file that it names is.
        """
        if self.is_open:
            raise SerialException("Port is already open.")
        url = self.portstr or ""
        world = _unplugged.get(url)
        if world is None:
            device, speed = _device(url)
            world = _World(device, speed, TIMING.clock())
        world.advance(TIMING.clock())
        if not world.device.plugged:
            raise SerialException(errno.ENOENT, "unplugged")
        _unplugged.pop(url, None)
        world.device.transmit()  # what was said before anybody listened
        self._world = world
        self._received = bytearray()
        self.is_open = True

    def close(self) -> None:
        """Take the device away."""
        if self._world is not None and not self._world.device.plugged:
            _unplugged[self.portstr or ""] = self._world
        self.is_open = False
        self._world = None

    def read(self, size: int = 1, /) -> bytes:
        """Read `size` bytes, or what came within the port's timeout."""
        begin = TIMING.clock()
        while True:
            self._advance()
            left = None if self.timeout is None else begin + self.timeout - TIMING.clock()
            if len(self._received) >= size or (left is not None and left <= 0):
                data = bytes(self._received[:size])
                del self._received[:size]
                return data
            time.sleep(_TICK_S if left is None else min(_TICK_S, left))

    def write(self, data: object, /) -> int:
        """Hand bytes to the device."""
        raw = bytes(data)  # type: ignore[call-overload]
        self._advance().receive(raw)
        return len(raw)

    @property
    def in_waiting(self) -> int:
        """Number of bytes that can be read at once."""
        self._advance()
        return len(self._received)

    def reset_input_buffer(self) -> None:
        """Drop what was received."""
        self._advance()
        self._received.clear()

    def reset_output_buffer(self) -> None:
        """Do nothing: what is written is there at once."""

    def flush(self) -> None:
        """Do nothing: what is written is there at once."""

    def _reconfigure_port(self) -> None:
        """Do nothing: no wire has a speed here."""

    def _advance(self) -> Device:
        if not self.is_open or self._world is None:
            raise PortNotOpenError
        self._world.advance(TIMING.clock())
        device = self._world.device
        self._received += device.transmit()
        if not device.plugged:
            raise SerialException(errno.EIO, "unplugged")
        return device


def _device(url: str) -> tuple[Device, float]:
    parts = urlsplit(url)
    if parts.netloc or parts.path.strip("/"):
        raise ValueError("nothing but a query can follow sim:// (sim://?skin=FILE&seed=N)")
    query = dict[str, str]()
    for key, value in parse_qsl(
        parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)
    ):
        if key not in _KEYS:
            raise ValueError(f"{key} is not known ({', '.join(_KEYS)} are)")
        if key in query:
            raise ValueError(f"{key} is given twice")
        query[key] = value
    speed = _number(query, "speed", 1.0)
    seed = query.get("seed", "0")
    if not (seed.isascii() and seed.isdecimal()):
        raise ValueError(f"seed must be a whole number, not {seed!r}")
    aperture_mm = _number(query, "aperture_mm", 6.0)
    files = {key: query.get(key) for key in ("skin", "faults")}
    try:
        device = build_device(
            files["skin"],
            seed=int(seed),
            speed=speed,
            aperture_mm=aperture_mm,
            faults_file=files["faults"],
            phantom=query.get("phantom"),
        )
    except ValueError as error:
        if any(file and str(error).startswith(file) for file in files.values()):
            raise SerialException(str(error)) from error  # the file is wrong, not the URL
        raise
    return device, speed


def _number(query: dict[str, str], key: str, default: float) -> float:
    try:
        return number_in(query[key]) if key in query else default
    except ValueError:
        raise ValueError(f"{key} must be a number, not {query[key]!r}") from None
