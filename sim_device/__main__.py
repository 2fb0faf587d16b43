"""`python -m sim_device`: the simulated probe as a process of its own, on a pty or a TCP port."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import NoReturn

import click

from skinlab.io.files import private
from skinlab.text import inert

EXIT_BAD_INPUT = 3
EXIT_LINK = 4
_FILE = click.Path(readable=False, path_type=Path)  # what cannot be read is bad input, not usage


@click.command(epilog="Example: python -m sim_device --pty --skin SKIN.toml --speed 10")
@click.option("--pty", is_flag=True, help="Serve on a new pseudo terminal.")
@click.option(
    "--tcp", type=click.IntRange(0, 65535), metavar="PORT", help="Serve on 127.0.0.1; 0: any port."
)
@click.option("--skin", type=_FILE, help="SKIN.toml; default: a plain skin.")
@click.option("--faults", type=_FILE, help="FAULTS.toml; default: none.")
@click.option("--speed", default=1.0, show_default=True, help="Device seconds in a host second.")
@click.option("--seed", default=0, show_default=True, help="Of all noise.")
@click.option("--aperture-mm", default=6.0, show_default=True, help="Diameter of the opening.")
@click.option("--phantom", help="A phantom of the kit in place of the skin: flat, step, soft, …")
@click.option("--trace", type=_FILE, help="Write the true pressure here, as a CSV.")
def main(
    pty: bool,
    tcp: int | None,
    skin: Path | None,
    faults: Path | None,
    speed: float,
    seed: int,
    aperture_mm: float,
    phantom: str | None,
    trace: Path | None,
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
        device = build_device(
            skin,
            seed=seed,
            speed=speed,
            aperture_mm=aperture_mm,
            faults_file=faults,
            phantom=phantom,
            trace=None if trace is None else _open_trace(trace),
        )
    except ValueError as error:
        _fail(str(error), EXIT_BAD_INPUT)
    try:
        host = PtyHost(unpluggable=faults is not None) if tcp is None else TcpHost(tcp)
    except OSError as error:
        _fail(f"cannot serve: {error.strerror or error}", EXIT_LINK)
    with host:
        click.echo(host.url)
        serve(device, host, speed)


def _open_trace(path: Path) -> Callable[[float, float, str], None]:
    try:
        file = open(  # noqa: SIM115 -- to the end; each row is there as it happens
            path, "w", encoding="ascii", buffering=1, opener=private
        )
        file.write("time_s,pressure_mbar,state\n")
    except OSError as error:
        _fail(f"{path}: cannot be written ({error.strerror or error})", EXIT_BAD_INPUT)

    def write(time_s: float, pressure_mbar: float, state: str) -> None:
        file.write(f"{time_s:.3f},{pressure_mbar:.6f},{state}\n")

    return write


def _fail(message: str, status: int) -> NoReturn:
    click.echo(f"sim_device: {inert(message)}", err=True)
    raise SystemExit(status)


def _end(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, _end)
    signal.signal(signal.SIGTERM, _end)
    try:
        main(prog_name="python -m sim_device")
    except OSError as error:  # a full disk behind a redirection, or under --trace
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # nothing may be flushed at exit
        _fail(f"cannot write: {error.strerror or error}", EXIT_BAD_INPUT)
