"""One result in a few lines of plain text, for a terminal; and what an operator must hear."""

from __future__ import annotations

from drivers.events import Alarm, Event, LinkLost, LinkRestored
from skinlab.identify.result import Identification

_UNITS = {"X1_MPa": ("X1", "MPa"), "X2_MPa": ("X2", "MPa"), "nu": ("nu", "")}


def describe(result: Identification) -> str:
    """Return the text."""
    lines = [result.file]
    if result.setup is not None:
        fitted = 0 if result.fitted is None else int(result.fitted.sum())
        lines[0] += (
            f"  ({result.setup.aperture_mm:g} mm opening, {result.setup.thickness_mm:g} mm skin; "
            f"{fitted} of {result.points} samples fitted: {', '.join(result.phases)})"
        )
    if result.error is not None:
        lines.append(f"  not identified: {result.error}")
    for name, value in (result.parameters or {}).items():
        label, unit = _UNITS.get(name, (name, ""))
        text = f"  {label:<4}{value.value:10.4g} {unit:<4}"
        if value.low is not None and value.high is not None:
            text += f"90 % interval {value.low:.4g} to {value.high:.4g}"
        if name == "nu" and result.nu_consistent is not None:
            text += f"(linear elasticity's nu: {result.nu_consistent:.3f})"
        lines.append(text.rstrip())
    if result.error_um is not None and result.rms_um is not None:
        lines.append(f"  E   {result.error_um:10.3g} µm   rms residual {result.rms_um:.3g} µm")
    if result.flags:
        lines.append(f"  flags: {', '.join(result.flags)}")
    return "\n".join(lines)


def outage_words(event: Event) -> str | None:
    """Return the sentence for an event of which the operator must know at once, else None."""
    match event:
        case LinkLost(reason):
            return f"{reason}; looking for it"
        case LinkRestored(outage_s):
            return (
                f"the link is back after {outage_s:.1f} s; a curve that it cut is kept as a "
                "partial one, and taken again"
            )
        case Alarm(text):
            return f"ALARM: {text}"
        case _:
            return None
