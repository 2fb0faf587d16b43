"""What was loaded as advised, and which curves are it."""

from __future__ import annotations

from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.recording.advised import ADVISED, MISSING_EFFECT, advised_curves
from skinlab.recording.audit import note
from skinlab.recording.session import Session
from skinlab.recording.stream import setup_to_json


def loaded(aperture_mm, program, because=MISSING_EFFECT):
    said = {"aperture_mm": aperture_mm, "program": program, "because": because}
    return note(0.0, 0.0, "op", ADVISED, said)


def started(curve, aperture_mm, program):
    setup = Setup(aperture_mm, 1.0, parse_program(program))
    detail = {"curve": curve, "setup": setup_to_json(setup)}
    return note(0.0, 0.0, "op", "run started", detail)


def test_curves_behind_it_of_its_opening_and_program_are_as_advised():
    records = (
        started(1, 8.0, "mode1:80,2,2,4"),
        loaded(8.0, "mode1:80,2,2,4"),
        started(2, 6.0, "mode1:80,2,2,4"),
        started(3, 8.0, "ramp:100@20"),
        started(4, 8.0, "mode1:80,2,2,4"),
        loaded(8.0, "ramp:100@20", "X1 to ± 5 %"),
        started(5, 8.0, "ramp:100@20"),
    )
    expected = {"curve 4": MISSING_EFFECT, "curve 5": "X1 to ± 5 %"}
    assert advised_curves(Session({}, records, (), ())) == expected


def test_what_is_damaged_says_nothing():
    bad = [
        note(0.0, 0.0, "op", what, detail)
        for what in (ADVISED, "run started")
        for detail in ({}, {"program": 3, "aperture_mm": "x", "because": None}, {"setup": []})
    ]
    good = (loaded(8.0, "ramp:100@20"), started(1, 8.0, "ramp:100@20"))
    found = advised_curves(Session({}, (*bad, *good, *bad), (), ()))
    assert found == {"curve 1": MISSING_EFFECT}
