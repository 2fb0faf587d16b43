"""`skinlab database`: build, describe and verify the precomputed database."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinlab.cli.groups import SuggestingGroup
from skinlab.cli.options import workers_option
from skinlab.cli.output import echo, echo_text
from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from skinlab.tables.table import Spec


@click.group(cls=SuggestingGroup)
def command() -> None:
    """Build, describe or check the precomputed finite-element database.

    \b
    Example: skinlab database info
             skinlab database verify --samples 10
    """


@command.command()
@click.option(
    "--spec",
    default="paper",
    show_default=True,
    help="A SPEC.toml or MODEL.toml, or the name of what ships: paper, dimensionless.",
)
@click.option("--out", type=PATH, help="The file to write [default: SPEC.h5].")
@workers_option()
@click.option("--dask", metavar="ADDRESS", help="Compute on the cluster of this dask scheduler.")
@click.option("--resume", is_flag=True, help="Go on with a build that was interrupted or killed.")
@click.option("--force", is_flag=True, help="Let --out replace a file.")
def build(
    spec: str,
    out: Path | None,
    workers: int | None,
    dask: str | None,
    resume: bool,
    force: bool,
) -> int:
    """Compute a database with the finite elements.

    paper: the paper's grid, 10 × 17 × 8 curves, 0 to 100 mbar in steps of 2, 6 mm opening on
    1 mm of skin. dimensionless: 18 × 26 × 23 curves for every opening and thickness, to 500 mbar.
    SPEC.toml: a law with effects on axes of your own, or a dimensionless table of another law
    (docs/files.md); a MODEL.toml, as `discrepancy --adopt` writes it, is one with default axes.

    Curves are kept in OUT.rows until the build is done, so that --resume can go on.

    \b
    Example: skinlab database build --spec adopted.toml --out adopted.h5 --workers 2
    """
    from skinlab.errors import InputError
    from skinlab.io.files import real_path
    from skinlab.tables.build import build as build_table
    from skinlab.tables.parallel_build import How
    from skinlab.tables.store import write
    from skinlab.tables.table import NOT_MEASURED

    if dask is not None and workers is not None:
        raise click.UsageError("--dask and --workers exclude each other")
    out = out or Path(f"{Path(spec).stem}.h5")
    if not out.parent.is_dir():
        raise InputError(f"{out}: its folder does not exist")
    if (out.exists() and not out.is_file()) or real_path(out) == real_path(Path(spec)):
        raise InputError(f"{out}: expected the name of a file to write")
    if out.exists() and not force:
        raise InputError(f"{out}: exists already; --force replaces it")
    what = _spec(spec)
    entries = what.entries
    kept = out.with_name(f"{out.name}.rows")
    hidden = not sys.stderr.isatty()
    try:
        with click.progressbar(
            length=entries, label="curves", file=sys.stderr, hidden=hidden
        ) as bar:
            how = How(
                workers=workers or os.cpu_count() or 1,
                dask=dask,
                keep=kept,
                resume=resume,
                progress=lambda done, total: bar.update(done - bar.pos),
            )
            table = build_table(what, how)
            write(out, table)
    except KeyboardInterrupt:
        if kept.exists():
            echo(f"skinlab: what is done is kept in {kept}; --resume goes on", err=True)
        raise
    kept.unlink(missing_ok=True)
    echo(f"{out}: {entries} curves, {table.content_hash}")
    off = what.between(table)
    if off != "":
        echo(NOT_MEASURED if off is None else off)
    return 0


def _spec(said: str) -> Spec:
    """Return the spec of `--spec`, and tell what it is."""
    from skinlab.errors import InputError
    from skinlab.tables.dimensionless_spec import DimensionlessSpec
    from skinlab.tables.grid_spec import GridSpec
    from skinlab.tables.spec_file import read_spec
    from skinlab.text import did_you_mean

    shipped: dict[str, Callable[[], Spec]] = {"paper": GridSpec, "dimensionless": DimensionlessSpec}
    if said in shipped:
        return shipped[said]()
    if not Path(said).exists() and (near := did_you_mean(said, shipped)):
        raise InputError(f"{said}: no such file{near}")
    spec = read_spec(said)
    echo(f"skinlab: {spec.summary}", err=True)
    return spec


@command.command()
@click.argument("database", type=PATH, required=False)
def info(database: Path | None) -> int:
    """Describe DATABASE (default: those that ship with the package).

    \b
    Example: skinlab database info
    """
    from skinlab.tables.build import describe
    from skinlab.tables.store import read, shipped_grid, shipped_table

    found = (read(database),) if database else (shipped_table(), shipped_grid())
    echo_text("\n\n".join(describe(each) for each in found))
    return 0


@command.command()
@click.argument("database", type=PATH, required=False)
@click.option("--samples", default=5, show_default=True, help="Entries to compute again.")
@click.option("--seed", default=0, show_default=True, help="Which entries.")
def verify(database: Path | None, samples: int, seed: int) -> int:
    """Check the hash of DATABASE and compute a few of its entries again.

    Without DATABASE: of both that ship with the package. Status 1 where something differs.

    \b
    Example: skinlab database verify --samples 10
    """
    from skinlab.tables.build import rebuilt_differences
    from skinlab.tables.header import AlteredError
    from skinlab.tables.store import read, shipped_grid, shipped_table

    try:
        checked = (read(database),) if database else (shipped_table(), shipped_grid())
    except AlteredError as error:
        echo(f"skinlab: {error}", err=True)
        return 1
    differ = False
    for each in checked:
        found = rebuilt_differences(each, samples, seed)
        differ = differ or bool(found)
        for sentence in found:
            echo(f"skinlab: {sentence}", err=True)
        if not found:
            echo(f"{each.content_hash[:19]}…: {samples} entries computed again agree")
    return 1 if differ else 0
