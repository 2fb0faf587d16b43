"""`skinlab ports`: what a probe can be connected to."""

from __future__ import annotations

import click

from skinlab.cli.options import json_option
from skinlab.cli.output import echo, print_json


@click.command()
@json_option()
def command(as_json: bool) -> int:
    """List the serial ports of this computer, with what they say of themselves.

    What stands first in a line goes to --port. A faster line: /dev/ttyUSB0?baud=921600.

    \b
    Example: skinlab ports
    """
    from dataclasses import asdict

    from drivers.link import list_ports

    ports = list_ports()
    if as_json:
        print_json({"schema": "skinlab.ports/1", "ports": [asdict(port) for port in ports]})
        return 0
    for port in ports:
        echo(f"{port.url}  {port.details}")
    if not ports:
        echo("no serial port found; the simulated probe is sim://?seed=1", err=True)
    return 0
