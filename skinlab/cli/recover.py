"""`skinlab recover`: what a crash left, or damage, becomes a session."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.output import echo
from skinlab.cli.paths import PATH

_MOST_SAID = 20  # sentences on what was skipped


@click.command()
@click.argument("file", type=PATH)
@click.option(
    "--out",
    type=PATH,
    help="The session to write [default: FILE without .journal; of a damaged session, "
    "NAME.recovered.h5].",
)
def command(file: Path, out: Path | None) -> int:
    """Turn FILE into a session: a crash's journal, or a damaged session.

    FILE stays. Of a damaged session curves and results are made again from the
    recorded bytes where those are whole; else they are taken as they stand
    beside them. What is lost is said, and kept in the audit trail.

    \b
    Example: skinlab recover visit.h5.journal
             skinlab recover damaged.h5
    """
    from skinlab.errors import InputError
    from skinlab.recording.journal import is_live
    from skinlab.recording.recorder import recover
    from skinlab.recording.salvage import is_session, salvage
    from skinlab.recording.session_names import check_session_name, is_session_name
    from skinlab.text import counted

    was_session = is_session(file)
    if out is not None:
        check_session_name(out)
    elif was_session:
        out = file.with_name(f"{file.stem}.recovered.h5")
    else:
        out = file.with_suffix("") if file.suffix == ".journal" else file
        out = out if is_session_name(out) else Path(f"{out}.h5")
    if is_live(file):
        raise InputError(f"{file}: a measurement is recording there now; it saves by itself")
    made, skipped = (salvage if was_session else recover)(file, out)
    for sentence in skipped[:_MOST_SAID]:
        echo(f"skinlab: {file}: {sentence}", err=True)
    if len(skipped) > _MOST_SAID:
        more = len(skipped) - _MOST_SAID
        echo(f"skinlab: {file}: {more} more of this kind", err=True)
    then = f"keep {file}: it is damaged" if skipped else f"{file} can be deleted"
    then = f"nothing is lost; {then}" if was_session and not skipped else then
    echo(f"{out}: {counted(len(made.curves), 'curve')} recovered; {then}")
    return 0
