"""The change since an earlier session: of what both measured alike, and as a part of a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.mechanics.names import heading
from skinlab.recording.session import Session, measured_utc, read_session
from skinlab.recording.session_fit import comparable, excluded_of, fit_curves
from skinlab.report.page import Section, Table
from skinlab.studies.change import WORDS, Changed, Changes, changes, condition, side_of
from skinlab.studies.whose import check_whose, whose


@dataclass(frozen=True)
class Since:
    """How the skin of a session differs from an earlier one.

    `conditions` are the openings (mm) and programs that all of them measured.
    """

    before: Path
    measured_utc: str  # the earlier one; "" where nobody said
    found: Changes
    conditions: frozenset[tuple[float, str]]
    control: tuple[Path, Path] | None = None
    notes: tuple[str, ...] = ()  # of whose skin it is


def since(
    identifier: Identifier,
    before: Path,
    after: Path,
    control: tuple[Path, Path] | None = None,
    study: Path | None = None,
    *,
    between_people: bool = False,
) -> Since:
    """Return how `after` differs from `before`; takes about a second for each session.

    `control` are two sessions of a site that was left alone, on the same days: their change is
    taken away. `study` is a folder of `skinlab study`: how much visits and operators scatter.
    `between_people`: of two people, on purpose.

    Raises:
        SkinlabError: one cannot be read or fitted, they have no opening and program in common, or
            they are of different people.
    """
    paths = (before, after, *(control or ()))
    sessions, notes = read_compared(paths, between_people=between_people)
    kept = [comparable(s.curves, excluded_of(s)) for s in sessions]
    shared = frozenset.intersection(*(frozenset(map(condition, curves)) for curves in kept))
    if not shared:
        raise InputError(
            f"{before.name} and {after.name}: measured differently; expected an opening and a "
            "program in common"
        )
    sides = []
    for path, session, curves in zip(paths, sessions, kept, strict=True):
        alike = [curve for curve in curves if condition(curve) in shared]
        answer = fit_curves(identifier.by_their_own(), path.name, alike)
        sides.append(side_of(session, answer, shared))
    beside = (sides[2], sides[3]) if control else None
    found = changes(sides[0], sides[1], study=study, control=beside)
    return Since(before, measured_utc(sessions[0].meta), found, shared, control, notes)


def read_compared(
    paths: Sequence[Path], *, between_people: bool = False
) -> tuple[list[Session], tuple[str, ...]]:
    """Return the sessions BEFORE, AFTER and perhaps those of a control, and of whose skin they are.

    Raises:
        SkinlabError: one cannot be read, or they are of different people.
    """
    sessions = [read_session(path) for path in paths]
    before, after, *control = map(whose, paths, sessions)
    beside = (control[0], control[1]) if control else None
    return sessions, check_whose(before, after, beside, between_people=between_people)


def section(compared: Since | str) -> Section:
    """Return what a report says of a comparison, or why there is none."""
    if isinstance(compared, str):
        return Section("Changed?", (f"Not compared: {compared}.",))
    found = compared.found
    alike = "; ".join(f"{a:g} mm, {p or 'no program'}" for a, p in sorted(compared.conditions))
    day = compared.measured_utc[:10] or "an unknown day"
    sentences = [
        *compared.notes,
        f"Compared with {compared.before.name} of {day}, by what both measured alike ({alike}).",
    ]
    if compared.control is not None:
        names = " and ".join(path.name for path in compared.control)
        sentences.append(f"The change of a site that was left alone ({names}) is taken away.")
    basis = found.basis.partition(" (--")[0]  # the rest is of the command line
    sentences.append(f"At {100 * found.level:g} %, by {basis}.")
    head = ("quantity", "answer", "change", "between", "smallest that could be shown")
    whole = () if found.stiffness is None else (found.stiffness,)
    rows = [_row(one) for one in (*whole, *found.parameters)]
    return Section("Changed?", (" ".join(sentences),), (Table(head, rows),))


def _row(one: Changed) -> Sequence[str]:
    said = one.to_json()
    unit, places = (" %", 0) if said["unit"] == "%" else ("", 2)
    change, low, high, smallest = (
        f"{said[key]:+.{places}f}".replace("-", "−")
        for key in ("change", "low", "high", "smallest_shown")
    )
    return (
        "stiffness as a whole" if one.name == "stiffness" else heading(one.name),
        WORDS[one.verdict],
        f"{change}{unit}",
        f"{low} to {high}{unit}",
        f"{smallest.lstrip('+')}{unit}",
    )
