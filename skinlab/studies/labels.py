"""Labels that may be wrong: nobody sees them in a table of hundreds of curves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.numbers import number_in
from skinlab.studies.copies import of_others

_SPELLED = ("subject", "site", "operator", "probe")
_MOST = 5  # that one sentence names
_AGE, _SEX = "age_years", "sex"
_SEXES = ("f", "m")


def doubtful_labels(
    text: Mapping[str, NDArray[np.str_]], people: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Return in sentences which labels may be wrong.

    `text` has the columns of the tidy table, `people` what tables state of them by subject.
    """
    measured = {str(s) for s in np.unique(text["subject"])} - {""}
    found = [*of_others(text), *_spelled_alike(text)]
    if strangers := sorted(set(people) - measured):
        found.append(f"a table of people names {_some(strangers)}, of whom there is no curve")
    if people and (unknown := sorted(measured - set(people))):
        found.append(f"the tables of people do not name {_some(unknown)}")
    for subject in sorted(measured & set(people)):
        age = people[subject].get(_AGE)
        if age is not None and not _is_number(age):
            found.append(f"{subject}: {_AGE} is {age!r}, expected a number; it is not used")
    return [*found, *_other_sexes({s: people[s].get(_SEX) for s in measured & set(people)})]


def _other_sexes(sexes: Mapping[str, Any]) -> Iterator[str]:
    """Tell of each way to write a sex by which nobody is found, as "w" or "female"."""
    for other in sorted({str(sex) for sex in sexes.values() if sex} - set(_SEXES)):
        of = sorted(subject for subject, sex in sexes.items() if str(sex) == other)
        yield (
            f"{_SEX} is {other!r} of {_some(of)}; expected f or m: no range of women or of men "
            "counts them"
        )


def _spelled_alike(text: Mapping[str, NDArray[np.str_]]) -> Iterator[str]:
    for name in _SPELLED:
        spellings: dict[str, list[str]] = {}
        for label in np.unique(text[name]).tolist():
            spellings.setdefault("".join(label.casefold().split()), []).append(label)
        for several in spellings.values():
            if len(several) > 1:
                yield f"{name}: {_some(several)} are taken for different ones; write one alike"


def _some(names: list[str]) -> str:
    rest = len(names) - _MOST
    return ", ".join(names[:_MOST]) + (f" and {rest} more" if rest > 0 else "")


def _is_number(value: Any) -> bool:
    try:
        return math.isfinite(number_in(str(value)))
    except ValueError:
        return False
