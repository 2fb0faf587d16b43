"""`python -m sim_device`: the simulated probe as a process of its own, on a pty or a TCP port."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import NoReturn

import click

EXIT_BAD_INPUT = 3
EXIT_LINK = 4


@click.command(epilog="Example: python -m sim_device --pty --skin SKIN.toml --speed 10")
@click.option("--pty", is_flag=True, help="Serve on a new pseudo terminal.")
@click.option(
    "--tcp", type=click.IntRange(0, 65535), metavar="PORT", help="Serve on 127.0.0.1; 0: any port."
)
@click.option("--skin", type=click.Path(path_type=Path), help="SKIN.toml; default: a plain skin.")
@click.option("--speed", default=1.0, show_default=True, help="Device seconds in a host second.")
@click.option("--seed", default=0, show_default=True, help="Of all noise.")
@click.option("--aperture-mm", default=6.0, show_default=True, help="Diameter of the opening.")
def main(
    pty: bool, tcp: int | None, skin: Path | None, speed: float, seed: int, aperture_mm: float
) -> None:
    """Be a suction probe on a skin of finite elements.

    The first line of standard output is the URL to connect to, and the only one. A host may leave
    and come back; meanwhile the probe misses its keep-alive and vents. SIGINT and SIGTERM end it.
    """
    if pty == (tcp is not None):
        raise click.UsageError("give one of --pty and --tcp PORT")
    # One probe needs one core; its small matrices only suffer from more
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Not at the top: --help and wrong usage need none of it
    from sim_device.build import build_device
    from sim_device.serve import PtyHost, TcpHost, serve

    try:
        device = build_device(skin, seed=seed, speed=speed, aperture_mm=aperture_mm)
    except ValueError as error:
        _fail(str(error), EXIT_BAD_INPUT)
    try:
        host = PtyHost() if tcp is None else TcpHost(tcp)
    except OSError as error:
        _fail(f"cannot serve: {error.strerror or error}", EXIT_LINK)
    with host:
        click.echo(host.url)
        sys.stdout.flush()
        serve(device, host, speed)


def _fail(message: str, status: int) -> NoReturn:
    click.echo(f"sim_device: {message}", err=True)
    raise SystemExit(status)


def _end(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, _end)
    signal.signal(signal.SIGTERM, _end)
    main(prog_name="python -m sim_device")
