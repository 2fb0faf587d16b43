"""`skinlab compare`: two sessions, and whether the skin changed."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.options import (
    control_option,
    database_option,
    json_option,
    placement_scatter_option,
    study_option,
)
from skinlab.cli.output import echo, echo_text, print_json
from skinlab.cli.paths import PATH


@click.command()
@click.argument("before", type=PATH)
@click.argument("after", type=PATH)
@database_option("the one that BEFORE names")
@study_option()
@control_option()
@placement_scatter_option(default="auto")
@click.option(
    "--relevant-percent",
    type=float,
    help="Smallest change that matters; where it could not have been shown, the answer stays open  "
    "[default: 30].",
)
@click.option(
    "--between-people",
    is_flag=True,
    help="Hold two people against each other, who are refused otherwise.",
)
@json_option()
def command(
    before: Path,
    after: Path,
    database_path: Path | None,
    study: Path | None,
    control: tuple[Path, Path] | None,
    placement_scatter: float | str | None,
    relevant_percent: float | None,
    between_people: bool,
    as_json: bool,
) -> int:
    """Say whether the skin of session AFTER differs from that of BEFORE.

    All whole first-cycle curves of a session are fitted together, whatever their openings. The
    answer for each parameter is: changed, no change shown, or too uncertain to say. With it stands
    the smallest change that could have been shown, given the scatter of placing the probe anew, of
    days and of operators. Sessions of different people are refused, and different sites are named.

    \b
    Example: skinlab compare monday.h5 friday.h5 --study study
             skinlab compare m_left.h5 f_left.h5 --control m_right.h5 f_right.h5
    """
    from skinlab.acquisition.replay import identifier_of
    from skinlab.errors import InputError
    from skinlab.inference.batch import scatter_of, with_scatter
    from skinlab.inference.compare import compare, in_words
    from skinlab.recording.session import measured_utc
    from skinlab.recording.session_fit import fit_session
    from skinlab.studies import change
    from skinlab.studies.comparison import read_compared
    from skinlab.studies.settings import CHANGES

    if between_people and control is not None:
        raise click.UsageError("--between-people and --control exclude each other")
    relevant = CHANGES.relevant_percent if relevant_percent is None else relevant_percent
    if not 0 < relevant < 1e4:
        raise InputError(f"relevant_percent {relevant:g}: expected a positive number")
    paths = (before, after, *(control or ()))
    sessions, notes = read_compared(paths, between_people=between_people)
    identifier, warning = identifier_of(sessions[0], database_path)
    if warning:
        echo(f"skinlab: {warning}", err=True)
    # Curves of a session are fitted together: placements are among their errors.
    stated = scatter_of(placement_scatter, None)
    identifier = with_scatter(identifier, stated).by_their_own()
    results = [
        fit_session(identifier, path, session)
        for path, session in zip(paths, sessions, strict=True)
    ]
    found = compare(*results[:2])
    first, second, *beside = map(change.side_of, sessions, results)
    judged = change.changes(
        first,
        second,
        study=study,
        control=(beside[0], beside[1]) if control else None,
        placement_scatter=stated,
        relevant_percent=relevant,
    )
    days = [measured_utc(session.meta) for session in sessions]
    if as_json:
        more = {
            "files": [str(path) for path in paths],
            "measured_utc": [day or None for day in days],
            "notes": list(notes),
            "change": judged.to_json(),
        }
        print_json(found.to_json() | more)
        return 0
    for sentence in notes:
        echo_text(sentence)
    echo(f"Before: {_dated(before, days[0])}. After: {_dated(after, days[1])}.")
    for line in change.in_words(judged):
        echo(line)
    echo(f"If nothing but {found.counted} differed between the sessions:")
    if found.p_value is not None:
        echo(f"  one skin explains both with a probability of {found.p_value:.1g}.")
    for line in in_words(found):
        echo(f"  {line}")
    return 0


def _dated(path: Path, day: str) -> str:
    when = f"measured {day[:10]}" if day else "nobody stated when it was measured"
    return f"{path.name} ({when})"
