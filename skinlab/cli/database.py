"""`skinlab database`: build, describe and verify the precomputed database."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click


@click.group()
def command() -> None:
    """The precomputed finite-element database."""


@command.command()
@click.option(
    "--spec",
    type=click.Choice(["paper", "dimensionless"]),
    default="paper",
    show_default=True,
    help="The paper's grid, or the table that serves every aperture, thickness and pressure.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), help="The file to write [default: SPEC.h5]."
)
@click.option("--workers", type=int, help="Processes [default: one a core].")
def build(spec: str, out: Path | None, workers: int | None) -> int:
    """Compute a database with the finite elements.

    paper: X1 10 × X2 17 × nu 8, 0 to 100 mbar by 2, 6 mm opening on 1 mm of skin.
    dimensionless: h/R 18 × X2/X1 26 × kappa/X1 18, exact along X1, to 500 mbar.

    \b
    Example: skinlab database build --spec dimensionless --out my_table.h5
    """
    from skinlab.database.build import build_grid, build_table
    from skinlab.database.dimensionless import DimensionlessSpec
    from skinlab.database.grid import GridSpec
    from skinlab.database.store import write_grid, write_table
    from skinlab.errors import InputError

    out = out or Path(f"{spec}.h5")
    if workers is not None and not 1 <= workers <= 1024:
        raise InputError(f"workers {workers}: expected 1–1024")
    if not out.parent.is_dir():
        raise InputError(f"{out}: its folder does not exist")
    grid_spec, table_spec = GridSpec(), DimensionlessSpec()
    entries = grid_spec.entries if spec == "paper" else table_spec.entries
    processes = workers or os.cpu_count() or 1
    hidden = not sys.stderr.isatty()
    with click.progressbar(length=entries, label="curves", file=sys.stderr, hidden=hidden) as bar:

        def progress(done: int, total: int) -> None:
            bar.update(1)

        if spec == "paper":
            grid = build_grid(grid_spec, processes, progress)
            content_hash = grid.content_hash
            write_grid(out, grid)
        else:
            table = build_table(table_spec, processes, progress)
            content_hash = table.content_hash
            write_table(out, table)
    click.echo(f"{out}: {entries} curves, {content_hash}")
    return 0


@command.command()
@click.argument("database", type=click.Path(path_type=Path), required=False)
def info(database: Path | None) -> int:
    """Describe DATABASE (default: those that ship with the package).

    \b
    Example: skinlab database info
    """
    from skinlab.database.describe import describe
    from skinlab.database.store import read_database, shipped_grid, shipped_table

    found = (read_database(database),) if database else (shipped_table(), shipped_grid())
    click.echo("\n\n".join(describe(each) for each in found))
    return 0


@command.command()
@click.argument("database", type=click.Path(path_type=Path), required=False)
@click.option("--samples", default=5, show_default=True, help="Entries to compute again.")
@click.option("--seed", default=0, show_default=True, help="Which entries.")
def verify(database: Path | None, samples: int, seed: int) -> int:
    """Check the hash of DATABASE and compute a few of its entries again.

    Without DATABASE: of both that ship with the package.

    \b
    Example: skinlab database verify --samples 10
    """
    from skinlab.database.store import read_database, shipped_grid, shipped_table
    from skinlab.database.verify import rebuilt_differences

    checked = (read_database(database),) if database else (shipped_table(), shipped_grid())
    differ = False
    for each in checked:
        found = rebuilt_differences(each, samples, seed)
        differ = differ or bool(found)
        for sentence in found:
            click.echo(f"skinlab: {sentence}", err=True)
        if not found:
            click.echo(f"{each.content_hash[:19]}…: {samples} entries computed again agree")
    return 1 if differ else 0
