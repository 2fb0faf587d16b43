"""Entry point: finds the command, and turns every error into one sentence and an exit status."""

from __future__ import annotations

import importlib
import io
import os
import sys
from collections.abc import Sequence

import click

from skinlab.cli.groups import SuggestingGroup
from skinlab.cli.output import echo, echo_text

# Name on the command line → (module, help): `--help` imports none of the modules.
_COMMANDS = {
    "ui": ("ui", "The bedside terminal UI (also without a command)."),
    "measure": ("measure", "Measure without a screen: acquire, identify, record."),
    "ports": ("ports", "List the serial ports of this computer."),
    "replay": ("replay", "Run a recorded session through the same pipeline."),
    "recover": ("recover", "Turn what a crash left into a session."),
    "session": ("session", "Check a session, or say what is in it."),
    "identify": ("identify", "Identify skin parameters from curves."),
    "compare": ("compare", "Say whether the skin of two sessions differs."),
    "study": ("study", "Make one table of many curves, and say how reliable it is."),
    "cutometer": ("cutometer", "The Cutometer's own numbers of step curves."),
    "discrepancy": ("discrepancy", "Find the physical effect that the model misses."),
    "import": ("import_", "Make a session of curves that other software exported."),
    "watch": ("watch", "Identify each exported file as it lands in a folder."),
    "export": ("export", "Write a session as tidy files."),
    "calibrate": ("calibrate", "Calibrate a probe on phantoms, or check it on one."),
    "capture": ("capture", "Record the raw bytes of a real instrument."),
    "forward": ("forward", "Simulate a curve."),
    "paper": ("paper", "Reproduce the paper's tables and figures."),
    "database": ("database", "The precomputed finite-element database."),
    "plugins": ("plugins", "List extensions, and check those that were added."),
}

INTERRUPTED = 130
INTERNAL = 70  # a bug of ours, as in sysexits.h


class _LazyGroup(SuggestingGroup):
    """A group whose commands are imported when they are used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"skinlab.cli.{_COMMANDS[cmd_name][0]}")
        command: click.Command = module.command
        command.name = cmd_name  # the pages of the command line call it so
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in _COMMANDS.items()])


@click.group(
    cls=_LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="skinlab")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Measure human skin at the bedside, identify its parameters, record and replay.

    Without a command: the terminal UI, which offers the simulated probe; in a pipe, with no
    terminal, one simulated measurement whose result is printed.

    \b
    Example: skinlab identify curve.csv --aperture-mm 6 --thickness-mm 1.0
    """
    if ctx.invoked_subcommand is None:
        ui = importlib.import_module("skinlab.cli.ui")
        ctx.invoke(ui.command)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the status of contracts: 0, 1, 2, 3, 4, 5 or 130."""
    # Many small systems: threads inside the linear algebra only get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if not os.environ.get("SOURCE_DATE_EPOCH", "0").isdecimal():
        del os.environ["SOURCE_DATE_EPOCH"]  # numpy and matplotlib fail where it is no number
    try:
        result = cli.main(args=arguments, prog_name="skinlab", standalone_mode=False)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.ClickException as error:
        shown = io.StringIO()
        error.show(shown)
        echo_text(shown.getvalue().rstrip("\n"), err=True)
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        return _say("interrupted", INTERRUPTED)
    except (OSError, SystemExit) as error:
        if isinstance(error.__context__, KeyboardInterrupt):
            # click prints an empty line when it is interrupted, and the terminal may be gone.
            return _say("interrupted", INTERRUPTED)
        if isinstance(error, BrokenPipeError | SystemExit):
            # The reader went away (`| head`), which click turns into an exit: nothing is wrong, and
            # nothing may be flushed at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return 0
        return _explain(error)
    except BaseException as error:  # noqa: BLE001 -- the last resort: a sentence, never a traceback
        return _explain(error)


def _explain(error: BaseException) -> int:
    from drivers.errors import (
        DialectFileError,
        DriverError,
        PortFileError,
        PortUrlError,
        UnknownDialectError,
    )
    from skinlab.errors import SkinlabError

    if isinstance(error, SkinlabError):
        return _say(str(error), error.exit_status)
    if isinstance(error, PortUrlError | UnknownDialectError):
        return _say(str(error), 2)
    if isinstance(error, DialectFileError | PortFileError):
        return _say(str(error), 3)
    if isinstance(error, DriverError):
        return _say(str(error), 4)
    if isinstance(error, OSError):
        # Python's own words have a number first, and the file last
        words = error.strerror or str(error)
        return _say(words if error.filename is None else f"{error.filename}: {words}", 3)
    from skinlab.io.log import log_exception
    from skinlab.plugins import blamed

    where, why = log_exception(error), blamed(error)
    if why is not None:
        return _say(f"{why}; details are in {where}", SkinlabError.exit_status)
    return _say(
        f"internal error ({type(error).__name__}: {error}); details are in {where}", INTERNAL
    )


def _say(sentence: str, status: int) -> int:
    echo(f"skinlab: {sentence}", err=True)
    return status
