from __future__ import annotations

from types import SimpleNamespace

import pytest

from skinlab.quality.gates import all_gates
from skinlab.quality.gates.base import Finding
from skinlab.report.verdict import Step, Use, judge, step_words


def of(*flags, findings=(), cut=None, partial=False, error=None):
    result = SimpleNamespace(flags=flags, error=error)
    return judge(result, findings, cut, partial=partial)


@pytest.mark.parametrize(
    ("flags", "words", "step"),
    [
        ((), "Good curve", Step.REPEAT_TO_CONFIRM),
        (("not_identifiable:nu",), "Good curve: it does not fix ν", Step.OTHER_OPENING),
        (("not_first_cycle",), "Good curve: of a later loading", Step.REST),
        (("outliers:2", "correlated_noise"), "Good curve", Step.REPEAT_TO_CONFIRM),
        (("at_bound:X1_MPa",), "Do not use: X1 at the end of what was searched",
         Step.CHECK_SETTINGS),
        (("at_bound:nu", "not_identifiable:nu"), "Good curve: it does not fix ν",
         Step.OTHER_OPENING),
        (("outside_database",), "Do not use: part of it lies outside the database",
         Step.CHECK_SETTINGS),
        (("misfit_above_noise",), "Repeat: it differs from the model by more than noise",
         Step.LOOK_FOR_EFFECT),
    ],
)  # fmt: skip
def test_flags_decide(flags, words, step):
    verdict = of(*flags)
    assert (verdict.words, verdict.step) == (words, step)
    assert step_words(verdict).endswith(".")


def test_what_spoils_the_numbers_comes_before_what_is_to_be_repeated():
    leak, saturated = Finding("leak", "it leaks", "press"), Finding("saturated", "full", "go lower")
    assert of(findings=[leak]).words == "Repeat: it leaks"
    worse = of(findings=[leak, saturated])
    assert worse.use is Use.NOT
    assert step_words(worse) == "Go lower."
    assert of(cut="vented").words == "Repeat: it was cut short (vented)"
    assert of(partial=True).use is Use.REPEAT
    few = [Finding("too_few_points", "it has 18 samples", "use a slower ramp")]
    assert of(cut="vented", findings=few).words == "Repeat: it was cut short (vented)"
    lifted = [Finding("no_contact", "the probe does not touch", "put it on")]
    assert of(cut="vented", findings=lifted).use is Use.NOT
    assert of(error="too few samples").words == "Do not use: not identified (too few samples)"
    assert judge(None, [], None, partial=False) is None


def test_every_gate_has_a_word():
    for gate in all_gates():
        verdict = of(findings=[Finding(gate.name, "so", "do")])
        remark = gate.name in {"not_first_cycle", "lost_frames"}
        assert (verdict.use is Use.GOOD) == remark
