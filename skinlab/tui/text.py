"""What is written on the screen, as pure functions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from drivers.capabilities import READ_ONLY
from drivers.dose import Dose
from drivers.events import Sample
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import Hold, Program, Ramp, Release, Segment, Until
from skinlab.errors import InputError
from skinlab.inference.flags import CATALOGUE
from skinlab.inference.result import Identification, Value
from skinlab.mechanics.materials.base import NU_CONSISTENT
from skinlab.mechanics.names import (
    effect_words,
    is_logarithmic,
    is_poisson,
    of_law,
    parameter_of,
    plain,
    unit_of,
)
from skinlab.quality.gates.base import Finding
from skinlab.recording.curve_selection import Deed
from skinlab.report.rounding import best_words, decimals, interval_words, rounded
from skinlab.report.text import explain
from skinlab.report.verdict import Step, Use, Verdict, judge, step_words
from skinlab.tui.canvas import interval_bar, share
from skinlab.tui.plot_data import noise_band, round_down, round_up
from skinlab.tui.ui_state import SEARCHING, Board, Entry, Live, Playing

if TYPE_CHECKING:
    from skinlab.acquisition.measurement_request import Order
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.studies.reference import Range


_LEAST_BAR = 8  # cells; a shorter one shows nothing
_BAR = 12  # cells of the progress bar
_PROGRAM = 24  # cells of a program in the list
_WHOSE = 20  # cells of subject and site in the list


def name_of(parameter: str) -> str:
    """Return a parameter's name without its unit."""
    return plain(parameter)[0]


def flag_words(flag: str) -> str:
    """Return a flag of an identification in words."""
    kind, _, parameter = flag.partition(":")
    words = CATALOGUE[kind].label if kind in CATALOGUE else kind.replace("_", " ")
    return words.format(name_of(parameter)) if "{}" in words else words


def where_text(board: Board, columns: int = 200) -> str:
    """Return whose visit it is, its dose, the opening, since when, and what is connected.

    What matters least is left out where not all of it has room.
    """
    hello = board.hello
    busy = f"{board.busy} …" if board.busy else ""
    if board.playing is not None:
        whose = "" if board.visit is None else who_text(board.visit)
        return _fitting([busy, whose, f"replay of {board.port}"], columns, keep=2)
    who = board.who if board.elsewhere or board.visit is None else board.visit
    since = "" if board.elsewhere or board.begun_at is None else f"since {clock(board.begun_at)}"
    opening, probe = "", board.port
    if hello is not None:
        opening = "" if hello.aperture_mm is None else f"{hello.aperture_mm:g} mm"
        probe = hello.model
    dose = "" if board.elsewhere else dose_text(board.dose)
    parts = [busy, who_text(who), dose, opening, since, probe]
    return _fitting(parts, columns, keep=2 if busy else 1)


def _fitting(parts: Sequence[str], columns: int, *, keep: int) -> str:
    """Return as many of the parts, in order, as have room; the first ones in any case."""
    there = [part for part in parts if part]
    while len(there) > keep and len("  ".join(there)) > columns:
        there.pop()
    return "  ".join(there)


def dose_text(dose: Dose) -> str:
    """Return what the site has had; nothing where it had no suction."""
    return f"{dose.suction_mbar_s:.0f} mbar·s in {dose.time_s:.0f} s" if dose.time_s else ""


def who_text(visit: tuple[str, str] | None) -> str:
    """Return subject and site."""
    subject, site = visit or ("", "")
    return ", ".join(part for part in (subject or "no subject", site) if part)


def clock(at: datetime | None) -> str:
    """Return the time of day, or nothing where it is unknown."""
    return "" if at is None else f"{at:%H:%M}"


def suction_text(board: Board) -> str:
    """Return whether there is suction, and how it is ended, for the top of every screen."""
    if board.playing is not None:
        return "no suction"
    if board.suction and board.read_only:
        return "SUCTION: end it at the instrument"
    if board.suction:
        return "SUCTION: v vents" if board.streaming else "SUCTION? v vents"
    return "suction off" if board.hello is not None else "no probe"


def banner_text(board: Board) -> str:
    """Return the warning above everything, or nothing."""
    hello = board.hello
    if hello is not None and hello.read_only:
        return f"READ-ONLY: {READ_ONLY}"
    # Where the probe is gone, its curves are still there
    if not (hello.simulated if hello is not None else board.simulated and board.entries):
        return ""
    return "SIMULATED: this is no patient; the numbers come from a model"


