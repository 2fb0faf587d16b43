"""Whether curves that are fitted together are of one skin, as far as it is stated."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

from skinlab.curves.curve import Curve
from skinlab.curves.stated_skin import StatedSkin, differ, two_people
from skinlab.errors import InputError


def check_one_skin(curves: Sequence[Curve]) -> tuple[str, ...]:
    """Return what a reader has to know of whose skin these curves together are of, in sentences.

    Raises:
        InputError: they are of two people, or of two sites, as their sessions state.
    """
    every = list(dict.fromkeys(c.skin or StatedSkin(c.campaign or c.name) for c in curves))
    for one, other in combinations(every, 2):
        if people := two_people(one, other):
            raise InputError(f"{people}; expected curves of one person, as one skin is fitted")
    for one, other in combinations(every, 2):
        if differ(one.site, other.site):
            raise InputError(
                f"the sites differ ({one.file} is of {one.site} and {other.file} of {other.site}); "
                "expected curves of one site, as one skin is fitted"
            )
    notes, unknown = [], _unstated(every, "subject")
    if unknown:
        notes.append(f"Nobody stated whose skin was measured: {', '.join(unknown)}.")
    nowhere = [file for file in _unstated(every, "site") if file not in unknown]
    if nowhere:
        notes.append(f"Nobody stated the site of {', '.join(nowhere)}.")
    return tuple(notes)


def _unstated(every: Sequence[StatedSkin], what: Literal["subject", "site"]) -> list[str]:
    """Return which files do not state what others do."""
    lacking = [one.file for one in every if not getattr(one, what)]
    return lacking if len(lacking) < len(every) else []
