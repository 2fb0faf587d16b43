"""`skinlab recover`: what a crash left becomes a session."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("journal", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="[default: the journal's own name]")
def command(journal: Path, out: Path | None) -> int:
    """Turn the JOURNAL that a crash left into a session; the journal stays.

    \b
    Example: skinlab recover visit.h5.journal
    """
    from skinlab.recording.recorder import recover

    if out is None:
        out = journal.with_suffix("") if journal.suffix == ".journal" else Path(f"{journal}.h5")
    made = recover(journal, out)
    click.echo(f"{out}: {len(made.curves)} curves recovered; {journal} can be deleted")
    return 0
