"""Stand between an instrument and the software that drives it, and see every byte both ways.

Nothing is ever sent but what one side said to the other.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.capture import Chunk, Side
from drivers.errors import LinkError, PortUrlError
from drivers.link import Link, open_link
from drivers.near_end import Pty, Tcp
from drivers.numbers import whole_in

_READ_BYTES = 4096
_READ_S = 0.01


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
    of virtual ones. Raises LinkError; PortUrlError where it is no such place.
    """
    try:
        if where == "pty":
            pty = Pty()
            return pty.url, pty
        if where == "tcp" or where.startswith("tcp:"):
            tcp = Tcp(whole_in(where.partition(":")[2] or "0"))
            return tcp.url, tcp
    except (OSError, ValueError, OverflowError) as error:  # of a port above 65535
        kind = LinkError if isinstance(error, OSError) else PortUrlError
        raise kind(f"cannot open {where} for the software: {error}") from None
    return where, open_link(where, framing)
