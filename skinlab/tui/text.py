"""What is written on the screen, as pure functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np

from drivers.capabilities import READ_ONLY
from drivers.events import (
    Hello,
    Sample,
)
from skinlab.curves.curve import Setup
from skinlab.curves.program import Hold, Program, Ramp, Release, Segment
from skinlab.inference.flags import CATALOGUE
from skinlab.inference.result import Identification, Value
from skinlab.mechanics.materials.base import NU_CONSISTENT
from skinlab.mechanics.names import is_poisson, of_law, plain
from skinlab.quality.gates.base import Finding
from skinlab.report.text import explain
from skinlab.tui.canvas import interval_bar, share
from skinlab.tui.plot_data import noise_band
from skinlab.tui.ui_state import Board, Entry, Live, Playing

if TYPE_CHECKING:
    from skinlab.acquisition.measurement_request import Order
    from skinlab.discrepancy.outcome import Outcome


_LABEL = 5  # cells of a parameter's name
_BAR = 12  # cells of the progress bar
_PROGRAM = 24  # cells of a program in the list
_WHOSE = 14  # cells of subject and site in the list


def name_of(parameter: str) -> str:
    """Return a parameter's name without its unit."""
    return plain(parameter)[0]


def flag_words(flag: str) -> str:
    """Return a flag of an identification in words."""
    kind, _, parameter = flag.partition(":")
    words = CATALOGUE[kind].label if kind in CATALOGUE else kind.replace("_", " ")
    return words.format(name_of(parameter)) if "{}" in words else words


def where_text(board: Board) -> str:
    """Return whose visit it is, since when, and what is connected, for the header."""
    hello = board.hello
    if board.playing is not None:
        if board.visit is None:
            return f"replay of {board.port}"
        return f"{who_text(board.visit)}  replay of {board.port}"
    who = board.who if board.elsewhere or board.visit is None else board.visit
    since = "" if board.elsewhere or board.begun_at is None else f", since {clock(board.begun_at)}"
    probe = board.port
    if hello is not None:
        opening = "" if hello.aperture_mm is None else f"{hello.aperture_mm:g} mm, "
        probe = f"{opening}{hello.model}"
    return f"{who_text(who)}{since}  {probe}{dose_text(board)}"


def dose_text(board: Board) -> str:
    """Return what the site has had in this visit; nothing where it had no suction."""
    dose = board.dose.total
    return f"; {dose.suction_mbar_s:.0f} mbar·s in {dose.time_s:.0f} s" if dose.time_s else ""


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


def banner_text(hello: Hello | None) -> str:
    """Return the warning above everything, or nothing."""
    if hello is not None and hello.read_only:
        return f"READ-ONLY: {READ_ONLY}"
    if hello is None or not hello.simulated:
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


def timeline_text(playing: Playing, columns: int = _BAR) -> str:
    """Return where a replay is, and at what speed."""
    share = playing.at_s / playing.length_s if playing.length_s > 0 else 1.0
    filled = round(columns * share)
    speed = "max" if playing.speed is None else f"{playing.speed:g}"
    sign = "■" if playing.ended else "‖" if playing.paused else "►"
    bar = "█" * filled + "░" * (columns - filled)
    return f"{sign} x{speed} {bar} {playing.at_s:.1f}/{playing.length_s:.1f} s"


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
        return f"{n} points  {timeline_text(board.playing)}"
    live, entry = board.live, board.entry
    if live is not None:
        rate = "" if live.rate_hz is None else f" {live.rate_hz:.0f} Hz"
        lost = f", {live.curve.lost} lost" if live.curve.lost else ""
        return f"{len(live.curve)} points{rate}{lost}  {_progress(live)}"
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
    return f"{bar} {done:.1f}/{whole:.1f} s, part {number} of {len(program.segments)}"


def order_lines(order: Order, *, assumed_thickness: bool = False) -> list[str]:
    """Return what will happen, for a last look before the start."""
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
        f"loading  {setup.cycle} of this site",
        f"repeats  {repeats}",
    ]


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
    return f"next: {who}: {texts['aperture_mm']} mm, {texts['program']}"


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
        case Hold(duration):
            return f"hold {duration:g} s"
        case Release():
            return "release"
        case _:
            return f"rest {segment.duration_s:g} s"


REVIEW_TITLE = "THIS WILL HAPPEN: F9 starts, Esc leaves it"


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
        lines = order_lines(review.order, assumed_thickness=review.assumed_thickness)
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
    if entry.result is None:
        return CardText(title, (whose, "identifying …"), final=False)
    return CardText(
        title,
        (
            whose,
            *result_lines(entry.result, columns),
            *advice_lines(entry.result, entry.findings, sample_noise_um(entry)),
        ),
    )


