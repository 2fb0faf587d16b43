"""Who was measured is never written down: not as the subject, and not in sites and notes.

Subjects go by pseudonym. The rule: at most 24 ASCII letters and digits in parts joined by `-` or
`_`, and at least one digit. Letters stand alone or in twos (`P7`, `AB-12`), in threes as capitals
(`VOL12`), or are a word for a role (`subject-12`). No date, no number of more than eight digits.

Sites and notes are sentences, so that only what looks like a person is refused: a title or a given
name with what follows it, two capitalised words that are of no body (`Anna Schmidt`, not `Left
Forearm`), an address, a date, a number of a register.

Six digits in a row are a number: one in twelve could be read as a date.
"""

from __future__ import annotations

import re
from datetime import date
from itertools import pairwise

from skinlab.errors import InputError

LONGEST = 24
_ROLES = frozenset({
    "anon", "case", "code", "control", "ctrl", "dummy", "group", "part", "participant", "pat",
    "patient", "person", "phantom", "pilot", "prob", "proband", "ref", "sample", "sim", "site",
    "skin", "study", "sub", "subj", "subject", "test", "visit", "vol", "volunteer",
})  # fmt: skip
_MONTHS = (
    r"(?:jan(?:uary?)?|feb(?:ruary?)?|m[aä]r(?:ch|z)?|apr(?:il)?|ma[yi]|june?|juni|july?|juli|"
    r"aug(?:ust)?|sept?(?:ember)?|o[ck]t(?:ober)?|nov(?:ember)?|de[cz](?:ember)?)(?![^\W\d_])"
)
_MONTH = re.compile(
    rf"\d(?:st|nd|rd|th)?[-_., ]*{_MONTHS}[-_., ]*\d|\b{_MONTHS}[-_. ]*\d{{1,2}}\D{{1,4}}\d{{4}}",
    re.I,
)
_BORN = re.compile(r"\b(?:born|birth|birthday|dob|geb|geboren|née)\b\W{0,3}\d{2,}", re.I)
_MAIL = re.compile(r"\S+@\S+\.\w+")
_TITLE = re.compile(
    r"\b(mr|mrs|ms|miss|dr|prof|herrn?|frau|fr|hr|mme|mlle|monsieur|madame|sr|sra|señora?|sig)"
    r"\b\.?\s+([^\W\d_]+)", re.I
)  # fmt: skip
_WORD = re.compile(r"[^\W\d_]+(?:['’-][^\W\d_]+)*")
# The commonest given names that are no other words, as they stand in visits' notes.
_GIVEN_WORDS = """
    adam ahmed alexander alexandra alice amelia ana andrea andreas andrew angela anja anna anne
    anthony antonio ayşe barbara benjamin bernd birgit brigitte carlos carmen caroline catherine
    charlotte christian christina christine christopher clara claudia claus daniel david deborah
    dennis dieter dimitri dorothy edward elena elisabeth elizabeth elke emily emma eric erika
    eva fatma felix florian francesca francesco francisco françois frank franz fritz gabriele
    george georg gerhard giovanni giulia giuseppe günter hannah hans heike heinz helga helmut
    henry horst ibrahim ines ingrid isabel isabella ivan jacob jakob james jan jane janet jean
    jennifer jens jessica joachim johann johannes john jonas jörg josé josef joseph joshua juan
    julia jürgen karen karin karl katharina katherine kathrin kevin klaus laura lena leon linda
    lisa louise luca lucas luis lukas manfred manuel marco margaret margarete maria marie mario
    markus martha martin martina mary matteo matthew matthias maximilian mehmet melanie michael
    michaela michel miguel mohamed mohammed monika mustafa nancy natalia nicholas nicole nina
    olga oliver olivia pablo patricia patrick paul paula pedro peter petra philipp pierre rainer
    ralf rebecca renate richard robert roberto rolf ruth sabine samuel sandra sarah sebastian
    silvia simon simone sofia sophia sophie stefan stefanie stephanie stephen steven susan
    susanne svetlana tanja teresa theresa thomas timothy tobias ulrich ulrike ursula uwe vanessa
    victoria vladimir walter werner wilhelm william wolfgang xavier yusuf yvonne zoe
"""
# Words that are capitalised beside another one, and are of bodies, probes and sentences.
_PLAIN_WORDS = """
    abdomen above achilles after ankle anterior aperture arm arms arterial back bauch before
    bein below bicep biceps breast brust buttock calf center centre cheek chest chin clinic
    closed clinical contact curve cycle day device distal dorsal dorsum ear elbow extensor face
    femoral finger first flexor foot forearm forehead front gel hand head heel hip inner inside
    instrument knee lateral left leg lesion linke linker linkes links lip loading lower lumbar
    medial mid middle month navel near neck no nose note oberarm oberschenkel old open opening
    outer outside palm patient placebo posterior press pressure probe probe's program proximal
    rechte rechter rechtes rechts repeat repositioned right ring rücken same scalp scapula scar
    second session shin shoulder side simulated site skin sole spot stirn sternum subject
    suction tape temple test the thigh third thorax thumb tibia tip toe torso treated treatment
    trunk untreated unterarm unterschenkel upper ventral visit volar wade wange week wrist zone
    avant bras droit droite gauche joue cuisse brazo antebrazo izquierdo derecho braccio
    avambraccio sinistro destro skinlab simulator dermalab cutometer
"""
_FORM = re.compile(r"[A-Za-z0-9]+(?:[-_][A-Za-z0-9]+)*")
_LONGEST_NUMBER = 8  # longer ones are of insurances and registers
_YEARS = (1900, 2050)

