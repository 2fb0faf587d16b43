"""Where a host can reach the simulated probe's process: a pseudo terminal or a TCP port.

Both can be unplugged, and plugged in again under the same name.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from drivers.near_end import Pty, Tcp
from sim_device.device import Device
from sim_device.timing import TIMING

_TICK_S = 0.005  # while something moves
_IDLE_S = 1.0  # while nothing does: only a host can change that
_READ_BYTES = 4096


class Host(Protocol):
    """The way to whoever connects."""

    def wait(self, timeout_s: float) -> bytes:
        """Bytes from the host; empty if none came in time, or nobody is there."""

    def send(self, data: bytes) -> None:
        """Send what can be sent now; what nobody fetches is lost."""

    def plug(self, plugged: bool) -> None:
        """Be reachable, or not: a host that is connected sees the device go."""


def serve(device: Device, host: Host, speed: float) -> None:
    """Let the device live, for ever; it goes on living while no host is connected."""
    clock = TIMING.clock
    last = clock()
    while True:
        resting = device.resting
        data = host.wait(_IDLE_S if resting else _TICK_S)
        now = clock()
        # What came while it rested came now: else a first command would be as old as the rest.
        # While it moves, what came counts first: this process may have had to wait for its turn,
        # and the keep-alive lies there since.
        if not resting:
            device.receive(data)
        device.process((now - last) * speed)
        if resting:
            device.receive(data)
        last = now
        host.send(device.transmit())
        host.plug(device.plugged)


class _Host(ABC):
    """Closes with its `with` block."""

    url: str

    def __init__(self) -> None:
        self._end: Pty | Tcp | None = self._open()

    @abstractmethod
    def _open(self) -> Pty | Tcp: ...

    def plug(self, plugged: bool) -> None:
        """See Host."""
        if plugged and self._end is None:
            self._end = self._open()
        elif not plugged:
            self.unplug()

    def unplug(self) -> None:
        """Whoever is connected sees the device go."""
        end, self._end = self._end, None
        if end is not None:
            end.close()

    def wait(self, timeout_s: float) -> bytes:
        """See Host."""
        if self._end is None:
            time.sleep(timeout_s)
            return b""
        return self._end.read(_READ_BYTES, timeout_s)

    def send(self, data: bytes) -> None:
        """See Host."""
        if self._end is not None:
            self._end.write(data)

    def close(self) -> None:
        """Go, for ever."""
        self.unplug()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class PtyHost(_Host):
    """A raw pseudo terminal; `url` is the path that the host opens. Raises OSError.

    unpluggable: it may go and come back, and then gets a name that stays.
    """

    def __init__(self, *, unpluggable: bool = False) -> None:
        self._link: Path | None = None
        if unpluggable:
            self._link = Path(tempfile.mkdtemp(prefix="simulated-probe-")) / "port"
        super().__init__()

    def _open(self) -> Pty:
        pty = Pty()
        if self._link is not None:
            self._link.symlink_to(pty.url)
        self.url = pty.url if self._link is None else str(self._link)
        return pty

    def unplug(self) -> None:
        """Whoever is connected sees the device go."""
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        super().unplug()

    def close(self) -> None:
        """Go, for ever."""
        super().close()
        if self._link is not None:
            shutil.rmtree(self._link.parent, ignore_errors=True)


class TcpHost(_Host):
    """A TCP port of this computer, for one host at a time; the next one waits. Raises OSError."""

    def __init__(self, port: int) -> None:
        self._port = port
        super().__init__()

    def _open(self) -> Tcp:
        tcp = Tcp(self._port)
        self._port, self.url = tcp.port, tcp.url
        return tcp
