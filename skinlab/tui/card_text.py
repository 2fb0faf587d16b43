"""What is said of a curve: its verdict, its card, its row of the list."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from drivers.events import InstrumentState
from skinlab.curves.curve import Curve, Setup
from skinlab.errors import InputError
from skinlab.inference.result import Identification
from skinlab.mechanics.materials.base import NU_CONSISTENT
from skinlab.mechanics.names import is_poisson
from skinlab.quality.gates.base import Finding
from skinlab.recording.session_fit import comparable
from skinlab.report.rounding import decimals, interval_words, rounded
from skinlab.report.text import errors_in_short, explain
from skinlab.report.verdict import Step, Use, Verdict, judge, step_words
from skinlab.tui.plot_data import noise_band
from skinlab.tui.shown import Entry
from skinlab.tui.text import clock, order_lines, who_text
from skinlab.tui.ui_state import SEARCHING, Board
from skinlab.tui.value_text import (
    digits,
    flag_words,
    meaning,
    name_of,
    shortened,
    value_bar,
    value_columns,
    value_words,
    written_like,
)

if TYPE_CHECKING:
    from skinlab.studies.reference import Range


_WHOSE = 20  # cells of subject and site in the list


REVIEW_TITLE = "THIS WILL HAPPEN: F9 starts, Esc leaves it"


@dataclass(frozen=True)
class VerdictText:
    """The answer to "can I use it, and what next?"; `use` is None where there is no curve."""

    words: str
    following: str
    use: Use | None = None


def verdict_text(board: Board) -> VerdictText:
    """Return what stands above everything else on the main screen."""
    live, entry = board.live, board.entry
    if board.alarm is not None:  # no advice on the next curve until somebody has seen to it
        again = "" if board.read_only or board.out_of_reach else "v vents again, "
        return VerdictText("Alarm: lift the probe", f"{again}F9 acknowledges")
    if board.review is not None:
        return VerdictText("Read what will happen", "F9 starts it, Esc leaves it")
    if live is not None:
        against = judge(None, live.findings, None, partial=False)
        how = "end it at the instrument" if board.read_only else "v vents"
        if board.playing is not None:  # there is nothing to end
            how = "Space pauses"
        if against is not None:
            # How to end it first: the advice is longer than a narrow line
            return VerdictText(against.words, f"{how}; {against.advice}", against.use)
        return VerdictText(f"Measuring curve {live.index} …", how)
    left_s = board.rest_left_s
    if left_s is not None:
        so_far = "" if entry is None or entry.verdict is None else f". {entry.verdict.words}"
        more = "" if board.left is None else f" ({board.left.repeats} to come)"
        use = None if entry is None or entry.verdict is None else entry.verdict.use
        return VerdictText(f"Resting: next repeat in {left_s} s{so_far}", f"v ends it{more}", use)
    if board.doing == SEARCHING and board.playing is None:
        return VerdictText("The link is lost", "lift the probe if it still pulls; plug it in again")
    if board.doing is not None and board.playing is None and board.doing != "venting":
        vents = "v gives up" if board.read_only else "v vents"
        return VerdictText(f"{board.phase.capitalize()} …", vents if board.moving else "wait")
    if board.instrument is InstrumentState.FAULT and board.playing is None:
        return VerdictText("The instrument has a fault", "F8 clears it")
    if board.left is not None:
        return VerdictText("The link was lost, and is back", "F8 shows the repeat that was cut")
    if entry is not None:
        return _of_entry(board, entry)
    if board.playing is not None:
        return VerdictText("A replay", "Space pauses, . steps, + and - change the speed")
    if board.hello is None:
        return VerdictText("No probe is connected", "F2 chooses a port; F8 tries this one")
    if board.elsewhere:
        return VerdictText(f"A new visit: {who_text(board.who)}", "F8 shows what will happen")
    step = protocol_text(board)
    return VerdictText("Ready", step or "F8 shows what will happen, F9 then starts it")


def protocol_text(board: Board) -> str:
    """Return the next step of the protocol with its key; nothing where there is none."""
    walk = board.walk
    if walk is None:
        return ""
    sites = () if board.protocol is None else board.protocol.protocol.study.sites
    elsewhere = [site for site in sites if not board.site_done(site) and site != board.who[1]]
    if walk.next is not None:
        return f"{walk.words}; F7 loads it, p shows all"
    if elsewhere:
        return f"this site is done; F7 goes on to {elsewhere[0]}"
    return f"{walk.words}; p shows them"


def _of_entry(board: Board, entry: Entry) -> VerdictText:
    reason = board.ledger.excluded.get(entry.index)
    if reason is not None:
        return VerdictText(f"Left out: {reason}", "s and Del take it in again", Use.NOT)
    verdict = entry.verdict
    if verdict is None:
        return VerdictText(f"Curve {entry.index}: identifying …", "wait")
    if board.playing is not None:
        following = step_words(verdict)
    elif board.hello is None:
        following = "no probe is connected: F8 tries this port, F2 chooses another"
    else:
        following = _following(board, verdict)
    return VerdictText(verdict.words, following, verdict.use)


def _following(board: Board, verdict: Verdict) -> str:
    """Return the one next step, with its key."""
    openings = {curve.setup.aperture_mm for curve in comparable(board.used)}
    walk = board.walk
    if verdict.use is Use.GOOD and board.goal_is is not None and (walk is None or not walk.next):
        return board.goal_is.words
    if verdict.use is Use.GOOD and walk is not None:
        return protocol_text(board)
    match verdict.step:
        case Step.ADVICE:
            return f"{verdict.advice}; then F8"
        case Step.MEASURE_AGAIN:
            return "F8 measures again"
        case Step.CHECK_SETTINGS | Step.LOWER:
            return "F3: check opening, thickness, program; then F8"
        case Step.LOOK_FOR_EFFECT:
            return "hold still and repeat (F8); if it stays, d says why"
        case Step.LOOK_AGAIN:
            return "d, then d again: looks with this curve too"
        case Step.OTHER_OPENING if len(openings) > 1:
            return "s, then j: fit the openings together"
        case Step.OTHER_OPENING:
            return "another opening after a rest (F6, F8); s, j fit all"
        case Step.REST:
            return "let the site rest, then F6 (also for another spot)"
        case Step.REPEAT_TO_CONFIRM if len(board.used) > 1:
            return "s shows what the curves say together; F8 measures on"
        case _:
            return "F8 repeats it"


@dataclass(frozen=True)
class CardText:
    """What the panel says; `final` is false for numbers that may still change."""

    title: str
    lines: tuple[str, ...]
    final: bool = True


def card_text(board: Board, columns: int) -> CardText:
    """Return what is armed, what is known so far of a running curve, or what was found."""
    live, entry, review = board.live, board.entry, board.review
    model = () if board.model is None else (f"model    {board.model}",)
    if review is not None:
        lines = order_lines(
            review.order,
            assumed_thickness=review.assumed_thickness,
            counted=review.counted,
            placed=review.placed,
        )
        lines += [f"protocol {clause}" for clause in review.protocol]
        notes = [*review.otherwise, *filter(None, (review.before, review.unanswered))]
        lines += [f"{'NOTE':<8} {clause}" for clause in notes]
        return CardText(REVIEW_TITLE, (*lines, *model))
    if live is not None:
        whose = who_text(board.visit)
        if live.estimate is None:
            return CardText(f"curve {live.index}", (whose, "measuring …"), final=False)
        lines = [whose, *result_lines(live.estimate, columns), *advice_lines(None, live.findings)]
        return CardText(f"curve {live.index}: so far, not final", tuple(lines), final=False)
    if entry is None and board.order is not None and board.moving:
        return CardText(
            f"{board.phase}: v {'gives up' if board.read_only else 'vents'}",
            (*order_lines(board.order), *model),
        )
    if entry is None and not board.can_arm:  # F8 would do nothing
        return CardText("result", ("no curve yet",))
    if entry is None and board.elsewhere:
        whose = who_text(board.who)
        return CardText("a new visit", (whose, "F8 begins it and shows what will happen"))
    if entry is None:
        return CardText("result", ("F8 shows what will happen, F9 then starts it",))
    title, whose = f"curve {entry.index}  {clock(entry.at)}".rstrip(), who_text(entry.visit)
    if board.second_card:
        return CardText(f"{title}  R0–R9", (whose, *step_lines(entry.curve)))
    if entry.result is None:
        return CardText(title, (whose, "identifying …"), final=False)
    return CardText(
        title,
        (
            whose,
            *result_lines(entry.result, columns, board.ranges(entry)),
            *advice_lines(entry.result, entry.findings, sample_noise_um(entry)),
        ),
    )


def step_lines(curve: Curve) -> list[str]:
    """Return the numbers that a step curve gives by the Cutometer's definitions."""
    from skinlab.curves.cutometer import step_numbers  # not needed for what is not looked at

    try:
        found = step_numbers(curve)
    except InputError as error:
        return ["only for step programs (mode1:P,ON,OFF):", str(error)]
    lines = []
    for name, number in found.numbers.items():
        if number.value is None:
            lines.append(f"{name:<3} -  {number.reason}")
            continue
        unit = "" if number.unit == "1" else f" {number.unit}"
        scatter = ""
        if number.sd:
            places = decimals(0.0, 4.0 * number.sd)
            scatter = f" ± {rounded(2.0 * number.sd, places)}"
            lines.append(f"{name:<3} {rounded(number.value, places)}{scatter}{unit}")
        else:
            lines.append(f"{name:<3} {digits(number.value, 3)}{unit}")
    return [*lines, "± is twice the noise of a reading; formulas: skinlab cutometer --help"]


