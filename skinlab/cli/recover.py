"""`skinlab recover`: what a crash left becomes a session."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.output import echo
from skinlab.cli.paths import PATH

_MOST_SAID = 20  # sentences on what was skipped


@click.command()
@click.argument("journal", type=PATH)
@click.option(
    "--out",
    type=PATH,
    help="The session to write [default: JOURNAL without .journal].",
)
def command(journal: Path, out: Path | None) -> int:
    """Turn the JOURNAL that a crash left into a session; the journal stays.

    \b
    Example: skinlab recover visit.h5.journal
    """
    from skinlab.errors import InputError
    from skinlab.recording.journal import is_live
    from skinlab.recording.load_inputs import SESSIONS, check_session_name
    from skinlab.recording.recorder import recover
    from skinlab.text import counted

    if out is not None:
        check_session_name(out)
    else:
        out = journal.with_suffix("") if journal.suffix == ".journal" else journal
        out = out if out.suffix.lower() in SESSIONS else Path(f"{out}.h5")
    if is_live(journal):
        raise InputError(f"{journal}: a measurement is recording there now; it saves by itself")
    made, skipped = recover(journal, out)
    for sentence in skipped[:_MOST_SAID]:
        echo(f"skinlab: {journal}: {sentence}", err=True)
    if len(skipped) > _MOST_SAID:
        more = len(skipped) - _MOST_SAID
        echo(f"skinlab: {journal}: {more} more of this kind", err=True)
    then = f"keep {journal}: it is damaged" if skipped else f"{journal} can be deleted"
    echo(f"{out}: {counted(len(made.curves), 'curve')} recovered; {then}")
    return 0
