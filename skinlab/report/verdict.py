"""Can this curve be used? One word first, then why, then the one next step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from skinlab.mechanics.names import plain
from skinlab.quality.gates.base import Finding


class Use(StrEnum):
    """What a curve is good for."""

    GOOD = "good"
    REPEAT = "repeat"
    NOT = "do_not_use"


class Step(StrEnum):
    """What to do next; a screen has a key for each, a report a sentence."""

    MEASURE_AGAIN = "measure_again"
    CHECK_SETTINGS = "check_settings"
    LOWER = "lower"  # pressure, or a smaller opening
    LOOK_FOR_EFFECT = "look_for_effect"
    LOOK_AGAIN = "look_again"  # for it, with this curve too
    OTHER_OPENING = "other_opening"
    REST = "rest"
    REPEAT_TO_CONFIRM = "repeat_to_confirm"
    ADVICE = "advice"  # the sentence of the finding says it


@dataclass(frozen=True)
class Verdict:
    """`why` is a clause without a full stop, empty where there is nothing to add."""

    use: Use
    why: str
    step: Step
    advice: str = ""  # of the finding that decided

    @property
    def words(self) -> str:
        """Good curve / Repeat: … / Do not use: …."""
        match self.use:
            case Use.GOOD:
                return f"Good curve{': ' if self.why else ''}{self.why}"
            case Use.REPEAT:
                return f"Repeat: {self.why}"
            case Use.NOT:
                return f"Do not use: {self.why}"


class Judged(Protocol):
    """What is looked at in an answer, of now or stored."""

    @property
    def error(self) -> str | None:
        """Why there is no answer."""

    @property
    def flags(self) -> Sequence[str]:
        """What is to be known of it."""


# The numbers would be of the instrument, and not of the skin
_SPOILT = frozenset({"no_contact", "saturated", "frozen"})
FEW = "too_few_points"  # of what is for an effect no reproach
FOR_EFFECT = "it is for the missing effect, and alone tells no parameters"
# They change what a curve is compared with, and not whether it is one
_REMARKS = frozenset({"not_first_cycle", "lost_frames"})


def judge(
    result: Judged | None,
    findings: Sequence[Finding],
    cut: str | None,
    *,
    partial: bool,
    for_effect: bool = False,
) -> Verdict | None:
    """Return the verdict; None: there is no answer yet, and nothing else against the curve.

    A curve `for_effect` was measured to tell explanations apart: it need not tell parameters.
    """
    against = [f for f in findings if f.gate not in _REMARKS]
    if spoilt := [f for f in against if f.gate in _SPOILT]:
        return Verdict(Use.NOT, spoilt[0].sentence, Step.ADVICE, spoilt[0].advice)
    if partial or cut is not None:  # what else is wrong, such as too few points, follows from it
        # The instrument's word for us, and ours for who gave up an instrument that is only read
        known = {"host": "vented from here", "operator": "given up by the operator"}
        because = known.get(cut or "", cut)
        why = f"it was cut short{'' if not because else f' ({because})'}"
        return Verdict(Use.REPEAT, why, Step.MEASURE_AGAIN)
    if against:
        return Verdict(Use.REPEAT, against[0].sentence, Step.ADVICE, against[0].advice)
    if result is None:
        return None
    if result.error is not None:
        # The same again would have no answer either
        step = Step.CHECK_SETTINGS if "outside_database" in result.flags else Step.MEASURE_AGAIN
        found = Verdict(Use.NOT, f"not identified ({result.error})", step)
    else:
        found = _of_flags(result.flags)
    if for_effect and found.use is not Use.GOOD and "outside_database" not in result.flags:
        return Verdict(Use.GOOD, FOR_EFFECT, Step.LOOK_AGAIN)
    return found


def _of_flags(flags: Sequence[str]) -> Verdict:
    def about(kind: str) -> list[str]:
        return [what for of, _, what in (flag.partition(":") for flag in flags) if of == kind]

    def names(parameters: Sequence[str]) -> str:
        return " and ".join(plain(name)[0] for name in parameters)

    kinds = {flag.partition(":")[0] for flag in flags}
    if "outside_database" in kinds:
        why = "part of it lies outside the database"
        return Verdict(Use.NOT, why, Step.CHECK_SETTINGS)
    # A parameter that the curve does not fix may well have its optimum at an end
    loose = about("not_identifiable")
    if bounds := [name for name in about("at_bound") if name not in loose]:
        why = f"{names(bounds)} at the end of what was searched"
        return Verdict(Use.NOT, why, Step.CHECK_SETTINGS)
    if "not_converged" in kinds:
        return Verdict(Use.NOT, "the search did not settle", Step.MEASURE_AGAIN)
    if "misfit_above_noise" in kinds:
        return Verdict(
            Use.REPEAT, "it differs from the model by more than noise", Step.LOOK_FOR_EFFECT
        )
    remarks = []
    if "not_first_cycle" in kinds:
        remarks.append("of a later loading")
    if loose:
        remarks.append(f"it does not fix {names(loose)}")
    if "crease" in kinds:
        remarks.append("the skin creases")
    if "unlike_cohort" in kinds:
        remarks.append("unlike the population")
    if "unlike_model" in kinds:
        remarks.append("unlike what the model has learned")
    step = Step.REPEAT_TO_CONFIRM
    if loose:
        step = Step.OTHER_OPENING
    elif "not_first_cycle" in kinds:
        step = Step.REST
    return Verdict(Use.GOOD, ", ".join(remarks), step)


_STEPS = {
    Step.MEASURE_AGAIN: "Measure again.",
    Step.CHECK_SETTINGS: "Check opening, thickness and pressure, then measure again.",
    Step.LOWER: "Measure to a lower pressure, or through a smaller opening.",
    Step.LOOK_FOR_EFFECT: "Measure again with the probe held still; if it stays so, look for what "
    "the model misses.",
    Step.LOOK_AGAIN: "Look again for what the model misses, with this curve.",
    Step.OTHER_OPENING: "Measure the rested site with another opening too, and fit together.",
    Step.REST: "Compare it with later loadings only, or let the site rest.",
    Step.REPEAT_TO_CONFIRM: "Repeat it to see how much it scatters.",
}


def step_words(verdict: Verdict) -> str:
    """Return the next step as a sentence, for whoever has no screen before them."""
    if verdict.step is Step.ADVICE:
        return f"{verdict.advice[:1].upper()}{verdict.advice[1:]}."
    return _STEPS[verdict.step]