def result_lines(
    result: Identification, columns: int = 34, ranges: Mapping[str, Range] | None = None
) -> list[str]:
    """Return what was identified, and how well it fits.

    Of each parameter: what it is, its interval in numbers, and as a bar on a labelled scale, with
    the range that is usual (░) behind it.
    """
    if result.error is not None:
        return ["not identified:", result.error]
    lines = []
    for name, value in (result.parameters or {}).items():
        loose = f"not_identifiable:{name}" in result.flags
        lines += wrap(f"{name_of(name)} {meaning(name)}", columns)
        lines.append(f" {value_words(name, value, loose=loose, columns=columns - 1)}")
        bar = value_bar(name, value, columns - 1, (ranges or {}).get(name))
        if bar:
            lines.append(f" {bar}")
        true_nu = result.derived.get(NU_CONSISTENT)
        if is_poisson(name) and true_nu is not None:
            lines.append(f" ν of linear elasticity {written_like(true_nu, value)}")
    if result.rms_um is not None:
        lines.append(f"rms {digits(result.rms_um, 3)} µm")
    if result.error_model is not None:
        lines += wrap(f"errors: {errors_in_short(result.error_model)}", columns)
    fitted = result.fitted_points
    lines.append(f"{fitted} of {result.points} points fitted")
    return lines