def pressure_text(sample: Sample | None) -> str:
    """Return the pressure, in mbar, without its unit."""
    return "--.-" if sample is None else f"{sample.pressure_mbar:.1f}"


def deflection_text(sample: Sample | None) -> str:
    """Return the deflection, in mm, without its unit."""
    return "-.---" if sample is None else f"{sample.deflection_mm:.3f}"


def last_text(board: Board) -> str:
    """Return what was read last and when, where nothing streams; empty: nothing was read."""
    sample = board.latest
    if board.streaming or sample is None or board.elsewhere:
        return ""
    values = f"{pressure_text(sample)} mbar, {deflection_text(sample)} mm"
    return f"last: {values}, {clock(board.latest_at)}".rstrip(", ")


TIMELINE = r"[█░]+"  # of a replay, in the line of readings


def timeline_text(playing: Playing, columns: int = _BAR) -> str:
    """Return where a replay is, and at what speed."""
    share = playing.at_s / playing.length_s if playing.length_s > 0 else 1.0
    filled = round(columns * share)
    speed = "max" if playing.speed is None else f"{playing.speed:g}"
    sign = "■" if playing.ended else "‖" if playing.paused else "►"
    bar = "█" * filled + "░" * (columns - filled)
    return f"{sign} x{speed} {playing.at_s:.1f}/{playing.length_s:.1f} s {bar}"


def link_text(board: Board) -> str:
    """Return how the link does."""
    if board.playing is not None:
        return ""
    if board.hello is None:
        return "no link"
    if board.doing == "searching":
        return "LINK LOST"
    return f"{board.damaged} damaged frames" if board.damaged else "link ok"


def progress_text(board: Board) -> str:
    """Return how far the program is: points, segment, time."""
    if board.playing is not None:
        n = 0 if board.live is None else len(board.live.curve)
        return f"{timeline_text(board.playing)}  {n} points"
    live, entry = board.live, board.entry
    if live is not None:
        rate = "" if live.rate_hz is None else f" {live.rate_hz:.0f} Hz"
        lost = f", {live.curve.lost} lost" if live.curve.lost else ""
        return f"{len(live.curve)} points{lost}  {_progress(live)}{rate}"
    if entry is not None:
        lost = f", {entry.lost} lost" if entry.lost else ""
        return f"curve {entry.index}: {len(entry.curve)} points{lost}"
    return ""


def _progress(live: Live) -> str:
    program, last = live.setup.program, live.last
    if program is None or last is None:
        return ""
    whole = program.duration_s
    done = min(max(last.device_time_s, 0.0), whole)
    filled = round(_BAR * done / whole) if whole > 0 else _BAR
    number = min(last.segment + 1, len(program.segments))
    bar = "█" * filled + "░" * (_BAR - filled)
    return f"{done:.1f}/{whole:.1f} s {bar} part {number} of {len(program.segments)}"


def order_lines(
    order: Order, *, assumed_thickness: bool = False, counted: int | None = None
) -> list[str]:
    """Return what will happen, for a last look before the start.

    `counted` is which loading of the site this is by what the program has seen.
    """
    setup, program = order.setup, order.setup.program
    assumed = " (default, not measured)" if assumed_thickness else ""
    repeats = f"{order.repeats}, {order.rest_s:g} s rest between" if order.repeats > 1 else "once"
    return [
        f"subject  {order.subject or 'NONE GIVEN'}",
        f"site     {order.site or 'none given'}",
        f"opening  {setup.aperture_mm:g} mm",
        f"skin     {_thickness(setup)} thick{assumed}",
        f"program  {shortened(str(program), _MOST_PROGRAM)}",
        *([] if program is None else [f"         {program_words(program)}"]),
        *([] if program is None else [f"peak     {program_extent(program)}"]),
        f"loading  {setup.cycle} of this site{_as_stated(setup.cycle, counted)}",
        f"repeats  {repeats}",
    ]


def _as_stated(cycle: int, counted: int | None) -> str:
    if counted is None or cycle == counted:
        return ""
    return f" (as you say: {counted} by count)"


def _thickness(setup: Setup) -> str:
    sd = "" if setup.thickness_sd_mm is None else f" ± {setup.thickness_sd_mm:g}"
    return f"{setup.thickness_mm:g}{sd} mm"


