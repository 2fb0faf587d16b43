"""Who was measured is never written down: not as the subject, and not in sites and notes.

Subjects go by pseudonym. The rule: at most 24 ASCII letters and digits in parts joined by `-` or
`_`, and at least one digit. Letters stand alone or in twos (`P7`, `AB-12`), in threes as capitals
(`VOL12`), or are a word for a role (`subject-12`). No date, no number of more than eight digits.

Sites and notes are sentences, so that only what looks like a person is refused: a title, a common
name, two words beside each other that are names as well (`grace lee`), an initial with a name, two
capitalised words that are of no body (`Anna Schmidt`, not `Left Forearm`), a Chinese, Japanese or
Korean name that begins with a common surname, an address, a date in words or numbers, a number of a
register or a telephone. A rare name by itself nobody can tell from a word. How often it errs is in
docs/safety.md.

Six digits in a row are a number: one in twelve could be read as a date.
"""

from __future__ import annotations

import re
from datetime import date
from functools import cache
from importlib.resources import files
from itertools import pairwise

from skinlab.errors import InputError

LONGEST = 24
LONGEST_TEXT = 2000  # of a site or a note; looking for names takes the square of it
_ROLES = frozenset({
    "anon", "case", "code", "control", "ctrl", "dummy", "group", "part", "participant", "pat",
    "patient", "person", "phantom", "pilot", "prob", "proband", "ref", "sample", "sim", "site",
    "skin", "study", "sub", "subj", "subject", "test", "visit", "vol", "volunteer",
})  # fmt: skip
# English, German, French, Spanish, Italian, Portuguese, Dutch, Russian
_MONTHS = (
    r"(?:jan(?:uary?|uar[iy]|vier|eiro)?|feb(?:ruary?|ruari|rero|braio)?|f[eé]v(?:rier|ereiro)?|"
    r"m[aä]r(?:ch|z|s|zo|ço)?|maart|a[pbv]r(?:ile?)?|mayo?|mai|maio|maggio|mei|june?|jun[ih]?o?|"
    r"juin|giugno|july?|jul[ih]?o?|juillet|luglio|aug(?:ust|ustus)?|ao[uû]t|agosto|"
    r"sept?(?:emb(?:er|re))?|septiembre|settembre|setembro|o[ckt]t(?:ob(?:er|re))?|octubre|"
    r"outubro|nov(?:emb(?:er|re)|iembre|embro)?|d[eéi]c(?:emb(?:er|re)|iembre)?|dez(?:ember|embro)?|"
    r"gennaio|enero|январ[яь]|феврал[яь]|марта?|апрел[яь]|ма[яй]|июн[яь]|июл[яь]|августа?|"
    r"сентябр[яь]|октябр[яь]|ноябр[яь]|декабр[яь])(?![^\W\d_])"
)
_OF = r"[-_., ]*(?:(?:of|de|di|den)\b ?)?"
_MONTH = re.compile(
    rf"\d(?:st|nd|rd|th|er)?{_OF}{_MONTHS}{_OF}\d|\b{_MONTHS}[-_. ]*\d{{1,2}}\D{{1,4}}\d{{4}}|"
    r"\d\s*[年년]\s*\d{1,2}\s*[月월]",
    re.I,
)
_BORN = re.compile(
    r"\b(?:born|birth|birthday|dob|geb|geboren|Geburtsdatum|n[ée]e?|nat[oa]|nacid[oa]|født|född)\b"
    r"\W{0,3}(?:(?:in|on|am|le|el|il|en|den)\b\W?)?\d{2,}|\bb\. ?(?:19|20)\d\d",
    re.I,
)
_SPACED = re.compile(r"(?<!\d)(\d\d) (\d\d) ((?:19|20)\d\d)(?!\d)")
# Three alone, day or year first: not of a longer row, and of no unit
_SHORT = re.compile(
    r"(?<![\d.,])(?<!\d )(\d\d) (\d\d) (\d\d)(?![\d.,])"
    r"(?! ?(?:\d|%|°|[muµ]?[mslg]\b|min\b|m?bar\b|k?Pa\b|[ck]m\b|Hz\b))"
)
_MAIL = re.compile(r"[^\s@]@[^\s@]+\.\w")
# Telephones, and numbers of registers in their usual groups
_REGISTER = re.compile(
    r"\+\d[\d ()/-]{7,}\d|(?<![\d.])0\d{2,4}[ /-]\d{5,}|(?<!\d)\d{3}([ -])\d{3}\1\d{4}(?!\d)|"
    r"(?<!\d)\d{3}-\d\d-\d{4}(?!\d)|(?<!\d)\d{3}\.\d{4}\.\d{4}\.\d\d"
)
_TITLE = re.compile(
    r"\b(mr|mrs|ms|miss|dr|prof|herrn?|frau|fr|hr|mme|mlle|monsieur|madame|sr|sra|señora?|"
    r"sig(?:\.ra|\.na|nora?)?)\b\.?\s+([^\W\d_]+)", re.I
)  # fmt: skip
# Titles that are nothing else, so that a name after them needs no capital
_TITLES = frozenset({
    "mr", "mrs", "herr", "herrn", "frau", "mme", "mlle", "monsieur", "señor", "señora",
})  # fmt: skip
_INITIAL = re.compile(r"\b([^\W\d_])\. ?([^\W\d_]{2,})|([^\W\d_]{2,}), ?([^\W\d_])\.")
_POLITE = re.compile(
    r"[\u3040-\u30ff\u4e00-\u9fff]{2,}(?:さん|様|さま|氏)|[\uac00-\ud7a3]{2,}\s?(?:씨|님)"
)
_WORD = re.compile(r"[^\W\d_]+(?:['’-][^\W\d_]+)*")
_PARTS = re.compile(r"['’-]s?(?![a-z])|['’-]|(?<=[^\W\d_A-Z])(?=[A-ZÄÖÜ])")
# Surnames with which most Chinese names begin, of which few words do; then Korean ones, and the
# commonest Japanese. What holds a sign of the body, of a place on it or of the skin is no name.
_HAN_NAME = re.compile(
    r"(?<![\u4e00-\u9fff])[王李张張刘劉陈陳杨楊赵趙吴吳徐孙孫朱郭林罗羅郑鄭梁宋唐韩韓冯馮邓鄧曹彭肖董袁潘蒋蔣蔡杜叶葉苏蘇魏吕呂丁"
    r"沈姚卢盧姜崔谭譚陆陸汪欧歐]\s?"
    r"[^\W臂腕手指掌背腹胸颈頸脸臉颊頰额額头頭腿膝足脚腳踝肩肘臀腰皮肤膚鼻眼耳唇上下左右前后後内內外侧側部位处處点點斑疤疹痣]{1,2}"
    r"(?![\u4e00-\u9fff])|"
    r"佐藤|鈴木|高橋|田中|渡[辺邊]|伊藤|山本|中村|小林|加藤|吉田|山田|佐々木|山口|松本|井上|木村|斎藤|清水|山崎|池田|橋本|阿部|"
    r"石川|前田|藤田|小川|後藤|岡田|長谷川|村上|近藤|石井"
)
_HANGUL_NAME = re.compile(
    r"(?<![\uac00-\ud7a3])[김박최윤임권황송류홍]\s?"
    r"(?:(?![팔손발목등배볼눈입귀코턱])[\uac00-\ud7a3]){2}(?![\uac00-\ud7a3])"
)
# Names that are words as well where they have no capital
_ALSO_WORDS = frozenset({
    "ana", "bauer", "christian", "eva", "frank", "jan", "jean", "kaya", "schwarz", "victoria",
})  # fmt: skip
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
    area atopic canthus cream crease crow's deltoid dermatitis dry eczema exposed film fold fossa
    gluteal healthy lotion marks mole nasolabial ointment oily patch plaque psoriasis region removed
    sensitive stretch sun temporal tegaderm vaseline wound zygomatic
