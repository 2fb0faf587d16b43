"""What is written on the screen around a curve: the header, the program, what goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

from drivers.capabilities import READ_ONLY
from drivers.dose import Dose
from drivers.events import Sample
from skinlab.curves.curve import Setup
from skinlab.curves.program import Hold, Program, Ramp, Release, Segment, Until
from skinlab.inference.result import Value
from skinlab.mechanics.names import effect_words, unit_of
from skinlab.recording.curve_selection import Deed
from skinlab.report.rounding import interval_words
from skinlab.tui.shown import Live, Playing
from skinlab.tui.ui_state import SEARCHING, Board
from skinlab.tui.value_text import name_of, shortened

if TYPE_CHECKING:
    from skinlab.acquisition.measurement_request import Order
    from skinlab.discrepancy.outcome import Outcome


_BAR = 12  # cells of the progress bar


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
    if board.suction and board.out_of_reach:
        return "SUCTION? no link"
    if board.suction:
        return "SUCTION: v vents" if board.streaming else "SUCTION? v vents"
    if board.read_only and board.latest is None:  # some send nothing before they are started
        return "no reading yet"
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


def timeline_text(playing: Playing) -> str:
    """Return where a replay is, and at what speed."""
    share = playing.at_s / playing.length_s if playing.length_s > 0 else 1.0
    speed = "max" if playing.speed is None else f"{playing.speed:g}"
    sign = "■" if playing.ended else "‖" if playing.paused else "►"
    bar = _bar(round(_BAR * share))
    return f"{sign} x{speed} {playing.at_s:.1f}/{playing.length_s:.1f} s {bar}"


def _bar(filled: int) -> str:
    return "█" * filled + "░" * (_BAR - filled)


def link_text(board: Board) -> str:
    """Return how the link does."""
    if board.playing is not None:
        return ""
    if board.hello is None:
        return "no link"
    if board.doing == SEARCHING:
        return "LINK LOST"
    return f"{board.damaged} damaged frames" if board.damaged else "link ok"


def state_text(board: Board) -> str:
    """Return what was read last, how far the program is, and how the link does."""
    texts = [last_text(board), progress_text(board), link_text(board)]
    if board.doing == SEARCHING:  # what matters most is not what a narrow line cuts off
        texts.reverse()
    return "  ".join(text for text in texts if text)


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
    return f"{done:.1f}/{whole:.1f} s {_bar(filled)} part {number} of {len(program.segments)}"


def order_lines(
    order: Order,
    *,
    assumed_thickness: bool = False,
    counted: int | None = None,
    placed: str = "",
) -> list[str]:
    """Return what will happen, for a last look before the start.

    `counted` is which loading of the site this is by what the program has seen, `placed` whether
    the probe sits as before.
    """
    setup, program = order.setup, order.setup.program
    assumed = " (default, not measured)" if assumed_thickness else ""
    repeats = f"{order.repeats}, {order.rest_s:g} s rest between" if order.repeats > 1 else "once"
    loading = f"loading  {setup.cycle} of this site{_as_stated(setup.cycle, counted)}"
    return [
        f"subject  {order.subject or 'NONE GIVEN'}",
        f"site     {order.site or 'none given'}",
        f"opening  {setup.aperture_mm:g} mm",
        f"skin     {_thickness(setup)} thick{assumed}",
        f"program  {shortened(str(program), _MOST_PROGRAM)}",
        *([] if program is None else [f"         {program_words(program)}"]),
        *([] if program is None else [f"peak     {program_extent(program)}"]),
        ", ".join(filter(None, (loading, placed))),
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


def undone_words(deed: Deed) -> str:
    """Return what taking a decision back comes to."""
    match deed.what:
        case "note":
            return f"the note “{deed.text}” is struck out"
        case "curve excluded":
            return f"curve {deed.curve} is used again"
        case _:
            return f"curve {deed.curve} is left out again"
