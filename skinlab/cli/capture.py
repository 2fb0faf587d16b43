"""`skinlab capture`: record what a real instrument says, for whoever adds its dialect."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.options import dialect_option
from skinlab.cli.output import echo
from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from drivers.dialect import Dialect


@click.command()
@click.option("--port", required=True, help="pyserial URL of the instrument: /dev/ttyUSB0, COM3, …")
@dialect_option()
@click.option("--through", help="Where its software connects: pty, tcp, tcp:PORT or a serial port.")
@click.option(
    "--framing",
    default="8N1",
    show_default=True,
    type=click.Choice([f"{b}{p}{s}" for b in (7, 8) for p in "NEO" for s in (1, 2)]),
    help="Data bits, parity, stop bits.",
)
@click.option("--seconds", type=float, help="End by itself [default: Ctrl-C].")
@click.option("--out", required=True, type=PATH, help="The file to write.")
def command(
    port: str,
    dialect: str | None,
    through: str | None,
    framing: str,
    seconds: float | None,
    out: Path,
) -> int:
    """Record the raw bytes of a real instrument with their times; docs/dialects.md says what for.

    Alone it only listens, and sends nothing. With --through it stands between the instrument and
    the manufacturer's software and passes the bytes on both ways; what the software is to connect
    to is printed first. With --dialect (or in the URL) the file keeps the dialect, and the last
    line says how much of the traffic the dialect understands.

    \b
    Example: skinlab capture --port "/dev/ttyUSB0?baud=9600" --through pty --out traffic.jsonl
    """
    import time
    from contextlib import ExitStack
    from datetime import UTC, datetime

    from drivers.capture import CaptureWriter, Side
    from drivers.dialects import describe_dialect, split_dialect
    from drivers.link import Link, open_link
    from drivers.passthrough import listen, open_software_side
    from drivers.probe import choose_dialect
    from skinlab.acquisition.shutdown import HeldInterrupt
    from skinlab.errors import InputError
    from skinlab.io.files import cannot_write, check_can_write, make_folder

    name = split_dialect(port)[1] or dialect
    address, speaks = choose_dialect(port, dialect)
    facts: dict[str, Any] = {
        "created_utc": datetime.now(UTC).isoformat(),
        "port": port,
        "framing": framing,
        "through": through,
    }
    if name is not None:
        facts["dialect"] = describe_dialect(speaks)
    if out.exists():
        raise InputError(f"{out}: exists already; a capture is never overwritten")
    if seconds is not None and not seconds >= 0:  # nan is not, either
        raise InputError(f"seconds {seconds:g}: expected 0 or more")
    with cannot_write(out):
        make_folder(out.parent)
    check_can_write(out)
    with ExitStack() as stack:
        software: Link | None = None
        if through is not None:
            url, software = open_software_side(through, framing)
            stack.callback(software.close)
        instrument = open_link(address, framing)  # last: nothing is wrong with the arguments
        stack.callback(instrument.close)
        writer = stack.enter_context(CaptureWriter(out, facts))
        if through is not None:
            echo(url)
            sys.stdout.flush()
        echo(f"capturing to {out}; Ctrl-C ends", err=True)
        held = stack.enter_context(HeldInterrupt())
        try:
            listen(instrument, software, writer.write, time.monotonic, seconds, held.check)
        finally:
            counts = ", ".join(f"{writer.bytes_of[side]} bytes from the {side}" for side in Side)
            echo(f"{out}: {counts}", err=True)
            if name is not None:
                try:
                    told = _understood(out, speaks)
                except (OSError, ValueError) as error:  # what was captured is there all the same
                    told = f"what dialect {speaks.name!r} understands of it is not known ({error})"
                echo(f"{out}: {told}", err=True)
    return 0


def _understood(path: Path, dialect: Dialect) -> str:
    """Return in words how much of a capture a dialect understands."""
    from drivers.capture import decode_capture, read_capture
    from drivers.events import Damaged
    from drivers.line_dialect import IGNORED

    frames = damaged = 0
    last = b""
    for _, _, what in decode_capture(read_capture(path)[1], dialect):
        if not isinstance(what, Damaged):
            frames += 1
        elif what.reason != IGNORED:
            damaged, last = damaged + 1, what.data
    told = f"dialect {dialect.name!r} understands {frames} frames"
    return f"{told}, and not {damaged}, the last one {last[:60]!r}" if damaged else told
