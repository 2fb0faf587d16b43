"""`skinlab study`: a folder of curves becomes a table, and what the table says."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Self

import click

from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    database_option,
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
    workers_option,
)
from skinlab.cli.output import echo, echo_text, print_json
from skinlab.cli.paths import PATH


@click.command(cls=MethodCommand)
@click.argument("folders", nargs=-1, required=True, type=PATH)
@click.option("--out", required=True, type=PATH, help="The study's folder.")
@click.option("--explain", is_flag=True, help="Look for missing effects over all campaigns.")
@click.option(
    "--mdc-percent", type=float, help="Say how many repeats show a change of this many per cent."
)
@click.option("--resume", is_flag=True, help="Go on, and refuse to if the settings differ.")
@workers_option()
@click.option("--dask", metavar="ADDRESS", help="Compute on the cluster of this dask scheduler.")
@click.option(
    "--layout", help="What paths inside FOLDERS say: '{subject}/{site}/v{visit}_p{placement}'."
)
@geometry_options(required=False)
@click.option("--program", help="What the pump did, where nothing else says it.")
@identification_options()
@database_option()
@json_option()
def command(
    folders: tuple[Path, ...],
    out: Path,
    explain: bool,
    mdc_percent: float | None,
    resume: bool,
    workers: int | None,
    dask: str | None,
    layout: str | None,
    aperture_mm: float | None,
    thickness_mm: float | None,
    thickness_sd_mm: float | None,
    program: str | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Make one tidy table of all curves in FOLDERS, and say how far it can be relied on.

    Sessions, campaigns, curve CSVs and files that other software exported, at any depth. Whose
    curves they are comes from sessions, from a table with a column `file`, from --layout, or from
    parts of the path such as subject=P-017 (docs/study.md). What cannot be read is listed with its
    reason, and the rest goes on. Run again, only what is new or changed is computed.

    \b
    Example: skinlab study visits --out study --workers 2
             skinlab study exports --layout '{subject}/{site}/v{visit}' --aperture-mm 6 \\
                 --thickness-mm 1.2 --program ramp:100@20 --out study
    """
    from skinlab.errors import InputError
    from skinlab.io.files import real_path
    from skinlab.studies.make_study import make_study
    from skinlab.studies.run import How
    from skinlab.studies.sources import Plan

    if dask is not None and workers is not None:
        raise click.UsageError("--dask and --workers exclude each other")
    if mdc_percent is not None and not mdc_percent > 0:
        raise InputError(f"--mdc-percent {mdc_percent:g}: expected more than 0")
    stated = {
        "aperture_mm": aperture_mm,
        "thickness_mm": thickness_mm,
        "thickness_sd_mm": thickness_sd_mm,
        "program": program,
    }
    plan = Plan(folders, {k: v for k, v in stated.items() if v is not None}, layout, real_path(out))
    identifier = make_identifier(**options)
    with _Bars() as bars:
        how = How(workers or os.cpu_count() or 1, dask, bars.of("files"), bars.of("campaigns"))
        try:
            made = make_study(
                plan,
                out,
                identifier,
                how,
                resume=resume,
                explain=explain,
                mdc_percent=mdc_percent,
                now=datetime.now(UTC),
            )
        except KeyboardInterrupt:
            echo(f"skinlab: what is done is kept in {out}; the same command goes on", err=True)
            raise
    for sentence in made.notices:
        echo(f"skinlab: {sentence}", err=True)
    if as_json:
        print_json(made.document)
    else:
        echo_text("\n".join(made.lines))
    return 3 if made.failures else 0


class _Bars:
    """Progress bars, one after the other, with rate and time left; nothing in a pipe."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._started, self._first = 0.0, 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def of(self, label: str) -> Callable[[int, int], None]:
        """Return what shows (done, total) of these."""
        return partial(self._show, label)

    def _show(self, label: str, done: int, total: int) -> None:
        if not sys.stderr.isatty():
            return
        if self._bar is None or self._bar.label != label:
            self._end()
            self._started, self._first = time.monotonic(), done
            self._bar = click.progressbar(
                length=total,
                label=label,
                file=sys.stderr,
                show_pos=True,
                item_show_func=lambda rate: rate,
            )
            self._bar.__enter__()
        seconds = time.monotonic() - self._started
        rate = f"{(done - self._first) / seconds:.2g} a second" if seconds > 1 else None
        self._bar.update(done - self._bar.pos, rate)

    def _end(self) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
            self._bar = None
