"""What is written on the screen, as pure functions."""

from __future__ import annotations

from typing import TYPE_CHECKING

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
from skinlab.curve import Setup
from skinlab.identify.result import Identification, Value
from skinlab.program import Program

if TYPE_CHECKING:
    from skinlab.tui.board import Board, Entry, Live
    from skinlab.tui.order import Order

_UNITS = {"X1_MPa": ("X1", "MPa"), "X2_MPa": ("X2", "MPa"), "nu": ("nu", "")}

_FLAGS = {
    "at_bound": "{} at the edge of its range",
    "not_identifiable": "{} is not fixed by this curve",
    "misfit_above_noise": "misfit above the noise",
    "outside_database": "partly outside the database",
    "not_converged": "not converged",
    "partial_curve": "cut short",
    "not_first_cycle": "not the first loading",
}

_BAR = 12  # cells of the progress bar
_PROGRAM = 24  # cells of a program in the list


def name_of(parameter: str) -> str:
    """Return a parameter's name without its unit."""
    return _UNITS.get(parameter, (parameter, ""))[0]


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


def progress_text(board: Board) -> str:
    """Return how far the program is: points, segment, time."""
    live, entry = board.live, board.entry
    if live is not None:
        lost = f", {live.lost} lost" if live.lost else ""
        return f"{len(live.pressure_mbar)} points{lost}  {_progress(live)}"
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
        f"skin     {setup.thickness_mm:g} mm thick",
        f"program  {setup.program}",
        *([] if setup.program is None else [f"         {program_extent(setup.program)}"]),
        f"cycle    {setup.cycle}",
        f"subject  {who or 'none given'}",
    ]


def program_extent(program: Program) -> str:
    """Return how far and how long a program goes."""
    return f"up to {program.max_pressure_mbar:g} mbar, {program.duration_s:.3g} s"


def card_text(board: Board) -> tuple[str, str]:
    """Return title and text of the panel under the fields: what is armed, or what was found."""
    entry = board.entry
    if entry is None and board.order is not None and board.moving:
        hint = "Space starts, v vents" if board.can_start else "v vents"
        return f"{board.phase}: {hint}", "\n".join(order_lines(board.order))
    if entry is None:
        return "result", "Enter arms, Space starts"
    if entry.result is None:
        return f"curve {entry.index}", "identifying …"
    return f"curve {entry.index}", "\n".join(result_lines(entry.result))


def result_lines(result: Identification) -> list[str]:
    """Return what was identified, in short lines."""
    if result.error is not None:
        return ["not identified:", result.error]
    lines = []
    for name, value in (result.parameters or {}).items():
        label, unit = _UNITS.get(name, (name, ""))
        lines.append(
            f"{label:<5}{digits(value.value, 4):<8}{unit:<5}{interval_text(value)}".rstrip()
        )
        if name == "nu" and result.nu_consistent is not None:
            lines.append(f"{'':<5}{digits(result.nu_consistent, 4):<8}true nu")
    if result.error_um is not None:
        lines.append(f"{'E':<5}{digits(result.error_um, 3):<8}µm")
    if result.rms_um is not None:
        lines.append(f"{'rms':<5}{digits(result.rms_um, 3):<8}µm")
    fitted = 0 if result.fitted is None else int(result.fitted.sum())
    lines.append(f"{fitted} of {result.points} points fitted")
    lines += [f"! {flag_words(flag)}" for flag in result.flags]
    return lines


def digits(value: float, significant: int) -> str:
    """Return the number with all of its significant digits, zeros too."""
    return f"{value:#.{significant}g}".rstrip(".")


def interval_text(value: Value) -> str:
    """Return the interval, or nothing where the method gives none."""
    if value.low is None or value.high is None:
        return ""
    return f"{digits(value.low, 3)} to {digits(value.high, 3)}"


def row_texts(entry: Entry) -> tuple[str, ...]:
    """Return the cells of the list: number, program, cycle, X1, X2, nu, E, remarks."""
    setup: Setup = entry.curve.setup
    result = entry.result
    values = (result.parameters if result is not None else None) or {}
    numbers = [
        digits(values[name].value, 4) if name in values else ""
        for name in ("X1_MPa", "X2_MPa", "nu")
    ]
    error = "" if result is None or result.error_um is None else digits(result.error_um, 3)
    remarks = "" if result is None else ", ".join(flag_words(flag) for flag in result.flags)
    if result is not None and result.error is not None:
        remarks = "not identified"
    program = shortened(str(setup.program))
    return (str(entry.index), program, str(setup.cycle), *numbers, error, remarks)


def shortened(text: str, most: int = _PROGRAM) -> str:
    """Return the text, cut where it is too long for the list."""
    return text if len(text) <= most else text[: most - 1] + "…"
