"""`skinlab export`: a session as tidy files."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--to", "kind", type=click.Choice(["csv", "json"]), required=True, help="Format.")
def command(session: Path, folder: Path, kind: str) -> int:
    """Write SESSION into DIR: csv (curves, results, a campaign of them) or json (one file).

    \b
    Example: skinlab export visit.h5 --to csv visit
    """
    from skinlab.export import export
    from skinlab.session import read_session

    for path in export(read_session(session), kind, folder):
        click.echo(str(path))
    return 0
