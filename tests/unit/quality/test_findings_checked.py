"""What a gate of a plugin finds is looked at: it may not be nothing to read."""

from __future__ import annotations

import numpy as np
import pytest

from skinlab import plugins
from skinlab.curves.curve import Setup
from skinlab.quality.gates import GATES, CurveSoFar, Finding, Gate, judge

VIEW = CurveSoFar(Setup(6.0, 1.0), np.zeros(1), np.zeros(1), np.zeros(1))


@pytest.mark.parametrize(("sentence", "advice"), [("", "look"), ("it is odd", " "), ("", "")])
def test_a_finding_without_words_is_none(monkeypatch, capsys, sentence, advice):
    """It had been shown as `mine: ; `."""
    gate = Gate("mine", lambda view: Finding("mine", sentence, advice), "m", "t")
    monkeypatch.setitem(GATES._all(), "mine", gate)
    monkeypatch.setitem(GATES._origins, "mine", plugins.Origin("works", "1.0"))
    monkeypatch.setattr(plugins, "_said", set())
    assert judge(gate, VIEW) is None
    assert capsys.readouterr().err == (
        "skinlab: plugin works, gate 'mine': broke down, and judges nothing: ValueError: its "
        "finding has an empty sentence or advice; expected what to do\n"
    )
