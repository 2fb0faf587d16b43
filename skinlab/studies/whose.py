"""Whose skin two sessions are of: asked before one is held against the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skinlab.curves.stated_skin import StatedSkin, differ, two_people
from skinlab.errors import InputError
from skinlab.io.files import file_hash
from skinlab.recording.session import Session, earlier, measured_utc, stated_skin

__all__ = ["Whose", "check_whose", "differ", "whose"]


@dataclass(frozen=True)
class Whose(StatedSkin):
    """What a session states of its skin, and which of its files it is."""

    simulated: bool = False
    file_hash: str = ""  # of its bytes: a session may be there under two names
    measured_utc: str = ""


def whose(path: Path, session: Session) -> Whose:
    """Return what a session that was read states of its skin."""
    meta = session.meta
    instrument = meta.get("instrument")
    hello = instrument if isinstance(instrument, dict) else {}
    stated = stated_skin(path.name, meta)
    return Whose(
        stated.file,
        stated.subject,
        stated.site,
        bool(hello.get("simulated")),
        file_hash(path),
        measured_utc(meta),
    )


def check_whose(
    before: Whose,
    after: Whose,
    control: tuple[Whose, Whose] | None = None,
    *,
    between_people: bool = False,
) -> tuple[str, ...]:
    """Return what a reader of the comparison has to know of whose skin it is, in sentences.

    With `between_people` two people are held against each other on purpose.

    Raises:
        InputError: the sessions are of two people, which nobody asked for; the control is of
            another person, or one of the sessions that it is to be a control of.
    """
    if between_people and control is not None:
        raise InputError("a control is of one person; expected none between two people")
    notes = []
    if people := two_people(before, after):
        if not between_people:
            raise InputError(
                f"{people}; expected two sessions of one person (`skinlab compare "
                "--between-people` takes two people)"
            )
        notes.append(
            f"The difference is between two people ({before.subject} and {after.subject}), not a "
            "change of one skin."
        )
    elif between_people and before.subject and after.subject:
        raise InputError(
            f"{before.file} and {after.file} are both of {after.subject}; expected two people"
        )
    every = (before, after, *(control or ()))
    for one in control or ():
        _check_control(one, before, after, every)
    if _same(before, after):
        notes.append(f"{before.file} and {after.file} are one session: nothing changed between.")
    unknown = [one.file for one in every if not one.subject]
    if unknown:
        notes.append(f"Nobody stated whose skin was measured: {', '.join(unknown)}.")
    notes += _of_sites(before, after)
    if control is not None:
        notes += _of_control(before, after, control)
    if len({one.simulated for one in every}) > 1:
        simulated = ", ".join(one.file for one in every if one.simulated)
        notes.append(f"Of a simulated skin, unlike the others: {simulated}.")
    for first, last in ((before, after), *([control] if control else [])):
        if last.measured_utc and earlier(last.measured_utc, first.measured_utc):
            notes.append(f"{first.file} was measured after {last.file}: signs are the other way.")
    return tuple(notes)


def _same(one: Whose, other: Whose) -> bool:
    """Return whether both are the same file, if under two names."""
    return bool(one.file_hash) and one.file_hash == other.file_hash


def _check_control(control: Whose, before: Whose, after: Whose, every: Sequence[Whose]) -> None:
    for one in (before, after):
        if _same(control, one):
            raise InputError(
                f"control {control.file} is the same session as {one.file}; expected one of a site "
                "that was left alone"
            )
    for one in every:
        if people := two_people(control, one):
            raise InputError(f"control {people}; expected a control site of the same person")


def _of_sites(before: Whose, after: Whose) -> list[str]:
    if differ(before.site, after.site):
        return [
            f"The sites differ ({before.site} and {after.site}): a difference of places is in it."
        ]
    if bool(before.site) != bool(after.site):
        return [f"Nobody stated the site of {(after if before.site else before).file}."]
    return []


def _of_control(before: Whose, after: Whose, control: tuple[Whose, Whose]) -> list[str]:
    notes = []
    first, last = control
    if _same(first, last):
        notes.append(f"The control is one session ({first.file}), which takes nothing away.")
    if differ(first.site, last.site):
        notes.append(
            f"The sites of the control differ ({first.site} and {last.site}): a difference of "
            "places is taken away."
        )
    for one, other in zip(control, (before, after), strict=True):
        days = one.measured_utc[:10], other.measured_utc[:10]
        if all(days) and days[0] != days[1]:
            notes.append(
                f"{one.file} was measured on {days[0]}, {other.file} on {days[1]}: what a day does "
                "is not taken away."
            )
    alike = {
        one.site
        for one, other in zip(control, (before, after), strict=True)
        if one.site and one.site.casefold() == other.site.casefold()
    }
    notes += [f"The control has the site that it is to be a control of: {s}." for s in alike]
    return notes
