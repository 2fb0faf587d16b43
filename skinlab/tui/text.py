"""What is written on the screen, as pure functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drivers.events import (
    Alarm,
    Event,
    Hello,
    HostVented,
    InstrumentFault,
    LinkLost,
    Sample,
    VentConfirmed,
)
from skinlab.curves.curve import Setup
from skinlab.curves.program import Program
from skinlab.inference.result import Identification, Value
from skinlab.mechanics.materials.base import NU_CONSISTENT
from skinlab.mechanics.names import is_poisson, of_law, plain
from skinlab.quality.gates.base import Finding
from skinlab.report.text import explain
from skinlab.tui.canvas import interval_bar, share

if TYPE_CHECKING:
    from skinlab.tui.measurement_request import Order
    from skinlab.tui.ui_state import Board, Entry, Live, Playing

_FLAGS = {
    "at_bound": "{} at the edge of its range",
    "not_identifiable": "{} is not fixed by this curve",
    "misfit_above_noise": "misfit above the noise",
    "outside_database": "partly outside the database",
    "not_converged": "not converged",
    "partial_curve": "cut short",
    "not_first_cycle": "not the first loading",
}

_LABEL = 5  # cells of a parameter's name
_BAR = 12  # cells of the progress bar
_PROGRAM = 24  # cells of a program in the list


def name_of(parameter: str) -> str:
    """Return a parameter's name without its unit."""
    return plain(parameter)[0]


def flag_words(flag: str) -> str:
    """Return a flag of an identification in words."""
    kind, _, parameter = flag.partition(":")
    words = _FLAGS.get(kind, kind.replace("_", " "))
    return words.format(name_of(parameter)) if "{}" in words else words


def event_note(event: Event) -> tuple[str, str] | None:
    """Return (level, sentence) for an event that the operator must know of, else None."""
    match event:
        case HostVented(reason) if reason == "operator":
            return "warning", "vented"
        case HostVented(reason) if reason in {"close", "quit"}:
            return None
        case HostVented(reason):
            return "error", f"vented: {reason}"
        case VentConfirmed():
            return None
        case InstrumentFault(code, text):
            return "error", f"instrument fault {code}: {text}; Enter clears it"
        case LinkLost(reason):
            return "error", f"{reason}; plug it in again, it is being looked for"
        case Alarm(text):
            return "error", text
        case _:
            return None


def where_text(board: Board) -> str:
    """Return what is connected, for the header."""
    hello = board.hello
    if board.playing is not None:
        return f"replay of {board.port}"
    if hello is None:
        return board.port
    return f"{hello.model} {hello.firmware}, {hello.aperture_mm:g} mm opening"


def banner_text(hello: Hello | None) -> str:
    """Return the warning above everything, or nothing."""
    if hello is None or not hello.simulated:
        return ""
    return "SIMULATED: this is no patient; the numbers come from a model"


def pressure_text(sample: Sample | None) -> str:
    """Return the pressure, in mbar, without its unit."""
    return "--.-" if sample is None else f"{sample.pressure_mbar:.1f}"


def deflection_text(sample: Sample | None) -> str:
    """Return the deflection, in mm, without its unit."""
    return "-.---" if sample is None else f"{sample.deflection_mm:.3f}"


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
        n = 0 if board.live is None else len(board.live.pressure_mbar)
        return f"{n} points  {timeline_text(board.playing)}"
    live, entry = board.live, board.entry
    if live is not None:
        rate = "" if live.rate_hz is None else f" {live.rate_hz:.0f} Hz"
        lost = f", {live.lost} lost" if live.lost else ""
        return f"{len(live.pressure_mbar)} points{rate}{lost}  {_progress(live)}"
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


def order_lines(order: Order) -> list[str]:
    """Return the settings once more, for a last look before the start."""
    setup = order.setup
    who = ", ".join(part for part in (order.subject, order.site) if part)
    return [
        f"opening  {setup.aperture_mm:g} mm",
        f"skin     {_thickness(setup)} thick",
        f"program  {setup.program}",
        *([] if setup.program is None else [f"         {program_extent(setup.program)}"]),
        f"cycle    {setup.cycle}",
        *([f"repeats  {order.repeats}, {order.rest_s:g} s rest"] if order.repeats > 1 else []),
        f"subject  {who or 'none given'}",
    ]


def _thickness(setup: Setup) -> str:
    sd = "" if setup.thickness_sd_mm is None else f" ± {setup.thickness_sd_mm:g}"
    return f"{setup.thickness_mm:g}{sd} mm"


def settings_line(board: Board, texts: Mapping[str, str]) -> str:
    """Return the settings in one line, where the fields are folded away.

    Those of the fields; in a replay, where they mean nothing, those of the curve.
    """
    shown = board.live or board.entry
    if board.playing is not None and shown is not None:
        setup = shown.setup
        return f"{setup.aperture_mm:g} mm, {_thickness(setup)} of skin, {setup.program}"
    who = ", ".join(t for t in (texts["subject"], texts["site"]) if t) or "no subject"
    return f"{who}: {texts['aperture_mm']} mm, {texts['program']}"


def program_extent(program: Program) -> str:
    """Return how far and how long a program goes."""
    return f"up to {program.max_pressure_mbar:g} mbar, {program.duration_s:.3g} s"


@dataclass(frozen=True)
class CardText:
    """What the panel says; `final` is false for numbers that may still change."""

    title: str
    lines: tuple[str, ...]
    final: bool = True


def card_text(board: Board, columns: int) -> CardText:
    """Return what is armed, what is known so far of a running curve, or what was found."""
    live, entry = board.live, board.entry
    if live is not None:
        if live.estimate is None:
            return CardText(f"curve {live.index}", ("measuring …",), final=False)
        lines = (*result_lines(live.estimate, columns), *advice_lines(None, live.findings))
        return CardText(f"curve {live.index}: so far, not final", lines, final=False)
    if entry is None and board.order is not None and board.moving:
        hint = "Space starts, v vents" if board.can_start else "v vents"
        model = () if board.model is None else (f"model    {board.model}",)
        return CardText(f"{board.phase}: {hint}", (*order_lines(board.order), *model))
    if entry is None:
        return CardText("result", ("Enter arms, Space starts",))
    if entry.result is None:
        return CardText(f"curve {entry.index}", ("identifying …",), final=False)
    lines = (
        *result_lines(entry.result, columns),
        *advice_lines(entry.result, entry.findings, sample_noise_um(entry)),
    )
    return CardText(f"curve {entry.index}", lines)


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


_WHAT_TO_DO = {
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
    from skinlab.tui.strips import noise_band

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
    """Return the cells of the list: number, program, cycle, parameters, E, remarks.

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
    return (str(entry.index), program, str(setup.cycle), *numbers, error, remarks)


def shortened(text: str, most: int = _PROGRAM) -> str:
    """Return the text, cut where it is too long for the list."""
    return text if len(text) <= most else text[: most - 1] + "…"
