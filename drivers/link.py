"""`open_link(url)`: bytes to and from an instrument, by pyserial. The only file that imports it."""

from __future__ import annotations

import contextlib
import errno
import socket
import time
from dataclasses import dataclass
from typing import Protocol
from urllib.parse import parse_qsl, urlsplit

import serial
from serial.tools import list_ports as serial_list_ports

from drivers.errors import LinkError, PortFileError, PortUrlError

BAUD_RATE = 115_200
BAUD_RATES = (1_200, 4_000_000)  # what a URL may ask for
_POLL_S = 0.01  # between two looks at the port
_WRITE_TIMEOUT_S = 0.5
_NETWORK = frozenset({"socket", "rfc2217"})
_PYSERIALS_OPTIONS = "debug|info|warning|error"  # in its words for a URL that it cannot parse
_SIMULATOR = "sim_device"  # where pyserial finds `sim://`; a name, so that nothing is imported here


class Link(Protocol):
    """An open way to an instrument. Used by one thread."""

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """Up to `max_bytes`; empty if nothing came in `timeout_s`. Raises LinkError."""

    def write(self, data: bytes) -> None:
        """Send all of `data`. Raises LinkError."""

    def close(self) -> None:
        """Close; never raises."""


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A serial port of this computer: what to open, and what is known of it (empty: nothing)."""

    url: str
    description: str
    manufacturer: str = ""
    product: str = ""
    serial_number: str = ""
    usb_id: str = ""  # vendor:product, hexadecimal
    location: str = ""

    @property
    def details(self) -> str:
        """All that is known, in one line."""
        known = [self.description, self.manufacturer, self.serial_number, self.usb_id]
        return ", ".join(dict.fromkeys(text for text in known if text))


def list_ports() -> tuple[PortInfo, ...]:
    """Look for serial ports of this computer, sorted by name."""
    return tuple(
        PortInfo(
            url=port.device,
            description=_said(port.description) or "serial port",
            manufacturer=port.manufacturer or "",
            product=port.product or "",
            serial_number=port.serial_number or "",
            usb_id="" if port.vid is None or port.pid is None else f"{port.vid:04x}:{port.pid:04x}",
            location=port.location or "",
        )
        for port in sorted(serial_list_ports.comports(), key=lambda port: port.device)
    )


def _said(text: str | None) -> str:
    return "" if text is None or text == "n/a" else text  # pyserial's word for nothing


def open_link(url: str, framing: str = "8N1") -> Link:
    """Open a serial port, or what a pyserial URL names.

    framing: data bits, parity (N, E, O) and stop bits of a serial line; docs/wire.md says 8N1.
    `/dev/ttyUSB0`, `COM3`, `socket://HOST:PORT`, `rfc2217://HOST:PORT`, `sim://?skin=FILE&seed=N`.
    A serial line may be asked for another speed: `/dev/ttyUSB0?baud=460800`, `rfc2217://…?baud=…`.
    Raises LinkError, one sentence that names the URL; PortUrlError where the URL itself is wrong,
    PortFileError where a file is that it names.
    """
    if _SIMULATOR not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(_SIMULATOR)
    try:
        _check_address(url)
        name, baud_rate = _split_baud(url)
        waits = name.startswith("rfc2217:")
        port = serial.serial_for_url(
            name,
            baudrate=baud_rate,
            bytesize=int(framing[0]),
            parity=framing[1],
            stopbits=int(framing[2]),
            timeout=_POLL_S if waits else 0,
            # pyserial's rfc2217 knows none, and gives up after 5 s by itself
            write_timeout=None if waits else _WRITE_TIMEOUT_S,
            exclusive=True,
        )
    except ValueError as error:  # pyserial's and our own word for it; what fails is an OSError
        raise PortUrlError(f"cannot open {url or 'an empty port'}: {_why(error)}") from error
    except Exception as error:
        if _PYSERIALS_OPTIONS in str(error):
            raise PortUrlError(f"cannot open {url}: its options are not understood") from error
        wrong_file = name.startswith("sim:") and isinstance(error.__cause__, ValueError)
        kind = PortFileError if wrong_file else LinkError
        raise kind(f"cannot open {url}: {_why(error)}") from error
    return _SerialLink(url, port, waits)


def _check_address(url: str) -> None:
    """Raise ValueError for an address without host or port: pyserial stumbles over it."""
    if not url.strip():
        raise ValueError("expected a port, such as /dev/ttyUSB0, socket://HOST:PORT or sim://")
    scheme = url.partition("://")[0]
    if scheme not in _NETWORK:
        return
    parts = urlsplit(url)
    try:
        complete = parts.hostname and parts.port
    except ValueError:
        complete = None
    if not complete or parts.path.strip("/"):
        raise ValueError(f"expected {scheme}://HOST:PORT, PORT a number 1 to 65535")


def _split_baud(url: str) -> tuple[str, int]:
    """Give the URL as pyserial takes it, and the speed of the line. Raises ValueError."""
    name, _, query = url.partition("?")
    scheme, colon, _ = name.partition("://")
    if not query or (colon and scheme != "rfc2217"):
        return url, BAUD_RATE
    rate = BAUD_RATE
    others = []
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key == "baud":
            low, high = BAUD_RATES
            if not (value.isascii() and value.isdecimal() and low <= int(value) <= high):
                raise ValueError(f"baud must be a whole number {low} to {high}, not {value!r}")
            rate = int(value)
        elif not colon:
            raise ValueError(f"{key} is not known (baud is)")
        else:
            others.append(f"{key}={value}" if value else key)  # pyserial's own
    return (f"{name}?{'&'.join(others)}" if others else name), rate


class _SerialLink:
    """A port; `waits`: its own `read` does (rfc2217 gives a byte at a time where it must not)."""

    def __init__(self, url: str, port: serial.SerialBase, waits: bool) -> None:
        self._url = url
        self._port = port
        self._waits = waits
        self._full = False  # the last read left bytes behind

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        # Pause, then take what came: one wake-up a turn at every rate, where waiting for bytes is
        # one for each piece in which they arrive.
        pauses = 0 if self._full else round(timeout_s / _POLL_S)
        try:
            while True:
                if pauses and not self._waits:
                    time.sleep(_POLL_S)
                data = self._port.read(max_bytes)
                self._full = len(data) >= max_bytes
                if data or pauses <= 1:
                    return bytes(data)
                pauses -= 1
        except Exception as error:
            raise LinkError(f"lost {self._url}: {_why(error)}") from error

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except Exception as error:
            raise LinkError(f"cannot write to {self._url}: {_why(error)}") from error

    def close(self) -> None:
        # pyserial 3.5 forgets to close a socket whose peer went first
        leaked = getattr(self._port, "_socket", None)
        for gone in (self._port, leaked):
            if gone is not None:
                with contextlib.suppress(Exception):  # it is gone already, which is what was wanted
                    gone.close()


_REASONS = {
    errno.ENOENT: "there is no such port (is the probe plugged in and switched on?)",
    errno.ENODEV: "there is no device at this port",
    errno.ENXIO: "there is no device at this port",
    errno.EACCES: "permission denied (on Linux, your user must be in the group dialout)",
    errno.EPERM: "permission denied",
    errno.EBUSY: "another program uses it",
    errno.EAGAIN: "another program uses it",
    errno.ECONNREFUSED: "connection refused (nothing listens there)",
    errno.ENOTTY: "it is not a serial port",
    errno.EIO: "the device is gone",
}


def _why(error: BaseException) -> str:
    """Say why in one line; pyserial often keeps the system's own error only as the context."""
    causes = (error, error.__cause__ or error.__context__)
    for cause in (cause for cause in causes if cause is not None):
        if isinstance(cause, socket.gaierror):
            return "there is no such host"
        number = cause.errno if isinstance(cause, OSError) else None
        if number is None and cause.args and isinstance(cause.args[0], int):
            number = cause.args[0]  # termios.error
        if number in _REASONS:
            return _REASONS[number]
    text = " ".join(str(error).split()) or type(error).__name__
    if "protocol" in text and "not known" in text:
        return "this kind of URL is not known (a port, socket://, rfc2217:// or sim://)"
    if "returned no data" in text:
        return "the device is gone"
    return text
