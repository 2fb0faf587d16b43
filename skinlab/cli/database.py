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
    "--out",
    type=click.Path(path_type=Path),
    default=Path("paper_grid.h5"),
    show_default=True,
    help="The file to write.",
)
@click.option("--workers", type=int, help="Processes [default: one a core].")
def build(out: Path, workers: int | None) -> int:
    """Compute the paper's grid: X1 10 × X2 17 × nu 8, 0 to 100 mbar by 2.

    \b
    Example: skinlab database build --out my_grid.h5
    """
    from skinlab.database.build import build_grid
    from skinlab.database.grid import GridSpec
    from skinlab.database.store import write_grid
    from skinlab.errors import InputError

    if workers is not None and not 1 <= workers <= 1024:
        raise InputError(f"workers {workers}: expected 1–1024")
    if not out.parent.is_dir():
        raise InputError(f"{out}: its folder does not exist")
    spec = GridSpec()
    hidden = not sys.stderr.isatty()
    with click.progressbar(
        length=spec.entries, label="curves", file=sys.stderr, hidden=hidden
    ) as bar:
        database = build_grid(spec, workers or os.cpu_count() or 1, lambda *_: bar.update(1))
    write_grid(out, database)
    click.echo(f"{out}: {spec.entries} curves, {database.content_hash}")
    return 0


@command.command()
@click.argument("database", type=click.Path(path_type=Path), required=False)
def info(database: Path | None) -> int:
    """Describe DATABASE (default: the one that ships with the package).

    \b
    Example: skinlab database info
    """
    from skinlab.database.store import read_grid, shipped_grid

    grid = read_grid(database) if database else shipped_grid()
    spec = grid.spec
    click.echo(
        f"law {spec.law}, kappa {spec.kappa}, mesh {grid.mesh_name} ({grid.dofs} degrees of "
        f"freedom), solver version {grid.solver_version}"
    )
    click.echo(f"opening {spec.geometry.aperture_mm:g} mm, skin {spec.geometry.thickness_mm:g} mm")
    for name in ("X1_MPa", "X2_MPa", "nu", "pressure_mbar"):
        axis = getattr(spec, name)
        click.echo(f"  {name:<14}{axis[0]:g} to {axis[-1]:g}, {len(axis)} nodes")
    top = max(spec.pressure_mbar)
    short = int((grid.holds_to_mbar < top).sum())
    click.echo(f"{spec.entries} curves, {short} of them hold to less than {top:g} mbar")
    click.echo(grid.content_hash)
    return 0


@command.command()
@click.argument("database", type=click.Path(path_type=Path), required=False)
@click.option("--samples", default=5, show_default=True, help="Entries to compute again.")
@click.option("--seed", default=0, show_default=True, help="Which entries.")
def verify(database: Path | None, samples: int, seed: int) -> int:
    """Check the hash of DATABASE and compute a few of its entries again.

    \b
    Example: skinlab database verify --samples 10
    """
    from skinlab.database.store import read_grid, shipped_grid
    from skinlab.database.verify import rebuilt_differences

    grid = read_grid(database) if database else shipped_grid()
    found = rebuilt_differences(grid, samples, seed)
    for sentence in found:
        click.echo(f"skinlab: {sentence}", err=True)
    if not found:
        click.echo(f"hash and {samples} entries computed again agree")
    return 1 if found else 0
