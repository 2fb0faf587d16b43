"""`skinlab ui`: the bedside terminal UI; with no terminal, the same measurement headless."""

from __future__ import annotations

import os
import sys
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivers.limits import DEFAULT_DOSE_MBAR_S
from skinlab.cli.options import database_option, dialect_option
from skinlab.cli.output import echo

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier
    from skinlab.tui.app import SkinlabApp

SIMULATED = "sim://?seed=1"
ESCAPE_MS = "40"


@click.command()
@click.option("--port", help="pyserial URL [default: asks; the simulated probe headless].")
@dialect_option()
@click.option("--sessions", type=click.Path(path_type=Path), help="Folder for the sessions.")
@click.option(
    "--model", "model_path", type=click.Path(path_type=Path), help="MODEL.toml to identify with."
)
@database_option()
@click.option(
    "--dose-limit-mbar-s",
    type=float,
    help=f"Most suction times time for a site in a visit [default: {DEFAULT_DOSE_MBAR_S:g}].",
)
def command(
    port: str | None = None,
    dialect: str | None = None,
    sessions: Path | None = None,
    model_path: Path | None = None,
    database_path: Path | None = None,
    dose_limit_mbar_s: float | None = None,
) -> int:
    """Open the bedside terminal UI.

    With no terminal (in a pipe): one measurement, headless, whose result is printed.

    \b
    Example: skinlab ui --port /dev/ttyUSB0
    """
    folder = sessions or default_folder()
    # What is wrong with these is said without a screen.
    from drivers.dialects import DEFAULT, get_dialect

    get_dialect(dialect or DEFAULT)
    said = None
    if model_path is not None or database_path is not None:
        said = _identifier(model_path, database_path)
    if has_screen():
        return _on_terminal(port, dialect, folder, said, dose_limit_mbar_s)
    return _headless(port or SIMULATED, dialect, folder, said or _identifier(), dose_limit_mbar_s)


def _identifier(model_path: Path | None = None, database_path: Path | None = None) -> Identifier:
    """Return what identifies with the defaults of `measure`.

    Raises:
        InputError: a file cannot be used, or one is of another law or model than the other.
    """
    from skinlab.api.identifiers import compose_identifier

    return compose_identifier(model=model_path, database=database_path)


def has_screen() -> bool:
    """Return whether the UI can be shown: on a terminal, or by `textual serve` in a browser."""
    if os.environ.get("TEXTUAL_DRIVER"):
        return True
    # The screen is drawn on standard error.
    return sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()


def _on_terminal(
    port: str | None,
    dialect: str | None,
    folder: Path,
    identifier: Identifier | None,
    dose_limit_mbar_s: float | None,
) -> int:
    """Show the screen; without an identifier it makes its own, beside."""
    from skinlab.acquisition.session_run import probes

    make_probe = probes(dose_limit_mbar_s, dialect)
    _release_escape()
    from skinlab.acquisition.probe_session import ProbeSession
    from skinlab.acquisition.settings import default_path
    from skinlab.tui.app import SkinlabApp

    bench = partial(ProbeSession, apart=True, make_probe=make_probe)
    model = None
    if identifier is not None:
        bench = partial(bench, make_identifier=lambda: identifier)
        model = identifier.model_name
    return show(SkinlabApp(port, folder, bench, settings=default_path(), model=model))


def replay_on_terminal(session: Path, speed: float | None, database_path: Path | None) -> int:
    """Replay a session in the screens of the UI; return the exit status."""
    _release_escape()
    from skinlab.acquisition.replayer import Replayer
    from skinlab.tui.app import SkinlabApp

    player = partial(Replayer, database_path=database_path)
    return show(SkinlabApp(None, session.parent, replay=session, speed=speed, make_replayer=player))


def show(app: SkinlabApp) -> int:
    """Run the UI; whatever ends it, the probe vents and the session is saved."""
    from skinlab.acquisition.shutdown import Lifeline
    from skinlab.quality.gates import all_gates
    from skinlab.tui.prompt_escape import look_sooner

    look_sooner()
    all_gates()  # what is wrong with a plugin is said while there still is a standard error
    try:
        with Lifeline(app.vent, app.interrupt, app.close_bench):
            app.run()
    finally:
        app.close_bench()  # done already, unless the screen itself came to grief
    if app.failure is not None:
        raise app.failure
    if app.board.saved is not None:
        echo(f"session: {app.board.saved}", err=True)
    return app.return_code or 0


def _release_escape() -> None:
    """Let a lone Esc vent sooner: Textual waits 100 ms to see whether more follows."""
    os.environ.setdefault("ESCDELAY", ESCAPE_MS)  # read when Textual is imported


def default_folder() -> Path:
    """Return where sessions go when nobody says where."""
    from platformdirs import user_data_path

    return user_data_path("skinlab", appauthor=False) / "sessions"


def _headless(
    port: str,
    dialect: str | None,
    folder: Path,
    identifier: Identifier,
    dose_limit_mbar_s: float | None,
) -> int:
    from drivers.probe import choose_dialect
    from skinlab.acquisition.measurement import Plan
    from skinlab.cli.measure import run
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.recording.recorder import new_session_path

    echo(f"no terminal: measuring once at {port}", err=True)
    plan = Plan(Setup(6.0, 1.0, parse_program("ramp:100@20")))
    out = new_session_path(folder, datetime.now())
    return run(
        port,
        plan,
        out,
        identifier,
        dialect=choose_dialect(port, dialect)[1],
        dose_limit_mbar_s=dose_limit_mbar_s,
        as_json=False,
    )
