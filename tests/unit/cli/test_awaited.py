"""What is said while somebody else is to start the instrument."""

from __future__ import annotations

import pytest

from drivers.events import Damaged, Sample
from skinlab.cli.awaited import Awaited
from skinlab.recording.stream import Happened

READING = Happened(Sample(0, 0.0, 0.0, 0.0, 0))
NOISE = Happened(Damaged("checksum", b"x"))


@pytest.mark.parametrize(
    ("came", "said"), [([], True), ([NOISE, NOISE], True), ([NOISE, READING], False)]
)
def test_an_instrument_that_says_nothing_that_can_be_read_is_told_of_once(capsys, came, said):
    now = 0.0
    awaited = Awaited(1, "mine", clock=lambda: now)
    awaited.begin()
    for message in came:
        awaited(message)
    told = []
    for now in (9.9, 10.1, 100.0):  # noqa: B007 -- the clock reads it
        capsys.readouterr()
        awaited.wait()
        told.append(capsys.readouterr().err)
    sentence = "no reading of dialect 'mine' has come for 10 s"
    assert [sentence in text for text in told] == [False, said, False]
