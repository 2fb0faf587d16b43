"""`skinlab ui`: the bedside terminal UI; with no terminal, the same measurement headless."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path

import click

SIMULATED = "sim://?seed=1"


@click.command()
@click.option("--port", default=SIMULATED, help="pyserial URL [default: the simulated probe].")
@click.option("--sessions", type=click.Path(path_type=Path), help="Folder for the sessions.")
def command(port: str = SIMULATED, sessions: Path | None = None) -> int:
    """Open the bedside terminal UI.

    With no terminal (in a pipe): one measurement, headless, whose result is printed.

    \b
    Example: skinlab ui --port /dev/ttyUSB0
    """
    folder = sessions or default_folder()
    # The screen is drawn on standard error.
    if sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty():
        return _on_terminal(port, folder)
    return _headless(port, folder)


def _on_terminal(port: str, folder: Path) -> int:
    from skinlab.tui.app import SkinlabApp
    from skinlab.tui.lifeline import Lifeline
    from skinlab.tui.remembered import default_path

    app = SkinlabApp(port, folder, settings=default_path())
    try:
        with Lifeline(app.bench.vent, app.interrupt, app.bench.close):
            app.run()
    finally:
        app.bench.close()  # vented and saved already, unless the screen itself came to grief
    if app.failure is not None:
        raise app.failure
    if app.board.saved is not None:
        click.echo(f"session: {app.board.saved}", err=True)
    return app.return_code or 0


def default_folder() -> Path:
    """Return where sessions go when nobody says where."""
    from platformdirs import user_data_path

    return user_data_path("skinlab", appauthor=False) / "sessions"


def _headless(port: str, folder: Path) -> int:
    from skinlab.cli.measure import run
    from skinlab.cli.options import make_identifier
    from skinlab.curve import Setup
    from skinlab.measure import Plan
    from skinlab.program import parse_program
    from skinlab.recording import new_session_path

    click.echo(f"no terminal: measuring once at {port}", err=True)
    identifier = make_identifier(
        method="auto",
        best=20,
        tolerance_um=1e-5,
        seed=0,
        kappa="paper",
        phases="load",
    )
    plan = Plan(Setup(6.0, 1.0, parse_program("ramp:100@20")))
    out = new_session_path(folder, datetime.now())
    return run(port, plan, out, identifier, as_json=False)
