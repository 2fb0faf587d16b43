"""Has the skin changed since another session? Computed beside; slow to import."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.acquisition.messages import Compared
from skinlab.errors import InputError

if TYPE_CHECKING:
    from skinlab.curves.curve import Curve
    from skinlab.inference.identify import Identifier
    from skinlab.recording.session import Session
    from skinlab.studies.change import Changes, Side


def compare_with(
    before: Path,
    curves: Sequence[Curve],
    identifier: Identifier,
    serial_number: str,
    study: Path | None,
    visit: tuple[str, str] | None = None,
) -> Compared:
    """Return how curves differ from an earlier session; `visit` is their subject and site.

    Only what both measured alike is compared. What placing the probe anew scatters counts, and the
    smallest change that could have been shown is said; `study` is a folder of `skinlab study`.

    Raises:
        SkinlabError: it cannot be read, or there is nothing to compare.
    """
    from skinlab.recording.session import read_session
    from skinlab.studies import change
    from skinlab.studies.whose import Whose, check_whose, differ, whose

    session = read_session(before)
    earlier, present = whose(before, session), Whose("this session", *(visit or ()))
    two = differ(earlier.subject, present.subject)
    notes = check_whose(earlier, present, between_people=two)
    then, now = sides(before, session, curves, identifier, serial_number)
    return Compared(_lines(before, session, notes, change.changes(then, now, study=study)))


def sides(
    before: Path,
    session: Session,
    curves: Sequence[Curve],
    identifier: Identifier,
    serial_number: str,
) -> tuple[Side, Side]:
    """Return an earlier session and these curves, by what both measured alike.

    Raises:
        SkinlabError: they measured nothing alike, or one of them cannot be fitted.
    """
    from skinlab.curves.placement import placements_of
    from skinlab.recording.audit import operator
    from skinlab.recording.session_fit import comparable, excluded_of, fit_curves
    from skinlab.studies.change import Side, condition, side_of

    then = comparable(session.curves, excluded_of(session))
    shared = frozenset(map(condition, then)) & frozenset(map(condition, curves))
    if not shared:
        raise InputError(f"{before.name} was measured with another opening or program")
    alike = [curve for curve in then if condition(curve) in shared]
    answer = fit_curves(identifier.by_their_own(), before.name, alike)
    earlier = side_of(session, answer, shared)
    kept = [curve for curve in curves if condition(curve) in shared]
    now = Side(
        fit_curves(identifier, "this session", kept),
        len(set(placements_of(kept))),
        operator(),
        serial_number,
        shared,
    )
    return earlier, now


def _lines(before: Path, session: Session, notes: Sequence[str], found: Changes) -> tuple[str, ...]:
    from skinlab.studies import change

    meta = session.meta
    who = ", ".join(str(meta[k]) for k in ("subject", "site") if meta.get(k))
    title = f"Changed since {before.name} ({who or 'no subject'})?"
    return (title, *(f"  {line}" for line in (*notes, *change.in_words(found))))
