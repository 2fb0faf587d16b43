"""A place of this computer to which a program connects: a pseudo terminal or a TCP port.

Whoever is there can leave, and another one come.
"""

from __future__ import annotations

import os
import select
import socket

_UNREAD_BYTES = 1 << 16  # what nobody fetches beyond this is lost, as on a serial line


class Pty:
    """A raw pseudo terminal; `url` is the path to open. Raises OSError."""

    def __init__(self) -> None:
        try:
            import tty
        except ImportError:
            raise OSError("this system has no pseudo terminals; use tcp") from None
        # The other end stays open here: so it stays raw, and a program can leave and come back
        self._mine, self._other = os.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._mine, False)
        self.url = os.ttyname(self._other)
        self._unread = b""

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """See Link."""
        waits = [self._mine] if self._unread else []
        ready, writable, _ = select.select([self._mine], waits, [], timeout_s)
        if writable:
            self.write(b"")
        return os.read(self._mine, max_bytes) if ready else b""

    def write(self, data: bytes) -> None:
        """Send what can be sent now."""
        self._unread += data
        try:
            while self._unread:
                self._unread = self._unread[os.write(self._mine, self._unread) :]
        except BlockingIOError:
            self._unread = self._unread[-_UNREAD_BYTES:]

    def close(self) -> None:
        """Close both ends: the program sees it go."""
        os.close(self._mine)
        os.close(self._other)


class Tcp:
    """A TCP port, for one program at a time; the next one waits. Raises OSError, ValueError."""

    def __init__(self, port: int) -> None:
        if not 0 <= port <= 65535:
            raise ValueError(f"port {port} is outside 0 to 65535")
        self._listener = socket.create_server(("127.0.0.1", port))
        self._peer: socket.socket | None = None
        self._unread = b""
        self.port = int(self._listener.getsockname()[1])
        self.url = f"socket://127.0.0.1:{self.port}"

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """See Link."""
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
        """Send what can be sent now."""
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
        """Close the port and whoever is connected."""
        self._leave()
        self._listener.close()

    def _leave(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer = None
        self._unread = b""
