"""`skinlab compare`: two sessions, and whether the skin changed."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.options import database_option, json_option
from skinlab.cli.output import echo, print_json


@click.command()
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("after", type=click.Path(path_type=Path))
@database_option("the one that BEFORE names")
@json_option()
def command(before: Path, after: Path, database_path: Path | None, as_json: bool) -> int:
    """Say whether the skin of session AFTER differs from that of BEFORE.

    All whole first-cycle curves of a session are fitted together, whatever their openings.

    \b
    Example: skinlab compare monday.h5 friday.h5
    """
    from skinlab.acquisition.replay import identifier_of
    from skinlab.inference.compare import compare, in_words
    from skinlab.recording.session import read_session
    from skinlab.recording.session_fit import fit_session

    sessions = [read_session(path) for path in (before, after)]
    identifier, warning = identifier_of(sessions[0], database_path)
    if warning:
        echo(f"skinlab: {warning}", err=True)
    results = [
        fit_session(identifier, path, session)
        for path, session in zip((before, after), sessions, strict=True)
    ]
    found = compare(*results)
    if as_json:
        print_json(found.to_json() | {"files": [str(before), str(after)]})
        return 0
    for line in in_words(found):
        echo(line)
    return 0