def settings_line(board: Board, texts: Mapping[str, str]) -> str:
    """Return the settings, where the fields are folded away.

    Those of the fields; in a replay, where they mean nothing, those of the curve.
    """
    shown = board.live or board.entry
    if board.playing is not None and shown is not None:
        setup = shown.setup
        return f"{setup.aperture_mm:g} mm, {_thickness(setup)} of skin, {setup.program}"
    who = who_text((texts["subject"].strip(), texts["site"].strip()))
    whose = "" if (texts["subject"], texts["site"]) == board.visit else f"{who}: "
    return f"next: {whose}{texts['aperture_mm']} mm, {texts['program']}"


def program_extent(program: Program) -> str:
    """Return how far a program goes, and how long it holds suction."""
    whole, longest = suction_s(program), program.longest_suction_s
    pause = "" if whole <= longest * (1 + 1e-9) else f", {longest:.3g} s without a pause"
    return f"up to {program.max_pressure_mbar:g} mbar, {whole:.3g} s under suction{pause}"


def suction_s(program: Program) -> float:
    """Return the time that a program spends away from zero pressure, s."""
    times, pressures = program.knots()
    away = zip(times, times[1:], pressures, pressures[1:], strict=False)
    return sum(t1 - t0 for t0, t1, p0, p1 in away if p0 > 0 or p1 > 0)


_MOST_PROGRAM = 100  # characters: all that will happen must fit into one window
_MOST_PARTS = 4  # of a program that are told in words


def program_words(program: Program) -> str:
    """Return what a program does, in words; of a long one the beginning."""
    parts = [_segment_words(segment) for segment in program.segments]
    if len(parts) > _MOST_PARTS:
        parts = [*parts[:_MOST_PARTS], f"… {len(program.segments)} parts in all"]
    return ", ".join([*parts, "vent"])


def _segment_words(segment: Segment) -> str:
    match segment:
        case Ramp(target, rate):
            return f"go to {target:g} mbar at {rate:g} mbar/s"
        case Until(height, rate, most):
            return f"rise at {rate:g} mbar/s until {height:g} mm, to {most:g} mbar at most"
        case Hold(duration):
            return f"hold {duration:g} s"
        case Release():
            return "release"
        case _:
            return f"rest {segment.duration_s:g} s"


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
    if board.review is not None:
        return VerdictText("Read what will happen", "F9 starts it, Esc leaves it")
    if live is not None:
        against = judge(None, live.findings, None, partial=False)
        if against is not None:
            return VerdictText(against.words, f"{against.advice}; v vents", against.use)
        how = "end it at the instrument" if board.read_only else "v vents"
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
    openings = {curve.setup.aperture_mm for curve in board.used if not curve.partial}
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
        case Step.OTHER_OPENING if len(openings) > 1:
            return "s, then j: fit the openings together"
        case Step.OTHER_OPENING:
            return "another opening after a rest (F8); then s, j fit all"
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
            review.order, assumed_thickness=review.assumed_thickness, counted=review.counted
        )
        lines += [f"protocol {clause}" for clause in review.protocol]
        lines += [f"{'NOTE':<8} {clause}" for clause in review.otherwise]
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
            lines.append(f" ν of linear elasticity {_like(true_nu, value)}")
    if result.rms_um is not None:
        lines.append(f"rms {digits(result.rms_um, 3)} µm")
    fitted = result.fitted_points
    lines.append(f"{fitted} of {result.points} points fitted")
    return lines


def meaning(name: str) -> str:
    """Return what a parameter is, in a few words."""
    found = parameter_of(name)
    return name if found is None else found.meaning.partition(",")[0]


def value_words(name: str, value: Value, *, loose: bool = False, columns: int = 80) -> str:
    """Return interval and unit, and then the value or why there is no use in it."""
    unit = unit_of(name)
    interval = f"{interval_text(value) or best_words(value)}{unit and ' '}{unit}"
    if loose:
        long = f"{interval}, not fixed by this curve"
        return long if len(long) <= columns else f"{interval}, not fixed"
    if value.low is None or value.high is None:
        return f"{interval}, no interval"
    return f"{interval}  ({best_words(value)})"


def _like(number: float, value: Value) -> str:
    """Return a number with the decimals of another one."""
    if value.low is None or value.high is None:
        return digits(number, 3)
    return rounded(number, decimals(value.low, value.high))


_POISSON_RANGE = (0.2, 0.5)
_ROOM = 2.0  # at both ends of an interval, on a scale of its own