"""
_FORM = re.compile(r"[A-Za-z0-9]+(?:[-_][A-Za-z0-9]+)*")
_LONGEST_NUMBER = 8  # longer ones are of insurances and registers
_YEARS = (1900, 2050)

_PLAIN = frozenset(_PLAIN_WORDS.split())


@cache
def _known() -> tuple[frozenset[str], frozenset[str]]:
    """Return the commonest names that are no words, and those that are words as well."""
    text = files("skinlab").joinpath("data/names.txt").read_text("utf-8")
    lists: list[set[str]] = []
    for line in text.splitlines():
        if line.startswith("#"):
            lists.append(set())
        else:
            lists[-1].update(line.split())
    names, words = lists
    return frozenset(names), frozenset(words)


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
    if len(text) > LONGEST_TEXT:
        raise InputError(f"{field}: {len(text)} characters; expected at most {LONGEST_TEXT}")
    if _dates(text):
        raise InputError(f"{field} {text!r}: holds what looks like a date; {expected}")
    if _MAIL.search(text):
        raise InputError(f"{field} {text!r}: holds an address; {expected}")
    name = _name(text)
    if name is not None:
        raise InputError(f"{field} {text!r}: {name!r} looks like a name; {expected}")
    register = _REGISTER.search(text)
    if register is not None:
        raise InputError(
            f"{field} {text!r}: {register[0]!r} looks like one of a register; {expected}"
        )
    for number in re.findall(r"\d+", text):
        if len(number) > _LONGEST_NUMBER:
            raise InputError(
                f"{field} {text!r}: a number of {len(number)} digits looks like one of a register; "
                f"{expected}"
            )
    return text


def _name(text: str) -> str | None:
    """Return what looks like a person's name in a sentence."""
    for titled in _TITLE.finditer(text):
        if titled[2][0].isupper() or titled[1].lower() in _TITLES:
            return titled[0]
    for form in (_POLITE, _HAN_NAME, _HANGUL_NAME):
        found = form.search(text)
        if found is not None:
            return found[0]
    for initial in _INITIAL.finditer(text):
        letter, name = initial[1] or initial[4], initial[2] or initial[3]
        if letter.isupper() and _capital(name):
            return initial[0]
    words = list(_WORD.finditer(text))
    for word in words:
        if any(map(_is_name, (word[0], *_PARTS.split(word[0])))):
            return word[0]
    for one, two in pairwise(words):
        beside = text[one.end() : two.start()].strip(" .,_-") == ""
        if beside and ((_capital(one[0]) and _capital(two[0])) or _pair(one[0], two[0])):
            return text[one.start() : two.end()]
    return None


