"""Stand between an instrument and the software that drives it, and see every byte both ways.

Nothing is ever sent but what one side said to the other.
"""

from __future__ import annotations

import os
import select
import socket
from collections.abc import Callable

from drivers.capture import Chunk, Side
from drivers.errors import LinkError
from drivers.link import Link, open_link

_READ_BYTES = 4096
_READ_S = 0.01
_UNREAD_BYTES = 1 << 16  # what the software does not fetch beyond this is lost, as on a serial line


def listen(
    instrument: Link,
    software: Link | None,
    record: Callable[[Chunk], None],
    clock: Callable[[], float],
    seconds: float | None = None,
    check: Callable[[], None] = lambda: None,
) -> None:
    """Record what the instrument sends, for `seconds` (None: for ever); pass bytes both ways.

    It ends too where `check` raises, which is called between two reads: nothing that was read is
    lost.

    Without `software` nothing is sent at all. Times count from the call, on `clock`.
    Raises LinkError when the instrument's link (or a serial port of the software's) is lost.
    """
    start = clock()
    while seconds is None or clock() - start < seconds:
        check()
        data = instrument.read(_READ_BYTES, _READ_S)
        if data:
            record(Chunk(clock() - start, Side.INSTRUMENT, data))
            if software is not None:
                software.write(data)
        if software is not None and (asked := software.read(_READ_BYTES, 0.0)):
            record(Chunk(clock() - start, Side.SOFTWARE, asked))
            instrument.write(asked)


def open_software_side(where: str, framing: str = "8N1") -> tuple[str, Link]:
    """Make the place to which the software connects, and say what to give it.

    where: `pty`, `tcp`, `tcp:PORT` (of this computer), or a serial port, such as one end of a pair
    of virtual ones. Raises LinkError.
    """
    try:
        if where == "pty":
            pty = _Pty()
            return pty.url, pty
        if where == "tcp" or where.startswith("tcp:"):
            tcp = _Tcp(int(where.partition(":")[2] or "0"))
            return tcp.url, tcp
    except (OSError, ValueError) as error:
        raise LinkError(f"cannot open {where} for the software: {error}") from None
    return where, open_link(where, framing)


class _Pty:
    def __init__(self) -> None:
        try:
            import tty
        except ImportError:
            raise OSError("this system has no pseudo terminals; use tcp") from None
        # The other end stays open here: so it stays raw, and the software can leave and come back
        self._mine, self._other = os.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._mine, False)
        self.url = os.ttyname(self._other)
        self._unread = b""

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        self.write(b"")
        ready, _, _ = select.select([self._mine], [], [], timeout_s)
        return os.read(self._mine, max_bytes) if ready else b""

    def write(self, data: bytes) -> None:
        self._unread += data
        try:
            while self._unread:
                self._unread = self._unread[os.write(self._mine, self._unread) :]
        except BlockingIOError:
            self._unread = self._unread[-_UNREAD_BYTES:]

    def close(self) -> None:
        os.close(self._mine)
        os.close(self._other)


class _Tcp:
    """One program at a time; it can leave, and another one come."""

    def __init__(self, port: int) -> None:
        if not 0 <= port <= 65535:
            raise ValueError(f"port {port} is outside 0 to 65535")
        self._listener = socket.create_server(("127.0.0.1", port))
        self._peer: socket.socket | None = None
        self._unread = b""
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        self.write(b"")
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
            data = self._peer.recv(max_bytes)
        except OSError:
            data = b""
        if not data:
            self._leave()
        return data

    def write(self, data: bytes) -> None:
        if self._peer is None:
            return
        self._unread += data
        try:
            while self._unread:
                self._unread = self._unread[self._peer.send(self._unread) :]
        except BlockingIOError:
            self._unread = self._unread[-_UNREAD_BYTES:]
        except OSError:
            self._leave()

    def close(self) -> None:
        self._leave()
        self._listener.close()

    def _leave(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer = None
        self._unread = b""