def result_lines(result: Identification, columns: int = 34) -> list[str]:
    """Return what was identified: values, intervals in numbers and as bars, and how well it fits.

    A bar shows a stiffness from a third of the value to three times it, and nu over its range.
    """
    if result.error is not None:
        return ["not identified:", result.error]
    lines = []
    for name, value in (result.parameters or {}).items():
        label, unit = plain(name)
        if len(label) >= _LABEL:  # of an effect
            lines.append(label)
            label = ""
        lines.append(
            f"{label:<{_LABEL}}{digits(value.value, 4):<8}{unit:<5}{interval_text(value)}".rstrip()
        )
        bar = value_bar(name, value, columns - _LABEL)
        if bar:
            lines.append(f"{'':<{_LABEL}}{bar}".rstrip())
        true_nu = result.derived.get(NU_CONSISTENT)
        if is_poisson(name) and true_nu is not None:
            lines.append(f"{'':<5}{digits(true_nu, 4):<8}true nu")
    if result.error_um is not None and result.rms_um is not None:
        lines.append(f"E {digits(result.error_um, 3)} µm, rms {digits(result.rms_um, 3)} µm")
    fitted = result.fitted_points
    lines.append(f"{fitted} of {result.points} points fitted")
    return lines


_BAR_FACTOR = 3.0
_POISSON_RANGE = (0.2, 0.5)


def value_bar(name: str, value: Value, columns: int) -> str:
    """Return the interval as a bar, or nothing where there is none."""
    if value.low is None or value.high is None:
        return ""
    numbers = np.array([value.low, value.value, value.high])
    if is_poisson(name):
        at = share(numbers, *_POISSON_RANGE)
    elif value.low > 0:
        at = 0.5 + 0.5 * np.log(numbers / value.value) / np.log(_BAR_FACTOR)
    else:
        return ""
    low, best, high = (float(x) for x in at)
    return interval_bar(low, best, high, columns)


_WHAT_TO_DO = {  # with the screen's own keys; the rest is the catalogue's advice
    "not_identifiable": "Measure with another opening too and fit together (s, j), or go higher.",
    "misfit_above_noise": "What it misses: press d.",
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
    """Return the interval, or nothing where the method gives none."""
    if value.low is None or value.high is None:
        return ""
    return f"{digits(value.low, 3)}–{digits(value.high, 3)}"


def value_columns(entries: Iterable[Entry]) -> tuple[str, ...]:
    """Return the law's parameters that the list of these curves shows."""
    return of_law((e.result.parameters or ()) if e.result is not None else () for e in entries)


def column_title(name: str) -> str:
    """Return the heading of a parameter's column: X1 MPa."""
    return " ".join(plain(name)).rstrip()


def row_texts(entry: Entry, names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Return the cells of the list: number, whose, when, program, cycle, parameters, E, remarks.

    `names` are the parameters that have a column; None: those of the curve's own law.
    """
    names = value_columns([entry]) if names is None else names
    setup: Setup = entry.curve.setup
    result = entry.result
    values = (result.parameters if result is not None else None) or {}
    numbers = [digits(values[name].value, 4) if name in values else "" for name in names]
    error = "" if result is None or result.error_um is None else digits(result.error_um, 3)
    remarks = "" if result is None else ", ".join(flag_words(flag) for flag in result.flags)
    if result is not None and result.error is not None:
        remarks = "not identified"
    program = shortened(str(setup.program))
    whose, at = shortened(who_text(entry.visit), _WHOSE), clock(entry.at)
    return (str(entry.index), whose, at, program, str(setup.cycle), *numbers, error, remarks)


def adoption_lines(outcome: Outcome, file_stem: str) -> list[str]:
    """Return what adopting the model with the missing effect will change."""
    best = outcome.best
    before, after = outcome.parameters(outcome.found.base), outcome.parameters(best)
    names = [e for e in best.effects if e not in outcome.found.base.effects]
    lines = [
        f"Curves from the next one on are identified with {' and '.join(names)} as well.",
        "What the curves looked at say, before and after:",
    ]
    for name, value in after.items():
        old = before.get(name)
        was = "" if old is None else f"{digits(old['value'], 3)} → "
        interval = f"({digits(value['low'], 3)}–{digits(value['high'], 3)})"
        lines.append(f"  {name_of(name)} {was}{digits(value['value'], 3)} {interval}")
    return [
        *lines,
        "Results that are there already stay as they are; the next curve begins a new session.",
        f"The model is written beside the session ({file_stem}-{'-'.join(names)}.toml).",
        "Ctrl+Z on the screen of missing effects goes back to the model of now.",
    ]


def shortened(text: str, most: int = _PROGRAM) -> str:
    """Return the text, cut where it is too long for the list."""
    return text if len(text) <= most else text[: most - 1] + "…"
