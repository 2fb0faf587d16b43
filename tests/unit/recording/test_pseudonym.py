"""Pseudonyms pass; names and birth dates do not."""

from __future__ import annotations

import pytest

from skinlab.errors import InputError
from skinlab.recording.pseudonym import check_note, check_site, check_subject


@pytest.mark.parametrize(
    "subject",
    [
        "", "P-7", "P07", "P-017", "S001", "VOL12", "subject-12", "Subject_12", "patient7", "AB-12",
        "7", "0042", "12345", "P1234567", "KX-93-Q", "01-02-003", "S01-V2", "CTRL-04", "control4",
        "proband_3_B", "2024-17", "P2024-017", "A1B2C3", "S-12-2024-001", "pilot-1",
        "1987", "P999999", "800312", "P-120380",
    ],
)  # fmt: skip
def test_a_code_is_taken(subject):
    assert check_subject(subject) == subject


@pytest.mark.parametrize(
    "subject",
    [
        "Anna", "Anna7", "anna.schmidt", "Anna Schmidt", "Schmidt, A.", "A. Schmidt", "MÜLLER1",
        "jsmith3", "J. Smith 1980", "miller_12", "Eva7", "max1", "O'Brien1", "Jean-Luc7", "李雷1",
        "P-7 Anna", "AnnaS12", "subject-anna-1", "patient", "ABC", "a@b.de1", "../x1",
        "P7\n", " P7",
    ],
)  # fmt: skip
def test_what_looks_like_a_name_is_refused(subject):
    with pytest.raises(InputError, match="pseudonym"):
        check_subject(subject)


@pytest.mark.parametrize(
    "subject",
    [
        "1980-03-12", "12.03.1980", "12/03/1980", "P-1980-03-12", "12-03-80",
        "19800312", "12031980",
        "P19800312", "12mar1980", "12-Mar-80", "3-12-1980",
        "19870412-1234", "8704121234",
    ],
)  # fmt: skip
def test_what_looks_like_a_birth_date_is_refused(subject):
    with pytest.raises(InputError, match="date"):
        check_subject(subject)


def test_counters_are_not_taken_for_dates():
    """Plain numbers with a letter before them: none of up to five digits is refused."""
    for digits in range(1, 6):
        step = max(1, 10**digits // 500)
        for number in range(0, 10**digits, step):
            assert check_subject(f"S{number:0{digits}d}")


@pytest.mark.long
def test_how_often_a_plain_number_is_taken_for_a_date():
    """One in two hundred at most, of any length that a pseudonym may have."""
    for digits in range(1, 9):
        numbers = range(0, 10**digits, max(1, 10**digits // 4001))
        refused = sum(not taken(check_subject, f"{number:0{digits}d}") for number in numbers)
        assert refused <= len(numbers) / 200
        refused = sum(not taken(check_note, f"code {number:0{digits}d}") for number in numbers)
        assert refused <= len(numbers) / 200


def taken(check, text):
    try:
        check(text)
    except InputError:
        return False
    return True


@pytest.mark.parametrize("check", [check_site, check_note])
@pytest.mark.parametrize(
    "text",
    [
        "", "forearm", "left forearm", "Left Forearm", "LEFT FOREARM",
        "volar forearm, 5 cm from wrist",
        "Linker Unterarm", "rechter Unterarm innen", "Avant bras gauche", "site 3, 10 20 30 mbar",
        "0.5-1.25 mm", "P-17", "tape came off at 12:30", "Probe moved. Repeated with new tape",
        "120380", "near 12 mm", "3 decreased 5 times",
        "Vitamin C. then dry", "Nasolabial Fold", "Vaseline Lotion", "Eczema Plaque", "12.5.2",
        "100 200 300 400 mbar", "12.5 13.2 14.1 15.0", "2 hr later", "miss the spot",
        "dr said stop", "E. coli", "100 20 1000", "3M Micropore", "a frank lesion", "Sun Exposed",
        "左前臂内侧", "额头", "黄色斑", "이마", "오른팔", "dorso della mano",
        "12 30 45", "24 12 61 mm",
        "may be wet", "mark at 3 cm", "the 2nd of 3", "<b>x</b>", "\x1b[31mred",
    ],
)  # fmt: skip
def test_sites_and_notes_are_taken(check, text):
    assert check(text) == text


@pytest.mark.parametrize("check", [check_site, check_note])
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Anna", "name"), ("forearm of Anna", "name"), ("Mrs Schmidt, left arm", "name"),
        ("Dr. Okonkwo asked to stop", "name"), ("Jadwiga Kowalska", "name"),
        ("Kowalska, Jadwiga", "name"),
        ("forearm 1980-03-12", "date"), ("born 800312", "date"), ("12.03.1980", "date"),
        ("measured 19800312", "date"), ("12 March 1980", "date"), ("March 12, 1980", "date"),
        ("anna schmidt", "name"), ("anna.schmidt", "name"), ("AnnaSchmidt", "name"),
        ("hans-peter, left", "name"), ("Mary's arm", "name"), ("Peters Arm", "name"),
        ("A. Okonkwo", "name"), ("Okonkwo, A.", "name"), ("M. Okonkwo", "name"),
        ("mr okonkwo", "name"), ("frau okonkwo", "name"), ("Sig.ra Okonkwo", "name"),
        ("pt: jones", "name"), ("田中太郎さん", "name"), ("Müller left", "name"),
        ("王小明", "name"), ("张 伟", "name"), ("김민준", "name"), ("田中太郎", "name"),
        ("sara lee", "name"), ("grace lee", "name"), ("arm of rose miller", "name"),
        ("24 12 61", "date"), ("61 12 24", "date"),
        ("3 de mayo de 1961", "date"), ("3 maggio 1961", "date"), ("1er mai 1961", "date"),
        ("3rd of May 1961", "date"), ("1961年5月3日", "date"), ("3 мая 1961", "date"),
        ("03 05 1961", "date"), ("born in 1961", "date"), ("né le 03 05 61", "date"),
        ("+49 176 1234567", "register"), ("0176 12345678", "register"),
        ("123-45-6789", "register"), ("943 476 5919", "register"),
        ("756.1234.5678.97", "register"),
        ("a.b@example.org", "address"),
        ("insured as 123456789", "register"),
    ],
)  # fmt: skip
def test_sites_and_notes_name_nobody(check, text, why):
    with pytest.raises(InputError, match=why):
        check(text)


@pytest.mark.parametrize("check", [check_site, check_note])
@pytest.mark.parametrize("text", ["A" * 100_000, "a@" * 50_000], ids=["letters", "signs"])
def test_a_text_that_is_too_long_is_refused_at_once(check, text):
    with pytest.raises(InputError, match="100000 characters; expected at most 2000"):
        check(text)


@pytest.mark.parametrize("part", ["A", "1.", "A. ", "Aa-", "x@", "x@x.", "1 ", "a'"])
def test_any_shorter_one_is_judged(part):
    taken(check_note, part * (2000 // len(part)))


def test_a_number_of_a_register_is_refused():
    with pytest.raises(InputError, match="register"):
        check_subject("P999999999")