_WHAT_TO_DO = {  # with the screen's own keys; the rest is the catalogue's advice
    "not_identifiable": "Measure with another opening too and fit together (s, j), or go higher.",
    "misfit_above_noise": "Press d to look for what the model misses.",
    "at_bound": "Do not use the number as it is.",
    "outside_database": "Part of the curve, or of likely thicknesses, is beyond the database.",
    "not_converged": "The search did not settle: measure again.",
    "partial_curve": "The curve was cut short: measure again.",
    "not_first_cycle": "Not the first loading: the skin is softer than when fresh; let it rest.",
}


def sample_noise_um(entry: Entry) -> float | None:
    """Return the noise of one sample, root mean square over the fitted ones; None: unknown."""
    _, sd_um = noise_band(entry)
    return float(np.sqrt(np.mean(sd_um**2))) if len(sd_um) else None


def advice_lines(
    result: Identification | None, findings: Sequence[Finding], noise_um: float | None = None
) -> list[str]:
    """Return what to think of a curve and what to do, a sentence or two each.

    `noise_um` is that of one sample of it, the pressure's included; None: unknown.
    """
    lines = []
    if result is not None:
        flags = list(dict.fromkeys(flag.partition(":")[0] for flag in result.flags))
        lines += [f"! {sentence}" for sentence in explain(result, noise_um)]
        said = {finding.gate for finding in findings}
        lines += [f"→ {_WHAT_TO_DO[f]}" for f in flags if f in _WHAT_TO_DO and f not in said]
    lines += [f"! {finding.sentence} → {finding.advice}" for finding in findings]
    return lines


def row_texts(entry: Entry, names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Return the cells of the list: those of `ROW_BEFORE`, the parameters, those of `ROW_AFTER`.

    `names` are the parameters that have a column; None: those of the curve's own law.
    """
    names = value_columns([entry]) if names is None else names
    setup: Setup = entry.curve.setup
    result = entry.result
    values = (result.parameters if result is not None else None) or {}
    loose = () if result is None else result.flags
    numbers = [
        f"{interval_words(values[n])}{'?' if f'not_identifiable:{n}' in loose else ''}"
        if n in values
        else ""
        for n in names
    ]
    rms = "" if result is None or result.rms_um is None else digits(result.rms_um, 3)
    said = [] if setup.placement is None else [f"placement {setup.placement}"]
    said += [] if result is None else [flag_words(flag) for flag in result.flags]
    remarks = ", ".join(said)
    if result is not None and result.error is not None:
        remarks = "not identified"
    verdict = entry.verdict
    return (
        str(entry.index),
        shortened(who_text(entry.visit), _WHOSE),
        clock(entry.at),
        "" if verdict is None else _USE[verdict.use],
        f"{setup.aperture_mm:g}",
        str(setup.cycle),
        *numbers,
        shortened(str(setup.program)),
        rms,
        remarks,
    )


ROW_BEFORE = ("#", "whose", "time", "use", "mm", "load")
ROW_AFTER = ("program", "rms µm", "remarks")
_USE = {Use.GOOD: "good", Use.REPEAT: "repeat", Use.NOT: "no"}
