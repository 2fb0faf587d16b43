"""One result in a few lines of plain text, for a terminal."""

from __future__ import annotations

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
