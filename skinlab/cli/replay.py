"""`skinlab replay`: a recorded session through the same pipeline."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from skinlab.cli.options import database_option, json_option
from skinlab.cli.output import echo, echo_text, print_json, status_line
from skinlab.cli.paths import PATH
from skinlab.text import counted

_KEYS = "space pauses and goes on, . steps, 1 x m: pace as it was, tenfold, without waiting; q ends"
_DRAW_S = 0.05
_ROUNDING = 1e-6  # of a number: results went by 1e-9 at most from one processor to another


@click.command()
@click.argument("session", type=PATH)
@click.option(
    "--speed",
    type=click.Choice(["1", "10", "max"]),
    help="Pace [default: max; with --ui as it was].",
)
@click.option("--ui", is_flag=True, help="In the screens of the terminal UI.")
@click.option("--paused", is_flag=True, help="Begin paused (on a terminal, where keys go on).")
@click.option("--verify", is_flag=True, help="Compare with the stored results.")
@database_option("the one that SESSION names")
@json_option()
def command(
    session: Path,
    speed: str | None,
    ui: bool,
    paused: bool,
    verify: bool,
    database_path: Path | None,
    as_json: bool,
) -> int:
    """Run a recorded SESSION through driver, assembler, gates and identification again.

    On a terminal, a replay that is not at full speed takes keys: space pauses and goes on, the full
    stop lets one sample through, 1, x and m change the pace, q ends.

    \b
    Example: skinlab replay visit.h5 --speed max --verify
    """
    from skinlab.acquisition.replay import differences, identifier_of, is_imported, reasons, replay
    from skinlab.acquisition.replay_control import ReplayControl
    from skinlab.cli.keys import keys, on_terminal
    from skinlab.errors import InputError
    from skinlab.inference.result import Identification, document
    from skinlab.recording.advised import MISSING_EFFECT, advised_curves
    from skinlab.recording.dose import dose_of
    from skinlab.recording.session import read_session
    from skinlab.recording.stream import Flagged, Identified, Message
    from skinlab.report.text import describe
    from skinlab.report.verdict import FEW, FOR_EFFECT

    if ui:
        return _in_the_ui(session, speed or "1", database_path)
    speed = speed or "max"
    if paused and not on_terminal():
        raise InputError("--paused: there is no terminal whose keys could go on")
    recorded = read_session(session)
    identifier, warning = identifier_of(recorded, database_path)
    if warning:
        echo(f"skinlab: {warning}", err=True)
    if is_imported(recorded):
        sentence = "imported curves: there are no bytes to replay; the curves are identified again"
        echo(f"skinlab: {session}: {sentence}", err=True)
    because = advised_curves(recorded)
    results: list[Identification] = []

    def for_effect(index: int) -> bool:
        return because.get(f"curve {index}") == MISSING_EFFECT

    control = ReplayControl(None if speed == "max" else float(speed), paused=paused)
    shown = _line(control) if on_terminal() and (paused or speed != "max") else None

    def show(message: Message) -> None:
        if shown is not None and isinstance(message, Identified | Flagged):
            status_line("")
        if isinstance(message, Identified):
            results.append(message.result)
            if for_effect(message.index):
                echo(f"skinlab: curve {message.index}: {FOR_EFFECT}", err=True)
            if not as_json:
                echo_text(describe(message.result))
        elif isinstance(message, Flagged):
            if for_effect(message.index) and message.finding.gate == FEW:
                return
            echo(f"skinlab: curve {message.index}: {message.finding}", err=True)
        elif shown is not None:
            shown(message)

    with keys(_actions(control)) if shown is not None else contextlib.nullcontext():
        if shown is not None:
            echo(_KEYS, err=True)
        completed = replay(recorded, identifier, [show], control)
    if shown is not None:
        status_line("")
    if control.stopped:
        raise KeyboardInterrupt
    if as_json:
        dose = None if is_imported(recorded) else dose_of(recorded)
        print_json(document(identifier.provenance(), results, session=str(session), dose=dose))
    if not verify:
        return 0
    differ = differences(recorded, completed, results)
    if found := differ and differences(recorded, completed, results, _ROUNDING):
        for sentence in [*found, *_reasons(session, reasons(recorded, identifier))]:
            echo(f"skinlab: {session}: {sentence}", err=True)
        return 1
    if not as_json:
        stored = sum(result is not None for result in recorded.results)
        both = f"{counted(len(completed), 'curve')} and {counted(stored, 'stored result')}"
        how = "to a millionth (another processor rounds otherwise)" if differ else "bit for bit"
        echo(f"{both} agree {how}")
    return 0


def _reasons(session: Path, found: list[str]) -> list[str]:
    """Return why results may differ; where nothing is known, what to look at."""
    return [f"a reason: {reason}" for reason in found] or [
        "same software, database and machine: "
        f"`skinlab session verify {session}` says whether the file was changed"
    ]


def _in_the_ui(session: Path, speed: str, database_path: Path | None) -> int:
    from skinlab.cli.ui import has_screen, replay_on_terminal
    from skinlab.errors import InputError
    from skinlab.recording.session import read_session

    if not has_screen():
        raise InputError("--ui: there is no terminal to draw on")
    read_session(session)  # what is wrong with it is said without a screen
    return replay_on_terminal(session, None if speed == "max" else float(speed), database_path)


def _actions(control: Any) -> dict[str, Callable[[], None]]:
    return {
        " ": lambda: control.resume() if control.paused else control.pause(),
        ".": control.step,
        "1": lambda: control.set_speed(1.0),
        "x": lambda: control.set_speed(10.0),
        "m": lambda: control.set_speed(None),
        "q": control.stop,
    }


def _line(control: Any) -> Callable[[Any], None]:
    """Return a listener that keeps one line of a terminal up to date."""
    from skinlab.recording.stream import Sampled

    drawn = 0.0

    def draw(message: Any) -> None:
        nonlocal drawn
        now = time.monotonic()
        if not isinstance(message, Sampled) or (now - drawn < _DRAW_S and not control.paused):
            return
        drawn = now
        s = message.sample
        pace = "at full speed" if control.speed is None else f"{control.speed:g}x"
        status_line(
            f"curve {message.index}  {s.device_time_s:7.2f} s  {s.pressure_mbar:6.1f} mbar"
            f"  {s.deflection_mm:6.3f} mm  {'paused' if control.paused else pace}"
        )

    return draw