_GIVEN, _PLAIN = frozenset(_GIVEN_WORDS.split()), frozenset(_PLAIN_WORDS.split())


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


def check_site(site: str) -> str:
    """Return the site; an empty one means that none is given.

    Raises:
        InputError: it looks as if it held a person's name, address or birth date.
    """
    return _check_words("site", site, "expected where it was measured, such as left volar forearm")


def check_note(note: str) -> str:
    """Return the note.

    Raises:
        InputError: it looks as if it held a person's name, address or birth date.
    """
    return _check_words("note", note, "expected what was seen or done, and nobody's name or date")


def _check_words(field: str, text: str, expected: str) -> str:
    if _dates(text):
        raise InputError(f"{field} {text!r}: holds what looks like a date; {expected}")
    if _MAIL.search(text):
        raise InputError(f"{field} {text!r}: holds an address; {expected}")
    name = _name(text)
    if name is not None:
        raise InputError(f"{field} {text!r}: {name!r} looks like a name; {expected}")
    for number in re.findall(r"\d+", text):
        if len(number) > _LONGEST_NUMBER:
            raise InputError(
                f"{field} {text!r}: a number of {len(number)} digits looks like one of a register; "
                f"{expected}"
            )
    return text


def _name(text: str) -> str | None:
    """Return what looks like a person's name in a sentence."""
    titled = next((m for m in _TITLE.finditer(text) if m[2][0].isupper()), None)
    if titled is not None:
        return titled[0]
    words = list(_WORD.finditer(text))
    for word in words:
        if word[0].lower() in _GIVEN and not word[0].islower():
            return word[0]
    for one, two in pairwise(words):
        between = text[one.end() : two.start()]
        if between.strip(" .,") == "" and _capital(one[0]) and _capital(two[0]):
            return text[one.start() : two.end()]
    return None


def _capital(word: str) -> bool:
    """Return whether a word is capitalised, not in capitals, and not a plain one."""
    return len(word) > 1 and word[0].isupper() and not word.isupper() and word.lower() not in _PLAIN


def _dates(text: str) -> bool:
    """Return whether a run of digits, or three with the same sign between, can be read as a date.

    A run of six is none: see above.
    """
    if _MONTH.search(text) or _BORN.search(text):
        return True
    for n in re.findall(r"\d+", text):
        if len(n) > 8 and _is_date(n[0:2], n[2:4], n[4:6]):
            return True  # those of registers often begin with the date
        if len(n) >= 8 and (_is_date(n[0:4], n[4:6], n[6:8]) or _is_date(n[0:2], n[2:4], n[4:8])):
            return True
    threes = re.findall(r"(?=(?<!\d)(\d{1,4})( ?[-_./] ?)(\d{1,2})\2(\d{1,4})(?!\d))", text)
    return any(_is_date(a, b, c) for a, _, b, c in threes)


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
