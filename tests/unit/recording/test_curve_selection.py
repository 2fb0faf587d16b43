"""What the operator decides can be taken back, and done again."""

from __future__ import annotations

from skinlab.recording.curve_selection import Ledger


def test_what_is_taken_back_and_done_again_is_as_before():
    ledger = Ledger()
    ledger.note("red")
    ledger.exclude(2, "loose")
    ledger.include(2)
    deeds = []
    while (deed := ledger.undo()) is not None:
        deeds.append(deed)
    assert (ledger.excluded, ledger.notes) == ({}, [])
    for deed in reversed(deeds[1:]):
        ledger.redo(deed)
    assert (ledger.excluded, ledger.notes) == ({2: "loose"}, ["red"])
    ledger.redo(deeds[0])
    assert ledger.excluded == {}
    assert ledger.undo().what == "curve included"
    assert ledger.excluded == {2: "loose"}
