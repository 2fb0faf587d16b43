"""What a report says of one curve: a row of the overview, and a section of its own."""

from __future__ import annotations

from collections.abc import Sequence

from skinlab.curves.program import Program
from skinlab.inference.stored_results import StoredValue
from skinlab.mechanics.materials.base import KAPPA, NU_CONSISTENT
from skinlab.mechanics.names import heading, label, of_law, unit_of
from skinlab.report.flags import explanations, signed
from skinlab.report.measured import Measured
from skinlab.report.page import Illustration, Section, Table
from skinlab.report.text import errors_in_words
from skinlab.report.verdict import FOR_EFFECT

_DERIVED = {NU_CONSISTENT: ("ν of linear elasticity", ""), KAPPA: ("κ", "MPa")}


def overview_table(curves: Sequence[Measured]) -> Table:
    """Return a row for each curve."""
    names = of_law(m.result.parameters or () for m in curves if m.result)
    header = (
        "curve", "name", "opening on skin, program, cycle", *map(heading, names), "rms (µm)",
        "flags",
    )  # fmt: skip
    return Table(header, [_overview_row(m, names) for m in curves])


def _overview_row(measured: Measured, names: Sequence[str]) -> tuple[str, ...]:
    setup, result = measured.curve.setup, measured.result
    values = (result.parameters if result else None) or {}
    gates = [finding.gate for finding in measured.judged.findings]
    flags = list(dict.fromkeys([*(result.flags if result else ()), *gates]))
    if result is None or result.error is not None:
        flags.insert(0, "not identified")
    elif measured.curve.partial and "partial_curve" not in flags:
        flags.append("partial_curve")
    return (
        str(measured.number),
        measured.curve.name,
        f"{setup.aperture_mm:g} on {setup.thickness_mm:g} mm, "
        f"{_program(setup.program).replace(',', ', ')}, cycle {setup.cycle}",  # may break there
        *(_with_interval(values.get(name)) for name in names),
        _number(result.rms_um if result else None, 3),
        ", ".join(flags) or "none",
    )


def curve_section(measured: Measured, figures: Sequence[Illustration]) -> Section:
    """Return all that is said of one curve."""
    curve, result, fit = measured.curve, measured.result, measured.fit
    paragraphs = [f"{curve.name}: {_setup_words(measured)}"]
    if curve.partial:
        why = f": {measured.judged.cut}" if measured.judged.cut else ""
        paragraphs.append(f"The curve was cut short{why}.")
    if measured.for_effect:
        paragraphs.append(f"It was measured as was advised: {FOR_EFFECT}.")
    elif measured.advised:
        paragraphs.append(f"It was measured as was advised for a goal: {measured.advised}.")
    if isinstance(fit, str):
        paragraphs.append(fit)
    elif fit.remark:
        paragraphs.append(fit.remark)
    points = explanations(measured)
    if not points and result is not None:
        paragraphs.append("No flags: nothing was found to be wrong with this curve.")
    tables = []
    if result is not None and result.parameters:
        tables = [_values_table(measured), _quality_table(measured)]
        if result.correlation is not None and result.order:
            names = [label(name) for name in result.order]
            rows = [
                (name, *(signed(value) for value in row))
                for name, row in zip(names, result.correlation, strict=True)
            ]
            tables.append(Table(("correlation", *names), rows))
    return Section(f"Curve {measured.number}", paragraphs, tables, figures, points)


def _setup_words(measured: Measured) -> str:
    curve, setup = measured.curve, measured.curve.setup
    sd = "" if setup.thickness_sd_mm is None else f" ± {setup.thickness_sd_mm:g}"
    placed = "" if setup.placement is None else f", placement {setup.placement}"
    lasted = ""
    if len(curve):
        lasted = (
            f" over {curve.time_s[-1] - curve.time_s[0]:.4g} s, up to "
            f"{curve.pressure_mbar.max():.1f} mbar and {curve.deflection_mm.max():.3f} mm"
        )
    return (
        f"{setup.aperture_mm:g} mm opening, {setup.thickness_mm:g}{sd} mm of skin, program "
        f"{_program(setup.program)}, loading {setup.cycle} of the site, repeat {setup.repeat}"
        f"{placed}; {len(curve)} samples{lasted}."
    )


def _values_table(measured: Measured) -> Table:
    result = measured.result
    assert result is not None
    rows = [
        (
            label(name),
            _number(value.value, 4),
            _number(value.low, 4),
            _number(value.high, 4),
            unit_of(name),
        )
        for name, value in (result.parameters or {}).items()
    ]
    for name, number in result.derived.items():
        if number is not None:
            called, unit = _DERIVED.get(name, (name, ""))
            rows.append((called, _number(number, 4), "", "", unit))
    return Table(("parameter", "value", "90 % from", "to", "unit"), rows)


def _quality_table(measured: Measured) -> Table:
    result, fit = measured.result, measured.fit
    assert result is not None
    said, left_out = result.error_model, ", ".join(str(i + 1) for i in result.outliers)
    rows = [
        ("E, the paper's error (µm)", _number(result.error_um, 3)),
        ("rms residual (µm)", _number(result.rms_um, 3)),
        ("noise of one deflection sample (µm)", _number(result.noise_um, 3)),
        *([] if said is None else [("errors of the samples", errors_in_words(said))]),
        ("samples fitted", f"{result.fitted_points} of {result.points}"),
        *([("left out as glitches, samples", left_out)] if left_out else []),
        ("phases fitted", ", ".join(result.phases)),
        ("iterations", str(result.iterations)),
        ("evaluations of the model", str(result.evaluations)),
    ]
    if not isinstance(fit, str) and fit.within is not None:
        rows.insert(3, ("residuals inside twice the noise", f"{100 * fit.within:.0f} %"))
    return Table(("fit", "value"), rows)


def _with_interval(value: StoredValue | None) -> str:
    if value is None:
        return "–"
    if value.low is None or value.high is None:
        return _number(value.value, 4)
    ends = f"{_number(value.low, 3)} to {_number(value.high, 3)}"
    return f"{_number(value.value, 4)} ({ends})".replace(
        " to ", "\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}"
    )


def _number(value: float | None, significant: int) -> str:
    return "–" if value is None else f"{value:#.{significant}g}".rstrip(".")


def _program(program: Program | None) -> str:
    return "not known" if program is None else str(program)
