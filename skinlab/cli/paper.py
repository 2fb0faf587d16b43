"""`skinlab paper`: the paper's tables and figures again."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from skinlab.cli.options import workers_option
from skinlab.cli.output import echo
from skinlab.cli.paths import PATH


@click.command()
@click.option(
    "--out",
    type=PATH,
    default=Path("skinlab-paper"),
    show_default=True,
    help="Folder for tables (CSV), pictures (PNG) and the page.",
)
@click.option(
    "--page",
    "page_path",
    type=PATH,
    help="Where the page goes instead  [default: paper.md in that folder]",
)
@click.option("--seed", default=0, show_default=True, help="Of everything random.")
@workers_option()
def command(out: Path, page_path: Path | None, seed: int, workers: int | None) -> int:
    """Reproduce the tables and figures of the paper, and a page that compares.

    Prints the paths of what it wrote. Files of an earlier run are replaced, any others never.

    \b
    Example: skinlab paper --out reproduction
    """
    from skinlab.errors import InputError
    from skinlab.report.pictures import check_pictures

    if seed < 0:
        raise InputError(f"seed {seed}: expected zero or more")
    check_pictures()
    from skinlab.reproduction.output import Target
    from skinlab.reproduction.reproduce import ORDER, reproduce
    from skinlab.reproduction.study import Study

    target = Target(out, page_path)
    target.check(ORDER)
    study = Study(seed=seed)
    hidden = not sys.stderr.isatty()
    with click.progressbar(
        length=10_000, label="the paper again", file=sys.stderr, hidden=hidden, show_pos=False
    ) as bar:
        done = 0.0

        def progress(share: float) -> None:
            nonlocal done
            before, done = done, done + 10_000 * share
            bar.update(round(done) - round(before))

        parts, times = reproduce(study, workers or os.cpu_count() or 1, progress)
    for path in target.write(study, parts, times):
        echo(str(path))
    return 0
