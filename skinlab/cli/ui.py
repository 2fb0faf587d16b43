"""`skinlab ui`: the bedside terminal UI; with no terminal, the same measurement headless."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivers.limits import DEFAULT_DOSE_MBAR_S
from skinlab.cli.options import database_option, dialect_option, probe_option, study_option
from skinlab.cli.output import echo
from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from skinlab.acquisition.protocol import NamedProtocol
    from skinlab.inference.identify import Identifier
    from skinlab.studies.reference import Reference
    from skinlab.tui.app import SkinlabApp
    from skinlab.tui.settings_file import UserSettings

SIMULATED = "sim://?seed=1"
ESCAPE_MS = "40"


@click.command()
@click.option("--port", help="pyserial URL [default: asks; the simulated probe headless].")
@dialect_option()
@click.option("--sessions", type=PATH, help="Folder for the sessions.")
@click.option("--model", "model_path", type=PATH, help="MODEL.toml to identify with.")
@database_option()
@probe_option()
@click.option(
    "--prior",
    "prior_path",
    type=PATH,
    help="STUDY.toml of `skinlab study`: what is known of such people, of all its sites and ages.",
)
@study_option()
@click.option(
    "--dose-limit-mbar-s",
    type=float,
    help=f"Largest dose (suction × time) for a site in a visit [default: {DEFAULT_DOSE_MBAR_S:g}].",
)
@click.option(
    "--reference",
    "reference_path",
    type=PATH,
    help="REFERENCE.toml with the reference ranges shown behind the values.",
)
@click.option(
    "--protocol",
    "protocol_path",
    type=PATH,
    help="PROTOCOL.toml of a study, through which the screen leads.",
)
@click.option("--serve", is_flag=True, help="In a browser: prints the address to open.")
@click.option(
    "--serve-host", default="127.0.0.1", show_default=True, help="Where to listen, with --serve."
)
@click.option(
    "--serve-port",
    default=8017,
    show_default=True,
    type=click.IntRange(1, 65535),
    help="TCP port, with --serve.",
)
def command(
    port: str | None = None,
    dialect: str | None = None,
    sessions: Path | None = None,
    model_path: Path | None = None,
    database_path: Path | None = None,
    probe_path: Path | None = None,
    prior_path: Path | None = None,
    study: Path | None = None,
    dose_limit_mbar_s: float | None = None,
    reference_path: Path | None = None,
    protocol_path: Path | None = None,
    serve: bool = False,
    serve_host: str = "127.0.0.1",
    serve_port: int = 8017,
) -> int:
    """Open the bedside terminal UI.

    With no terminal (in a pipe): one measurement, headless, whose result is printed. With --serve
    it is shown in a browser, for a tablet beside the bed: on this computer only unless --serve-host
    says otherwise, and only to whoever has the address with its token.

    \b
    Example: skinlab ui --port /dev/ttyUSB0
             skinlab ui --serve --port /dev/ttyUSB0
    """
    folder = sessions or default_folder()
    # What is wrong with these is said without a screen.
    from drivers.dialects import DEFAULT, get_dialect

    get_dialect(dialect or DEFAULT)
    if port is not None:
        from drivers.probe import choose_dialect

        choose_dialect(port, dialect)
    said = None
    if any((model_path, database_path, probe_path, prior_path)):
        said = _identifier(model_path, database_path, probe_path, prior_path)
    if study is not None:
        from skinlab.studies.change import components_of

        components_of(study)
    reference = None
    if reference_path is not None:
        from skinlab.studies.reference import read_reference

        reference = read_reference(reference_path)
    protocol = None
    if protocol_path is not None:
        from skinlab.acquisition.protocol import read_protocol

        protocol = read_protocol(protocol_path)
    if serve:
        from skinlab.acquisition.session_run import probes

        probes(dose_limit_mbar_s, dialect)
        user_settings()
        given = {
            "--port": port,
            "--dialect": dialect,
            "--sessions": folder,
            "--model": model_path,
            "--database": database_path,
            "--probe": probe_path,
            "--prior": prior_path,
            "--study": study,
            "--dose-limit-mbar-s": dose_limit_mbar_s,
            "--reference": reference_path,
            "--protocol": protocol_path,
        }
        return _serve(given, serve_host, serve_port)
    if has_screen():
        return _on_terminal(
            port, dialect, folder, said, dose_limit_mbar_s, reference, protocol, study
        )
    if protocol is not None:
        raise click.UsageError("--protocol needs a terminal; measure --protocol does without one")
    return _headless(port or SIMULATED, dialect, folder, said or _identifier(), dose_limit_mbar_s)


def _identifier(
    model_path: Path | None = None,
    database_path: Path | None = None,
    probe_path: Path | None = None,
    prior_path: Path | None = None,
) -> Identifier:
    """Return what identifies with the defaults of `measure`.

    Raises:
        InputError: a file cannot be used, or one is of another law or model than the other.
    """
    from skinlab.api.identifiers import compose_identifier

    return compose_identifier(
        model=model_path, database=database_path, probe=probe_path, prior=prior_path
    )


def has_screen() -> bool:
    """Return whether the UI can be shown: on a terminal, or by `textual serve` in a browser."""
    if os.environ.get("TEXTUAL_DRIVER"):
        return True
    # The screen is drawn on standard error.
    return sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()


def check_terminal() -> None:
    """Refuse a terminal that cannot place text: the screen would stay half empty, and hear no key.

    Raises:
        InputError: it is one.
    """
    from skinlab.errors import InputError

    name = os.environ.get("TERM", "")
    if name.lower() in {"dumb", "unknown"} and not os.environ.get("TEXTUAL_DRIVER"):
        raise InputError(
            f"TERM={name}: expected a terminal that can show a screen, such as xterm; "
            "`skinlab measure` needs none"
        )


def _on_terminal(
    port: str | None,
    dialect: str | None,
    folder: Path,
    identifier: Identifier | None,
    dose_limit_mbar_s: float | None,
    reference: Reference | None,
    protocol: NamedProtocol | None,
    study: Path | None,
) -> int:
    """Show the screen; without an identifier it makes its own, beside."""
    from skinlab.acquisition.session_run import probes

    check_terminal()
    make_probe = probes(dose_limit_mbar_s, dialect)
    _release_escape()
    from skinlab.acquisition.probe_session import ProbeSession
    from skinlab.acquisition.settings import default_path
    from skinlab.tui.app import SkinlabApp

    user = user_settings()
    bench = partial(ProbeSession, apart=True, make_probe=make_probe)
    model = None
    if identifier is not None:
        calibration = identifier.sensor.probe
        bench = partial(bench, make_identifier=lambda: identifier, calibration=calibration)
        model = identifier.model_name
    app = SkinlabApp(
        port,
        folder,
        bench,
        settings=default_path(),
        model=model,
        reference=reference,
        user=user,
        protocol=protocol,
        study=study,
    )
    return show(app)


def user_settings() -> UserSettings:
    """Return what the user's settings file says of the screen.

    Raises:
        InputError: something in it is wrong.
    """
    from skinlab.tui.key_owners import owners
    from skinlab.tui.settings_file import default_settings_path, read_settings

    return read_settings(default_settings_path(), owners())


def _serve(given: Mapping[str, object], host: str, port: int) -> int:
    """Serve until Ctrl+C, with the options that were given."""
    import secrets

    from skinlab.tui.serve import LOOPBACK, serve

    if host != LOOPBACK:
        echo(f"skinlab: whoever reaches {host} and has the token can start suction", err=True)

    def tell(url: str) -> None:
        echo("open this address in a browser; Ctrl+C ends it", err=True)
        echo(url)

    arguments = [str(part) for pair in given.items() if pair[1] is not None for part in pair]
    serve(arguments, host=host, port=port, token=secrets.token_urlsafe(24), tell=tell)
    return 0


def replay_on_terminal(session: Path, speed: float | None, database_path: Path | None) -> int:
    """Replay a session in the screens of the UI; return the exit status."""
    check_terminal()
    _release_escape()
    from skinlab.acquisition.replayer import Replayer
    from skinlab.tui.app import SkinlabApp

    player = partial(Replayer, database_path=database_path)
    app = SkinlabApp(
        None,
        session.parent,
        replay=session,
        speed=speed,
        make_replayer=player,
        user=user_settings(),
    )
    return show(app)


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
    from skinlab.acquisition.measurement_messages import Plan
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
