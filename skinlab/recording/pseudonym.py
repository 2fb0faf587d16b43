"""Subjects go by pseudonym. What looks like a name or a birth date is refused before it is stored.

The rule: at most 24 ASCII letters and digits in parts joined by `-` or `_`, and at least one digit.
Letters stand alone or in twos (`P7`, `AB-12`), in threes as capitals (`VOL12`), or are a word
for a role (`subject-12`). No digits that can be read as a date, no number of more than eight.
"""

from __future__ import annotations

import re
from datetime import date

from skinlab.errors import InputError

LONGEST = 24
_ROLES = frozenset({
    "anon", "case", "code", "control", "ctrl", "dummy", "group", "part", "participant", "pat",
    "patient", "person", "phantom", "pilot", "prob", "proband", "ref", "sample", "sim", "site",
    "skin", "study", "sub", "subj", "subject", "test", "visit", "vol", "volunteer",
})  # fmt: skip
_MONTH = re.compile(
    r"\d[-_. ]*(jan|feb|mar|apr|may|mai|jun|jul|aug|sep|o[ck]t|nov|de[cz])[a-z]*[-_. ]*\d", re.I
)
_FORM = re.compile(r"[A-Za-z0-9]+(?:[-_][A-Za-z0-9]+)*")
_LONGEST_NUMBER = 8  # longer ones are of insurances and registers
_YEARS = (1900, 2050)


def check_subject(subject: str) -> str:
    """Return the pseudonym; an empty one means that none is given.

    Raises:
        InputError: it looks like a name or a birth date, or is no code.
    """
    if not subject:
        return subject
    if _dates(subject):
        raise InputError(
            f"subject {subject!r}: looks like a date, perhaps of birth; expected a pseudonym "
            "such as P-017"
        )
    if len(subject) > LONGEST or not _FORM.fullmatch(subject) or not re.search(r"\d", subject):
        raise InputError(
            f"subject {subject!r}: expected a pseudonym such as P-017, never a name: at most "
            f"{LONGEST} letters and digits, at least one digit, parts joined by - or _"
        )
    for word in re.findall(r"[A-Za-z]+", subject):
        short = len(word) <= 2 or (len(word) == 3 and word.isupper())
        if not short and word.lower() not in _ROLES:
            raise InputError(
                f"subject {subject!r}: {word!r} looks like a name; expected a pseudonym such as "
                "P-017, VOL17 or subject-17"
            )
    for number in re.findall(r"\d+", subject):
        if len(number) > _LONGEST_NUMBER:
            raise InputError(
                f"subject {subject!r}: a number of {len(number)} digits looks like one of a "
                "register; expected a pseudonym such as P-017"
            )
    return subject


def _dates(text: str) -> bool:
    """Return whether a run of digits, or three in a row, can be read as a date."""
    if _MONTH.search(text):
        return True
    numbers = re.findall(r"\d+", text)
    for n in numbers:
        short = len(n) == 6 or len(n) > 8  # longer ones of registers often begin with the date
        if short and _is_date(n[0:2], n[2:4], n[4:6]):
            return True
        if len(n) >= 8 and (_is_date(n[0:4], n[4:6], n[6:8]) or _is_date(n[0:2], n[2:4], n[4:8])):
            return True
    threes = re.findall(r"(?=(?<!\d)(\d{1,4})[-_./ ]+(\d{1,2})[-_./ ]+(\d{1,4})(?!\d))", text)
    return any(_is_date(*three) for three in threes)


def _is_date(a: str, b: str, c: str) -> bool:
    """Return whether these are day, month and year in one of the three usual orders."""
    return any(
        len(day) <= 2 and len(month) <= 2 and len(year) in (2, 4) and _exists(year, month, day)
        for year, month, day in ((a, b, c), (c, b, a), (c, a, b))
    )


def _exists(year: str, month: str, day: str) -> bool:
    full = int(year) if len(year) == 4 else 2000 + int(year)
    if not _YEARS[0] <= full <= _YEARS[1] and len(year) == 4:
        return False
    try:
        date(full, int(month), int(day))
    except ValueError:
        return False
    return True
