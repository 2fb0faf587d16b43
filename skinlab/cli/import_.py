"""`skinlab import`: curves that other software exported become a session."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from skinlab.cli.importing import form_options, stated
from skinlab.cli.options import json_option
from skinlab.cli.output import echo, echo_text, print_json
from skinlab.cli.paths import PATH

T = TypeVar("T")


def _show_answers(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or ctx.resilient_parsing:
        return
    from skinlab.exchange.importing.remembered import Remembered, default_path

    echo_text("\n".join(Remembered(default_path()).lines))
    ctx.exit()


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH)
@click.option(
    "--aperture-mm",
    type=float,
    multiple=True,
    required=True,
    help="Diameter of the probe's opening: 2, 4, 6 or 8.",
)
@click.option(
    "--thickness-mm", type=float, multiple=True, required=True, help="Thickness of the skin."
)
@click.option(
    "--thickness-sd-mm", type=float, multiple=True, help="Standard deviation of the thickness."
)
@click.option("--program", multiple=True, help="What the pump did, e.g. ramp:100@20.")
@click.option("--cycle", type=int, multiple=True, help="1: first loading of the site [default: 1].")
@click.option("--repeat", type=int, multiple=True, help="Counts from 1 [default: 1].")
@click.option(
    "--placement",
    multiple=True,
    help="A name for one putting-on of the probe  [default: a curve of cycle 1 begins one].",
)
@form_options("not known")
@click.option("--ask-again", is_flag=True, help="Forget what was answered for such files before.")
@click.option(
    "--show-answers",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_answers,
    help="Show what was answered before, and where it is kept.",
)
@click.option("--out", required=True, type=PATH, help="The session to write.")
@json_option()
def command(
    files: tuple[Path, ...],
    aperture_mm: tuple[float, ...],
    thickness_mm: tuple[float, ...],
    thickness_sd_mm: tuple[float, ...],
    program: tuple[str, ...],
    cycle: tuple[int, ...],
    repeat: tuple[int, ...],
    placement: tuple[str, ...],
    subject: str,
    site: str,
    measured: str,
    out: Path,
    ask_again: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Make a session of curves that other software exported as text or .xlsx.

    Separator, decimal sign, encoding, header lines, columns and units are found by looking, and
    a line says what was understood. What stays open is asked for on a terminal, and refused in a
    pipe; an option answers it too. Answers are kept for files with the same headings. Without a
    column of the pressure, --program says what it was.

    The options from --aperture-mm to --placement hold for all files, or are given once a file, in
    the files' order. --measured says on which day they were measured, which no file is asked for:
    without it the session has no day, and no place in time.

    \b
    Example: skinlab import a.txt b.txt --aperture-mm 6 --thickness-mm 1 --cycle 1 --cycle 2 \\
             --program ramp:100@20 --measured 2026-03-01 --out visit.h5
    """
    from skinlab.curves.curve import Setup, named_placement
    from skinlab.curves.program import Program, parse_program
    from skinlab.errors import InputError
    from skinlab.exchange.importing.questions import Answers, Question
    from skinlab.exchange.importing.reader import Imported, import_file
    from skinlab.exchange.importing.remembered import Remembered, default_path
    from skinlab.exchange.importing.session import Who, check_new, imported_session, write_session

    programs: list[Program | None] = [parse_program(text) for text in program]
    sds: tuple[float | None, ...] = thickness_sd_mm
    placements = [named_placement(name) for name in placement]
    setups = [
        Setup(*values)
        for values in zip(
            _each("aperture-mm", aperture_mm, files, 0.0),
            _each("thickness-mm", thickness_mm, files, 0.0),
            _each("program", programs, files, None),
            _each("cycle", cycle, files, 1),
            _each("repeat", repeat, files, 1),
            _each("thickness-sd-mm", sds, files, None),
            _each("placement", placements, files, None),
            strict=True,
        )
    ]
    who = Who(subject, site)
    check_new(out)
    reading = files[0]

    def ask(question: Question) -> str:
        echo(f"{reading}: {question.text}.", err=True)
        choices = click.Choice(question.choices)
        asked = f"Which is it (or, the next time, --{question.option})?"
        answer: str = click.prompt(asked, type=choices, prompt_suffix=" ", err=True)
        return answer

    answers = Answers(
        stated(options, program=bool(program)),
        ask if sys.stdin.isatty() and sys.stderr.isatty() else None,
        Remembered(default_path(), ask_again=ask_again),
    )
    good: list[Imported] = []
    seen: dict[str, Path] = {}  # by the hash of their bytes
    entries: list[dict[str, Any]] = []
    for path, setup in zip(files, setups, strict=True):
        reading = path
        entry: dict[str, Any] = {"file": str(path), "error": None, "points": 0, "understood": []}
        entries.append(entry)
        try:
            imported = import_file(path, setup, answers)
            if (before := seen.setdefault(imported.sha256, path)) is not path:
                same = "twice" if before == path else f"also as {before}"
                raise InputError(
                    f"{path}: the same readings are given {same}; expected each curve once"
                )
        except InputError as error:
            entry["error"] = str(error)
            echo(f"skinlab: {error}", err=True)
            continue
        good.append(imported)
        entry.update(points=len(imported.curve), understood=list(imported.understood))
        echo(f"{path}: {'; '.join(imported.understood)}", err=True)
    if good:
        made = imported_session(good, [None] * len(good), None, who, measured)
        write_session(out, made)
    if as_json:
        session = str(out) if good else None
        print_json({"schema": "skinlab.import/1", "session": session, "files": entries})
    elif good:
        echo(f"session: {out}")
    return 0 if len(good) == len(files) else 3


def _each(option: str, values: Sequence[T], files: Sequence[Path], default: T) -> list[T]:
    """Return one value a file."""
    if len(values) not in {0, 1, len(files)}:
        raise click.UsageError(
            f"--{option} is given {len(values)} times for {len(files)} files; "
            "expected once, or once a file"
        )
    return list(values) if len(values) > 1 else list(values or [default]) * len(files)
