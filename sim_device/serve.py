"""Where a host can reach the simulated probe's process: a pseudo terminal or a TCP port.

Both can be unplugged, and plugged in again under the same name.
"""

from __future__ import annotations

import os
import select
import shutil
import socket
import tempfile
import time
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from sim_device.device import Device
from sim_device.timing import TIMING

_TICK_S = 0.005  # while something moves
_IDLE_S = 1.0  # while nothing does: only a host can change that
_READ_BYTES = 4096
_UNREAD_BYTES = 1 << 16  # what nobody fetches beyond this is lost, as on a serial line


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


class _Closing(ABC):
    """Closes with its `with` block."""

    url: str

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None: ...


class PtyHost(_Closing):
    """A raw pseudo terminal; `url` is the path that the host opens. Raises OSError.

    unpluggable: it may go and come back, and then gets a name that stays.
    """

    def __init__(self, *, unpluggable: bool = False) -> None:
        try:
            import tty
        except ImportError:
            raise OSError("this system has no pseudo terminals; use --tcp") from None
        self._set_raw = tty.setraw
        self._link: Path | None = None
        if unpluggable:
            self._link = Path(tempfile.mkdtemp(prefix="simulated-probe-")) / "port"
        self._plug()
        self.url = os.ttyname(self._other) if self._link is None else str(self._link)

    def plug(self, plugged: bool) -> None:
        """See Host."""
        if plugged and self._mine < 0:
            self._plug()
        elif not plugged and self._mine >= 0:
            self._unplug()

    def _plug(self) -> None:
        # The other end stays open here: so it stays raw, and a host can leave and come back
        self._mine, self._other = os.openpty()
        self._set_raw(self._other)
        os.set_blocking(self._mine, False)
        self._unread = b""
        if self._link is not None:
            self._link.symlink_to(os.ttyname(self._other))

    def _unplug(self) -> None:
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._mine)
        os.close(self._other)
        self._mine = self._other = -1

    def wait(self, timeout_s: float) -> bytes:
        """See Host."""
        if self._mine < 0:
            time.sleep(timeout_s)
            return b""
        ready, writable, _ = select.select(
            [self._mine], [self._mine] if self._unread else [], [], timeout_s
        )
        if writable:
            self.send(b"")
        return os.read(self._mine, _READ_BYTES) if ready else b""

    def send(self, data: bytes) -> None:
        """See Host."""
        if self._mine < 0:
            return
        self._unread += data
        try:
            self._unread = self._unread[os.write(self._mine, self._unread) :]
        except BlockingIOError:
            if len(self._unread) > _UNREAD_BYTES:
                self._unread = b""

    def close(self) -> None:
        """Close both ends: the host sees the device go."""
        if self._mine >= 0:
            self._unplug()
        if self._link is not None:
            shutil.rmtree(self._link.parent, ignore_errors=True)


class TcpHost(_Closing):
    """A TCP port of this computer, for one host at a time; the next one waits. Raises OSError."""

    def __init__(self, port: int) -> None:
        self._listener: socket.socket | None = socket.create_server(("127.0.0.1", port))
        self._peer: socket.socket | None = None
        self._unread = b""
        self._port = int(self._listener.getsockname()[1])
        self.url = f"socket://127.0.0.1:{self._port}"

    def plug(self, plugged: bool) -> None:
        """See Host."""
        if plugged and self._listener is None:
            self._listener = socket.create_server(("127.0.0.1", self._port))
        elif not plugged:
            self.close()

    def wait(self, timeout_s: float) -> bytes:
        """See Host."""
        if self._listener is None:
            time.sleep(timeout_s)
            return b""
        source = self._listener if self._peer is None else self._peer
        ready, _, _ = select.select([source], [], [], timeout_s)
        if not ready:
            return b""
        if self._peer is None:
            self._peer, _ = self._listener.accept()
            self._peer.setblocking(False)
            self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return b""
        try:
            data = self._peer.recv(_READ_BYTES)
        except OSError:
            data = b""
        if not data:
            self._leave()
        return data

    def send(self, data: bytes) -> None:
        """See Host."""
        if self._peer is None:
            return
        self._unread += data
        if not self._unread:
            return
        try:
            self._unread = self._unread[self._peer.send(self._unread) :]
        except BlockingIOError:
            if len(self._unread) > _UNREAD_BYTES:
                self._unread = b""
        except OSError:
            self._leave()

    def close(self) -> None:
        """Close the port and whoever is connected."""
        self._leave()
        if self._listener is not None:
            self._listener.close()
        self._listener = None

    def _leave(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer = None
        self._unread = b""