def _is_name(word: str) -> bool:
    """Return whether a word is a common name, or one of it in German."""
    names, name = _known()[0], word.lower()
    if word == name:
        return name in names
    one_of_it = not word.isupper() and name.removesuffix("s") in names
    return name in names or name in _ALSO_WORDS or one_of_it


def _pair(one: str, two: str) -> bool:
    """Return whether two words that may be names are one: `grace lee`."""
    words = _known()[1]
    return one.lower() in words and two.lower() in words and one.lower() != two.lower()


def _capital(word: str) -> bool:
    """Return whether a word is capitalised, not in capitals, and not a plain one."""
    return len(word) > 1 and word[0].isupper() and not word.isupper() and word.lower() not in _PLAIN


def _dates(text: str) -> bool:
    """Return whether a run of digits, or three with the same sign between, can be read as a date.

    A run of six is none: see above.
    """
    if _MONTH.search(text) or _BORN.search(text):
        return True
    if any(_exists(c, b, a) or _exists(c, a, b) for a, b, c in _SPACED.findall(text)):
        return True
    for a, b, c in _SHORT.findall(text):
        even = int(b) - int(a) == int(c) - int(b)  # a scale, as 10 20 30
        if not even and (_exists(c, b, a) or _exists(a, b, c)):
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
        # A year of two digits comes first only where day and month have two as well
        for year, month, day in ((a, b, c), (c, b, a), (c, a, b))
        if year is not a or len(a) == 4 or len(b) == len(c) == 2
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