def value_scale(name: str, values: Sequence[float]) -> tuple[float, float, bool]:
    """Return round ends of a scale for these values, and whether it is logarithmic."""
    low, high = min(values), max(values)
    if is_poisson(name):
        return (min(_POISSON_RANGE[0], math.floor(10.0 * low) / 10.0), _POISSON_RANGE[1], False)
    if low > 0 and is_logarithmic(name):
        return round_down(low / _ROOM), round_up(high * _ROOM, least=0.0), True
    room = (high - low) / _ROOM or abs(high) or 1.0
    reach = round_up(room, least=0.0)
    return (
        reach * np.floor((low - 0.2 * room) / reach),
        reach * np.ceil((high + 0.2 * room) / reach),
        False,
    )


def value_bar(name: str, value: Value, columns: int, usual: Range | None = None) -> str:
    """Return the interval as a bar between the labels of its scale; nothing where there is none."""
    if value.low is None or value.high is None:
        return ""
    behind = None if usual is None else (usual.points[1][0], usual.points[1][-1])
    ends = (value.low, value.high, *(behind or ()))
    low, high, logarithmic = value_scale(name, ends)
    left, right = f"{low:g} ", f" {high:g}"
    width = columns - len(left) - len(right)
    if width < _LEAST_BAR:
        return ""
    return f"{left}{scaled_bar(value, low, high, width, behind, logarithmic=logarithmic)}{right}"


def scaled_bar(
    value: Value,
    low: float,
    high: float,
    columns: int,
    behind: tuple[float, float] | None = None,
    *,
    logarithmic: bool,
) -> str:
    """Return the interval of a value as a bar on this scale."""
    numbers = np.array([value.low, value.value, value.high, *(behind or ())], dtype=float)
    ends = np.array([low, high])
    if logarithmic:
        numbers, ends = np.log(numbers), np.log(ends)
    at = [float(x) for x in share(numbers, *ends.tolist())]
    return interval_bar(at[0], at[1], at[2], columns, (at[3], at[4]) if behind else None)


_WHAT_TO_DO = {  # with the screen's own keys; the rest is the catalogue's advice
    "not_identifiable": "Measure with another opening too and fit together (s, j), or go higher.",
    "misfit_above_noise": "Press d to look for what the model misses.",
    "at_bound": "Do not use the number as it is.",
    "outside_database": "Part of the curve is beyond the database, and was not fitted.",
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


def digits(value: float, significant: int) -> str:
    """Return the number with all of its significant digits, zeros too."""
    return f"{value:#.{significant}g}".rstrip(".")


def interval_text(value: Value) -> str:
    """Return the interval, rounded to what it carries, or nothing where there is none."""
    return "" if value.low is None or value.high is None else interval_words(value)


def value_columns(entries: Iterable[Entry]) -> tuple[str, ...]:
    """Return the law's parameters that the list of these curves shows."""
    return of_law((e.result.parameters or ()) if e.result is not None else () for e in entries)


def column_title(name: str) -> str:
    """Return the heading of a parameter's column: X1 MPa."""
    return " ".join(plain(name)).rstrip()


def row_texts(entry: Entry, names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Return the cells of the list, in the order of `ROW`, with the parameters in their place.

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
    remarks = "" if result is None else ", ".join(flag_words(flag) for flag in result.flags)
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


def adoption_lines(outcome: Outcome, file_stem: str) -> list[str]:
    """Return what adopting the model with the missing effect will change."""
    best = outcome.best
    before, after = outcome.parameters(outcome.found.base), outcome.parameters(best)
    names = [e for e in best.effects if e not in outcome.found.base.effects]
    lines = [
        f"Curves from the next one on are identified with {' and '.join(map(effect_words, names))} "
        "as well.",
        "What the curves looked at say, before and after:",
    ]
    for name, value in after.items():
        old = before.get(name)
        was = "" if old is None else f"{interval_words(Value(**old))} → "
        unit = unit_of(name)
        now = f"{interval_words(Value(**value))}{unit and ' '}{unit}"
        lines.append(f"  {name_of(name)} {was}{now}")
    return [
        *lines,
        "Results that are there already stay as they are; the next curve begins a new session.",
        f"The model is written beside the session ({file_stem}-{'-'.join(names)}.toml).",
        "Ctrl+Z on the screen of missing effects goes back to the model of now.",
    ]


def shortened(text: str, most: int = _PROGRAM) -> str:
    """Return the text, cut where it is too long for the list."""
    return text if len(text) <= most else text[: most - 1] + "…"


def undone_words(deed: Deed) -> str:
    """Return what taking a decision back comes to."""
    match deed.what:
        case "note":
            return f"the note “{deed.text}” is struck out"
        case "curve excluded":
            return f"curve {deed.curve} is used again"
        case _:
            return f"curve {deed.curve} is left out again"
