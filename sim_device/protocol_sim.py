"""pyserial's handler of `sim://?skin=FILE&seed=N&speed=X&aperture_mm=6`: the probe in this process.

The port is the device: opening makes a new one, closing takes it away.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from urllib.parse import parse_qsl, urlsplit

from serial import PortNotOpenError, SerialBase, SerialException

from sim_device.build import build_device
from sim_device.device import Device

_TICK_S = 0.002


class Serial(SerialBase):
    """A port behind which a simulated probe lives; it moves when the port is read or written."""

    clock: Callable[[], float] = staticmethod(time.monotonic)
    sleep: Callable[[float], None] = staticmethod(time.sleep)

    _device: Device | None = None

    def open(self) -> None:
        """Make the device that the URL describes.

        Raises ValueError for a wrong URL, SerialException where a file that it names is.
        """
        if self.is_open:
            raise SerialException("Port is already open.")
        self._device, self._speed = _device(self.portstr or "")
        self._last_s = self.clock()
        self._received = bytearray()
        self.is_open = True

    def close(self) -> None:
        """Take the device away."""
        self.is_open = False
        self._device = None

    def read(self, size: int = 1, /) -> bytes:
        """Read `size` bytes, or what came within the port's timeout."""
        begin = self.clock()
        while True:
            self._advance()
            left = None if self.timeout is None else begin + self.timeout - self.clock()
            if len(self._received) >= size or (left is not None and left <= 0):
                data = bytes(self._received[:size])
                del self._received[:size]
                return data
            self.sleep(_TICK_S if left is None else min(_TICK_S, left))

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
        if not self.is_open or self._device is None:
            raise PortNotOpenError
        now = self.clock()
        self._device.process((now - self._last_s) * self._speed)
        self._last_s = now
        self._received += self._device.transmit()
        return self._device


def _device(url: str) -> tuple[Device, float]:
    parts = urlsplit(url)
    if parts.netloc or parts.path.strip("/"):
        raise ValueError("nothing but a query can follow sim:// (sim://?skin=FILE&seed=N)")
    query = dict[str, str]()
    for key, value in parse_qsl(
        parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)
    ):
        if key not in {"skin", "seed", "speed", "aperture_mm"}:
            raise ValueError(f"{key} is not known (skin, seed, speed, aperture_mm are)")
        if key in query:
            raise ValueError(f"{key} is given twice")
        query[key] = value
    speed = _number(query, "speed", 1.0)
    seed = query.get("seed", "0")
    if not (seed.isascii() and seed.isdecimal()):
        raise ValueError(f"seed must be a whole number, not {seed!r}")
    aperture_mm = _number(query, "aperture_mm", 6.0)
    try:
        device = build_device(
            query.get("skin"), seed=int(seed), speed=speed, aperture_mm=aperture_mm
        )
    except ValueError as error:
        skin = query.get("skin")
        if skin and str(error).startswith(skin):  # the file is wrong, not the URL
            raise SerialException(str(error)) from error
        raise
    return device, speed


def _number(query: dict[str, str], key: str, default: float) -> float:
    try:
        return float(query.get(key, default))
    except ValueError:
        raise ValueError(f"{key} must be a number, not {query[key]!r}") from None
