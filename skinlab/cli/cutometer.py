"""`skinlab cutometer`: the Cutometer's own numbers of step curves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.options import json_option
from skinlab.cli.output import echo, echo_text, print_json
from skinlab.cli.paths import PATH
from skinlab.text import inert

if TYPE_CHECKING:
    from skinlab.curves.curve import Setup
    from skinlab.curves.cutometer import Number, StepNumbers

SCHEMA = "skinlab.cutometer/1"


@click.command()
@click.argument("inputs", nargs=-1, required=True, type=PATH)
@click.option("--aperture-mm", type=float, help="Diameter of the probe's opening, to be noted.")
@click.option("--thickness-mm", type=float, help="Thickness of the skin, to be noted.")
@click.option("--program", help="Of CSVs, e.g. mode1:450,2,2,5: their pressure must agree.")
@json_option()
def command(
    inputs: tuple[Path, ...],
    aperture_mm: float | None,
    thickness_mm: float | None,
    program: str | None,
    as_json: bool,
) -> int:
    """Print Ue, Uv, Uf, Ur, Ua and R0 to R9 of step curves (mode 1), each with its formula.

    INPUTS: curve CSVs, sessions or campaigns. The elastic part is read at 0.1 s, and beside it at
    the bend of the curve. None of the numbers needs the aperture or the thickness.

    \b
    Example: skinlab cutometer step.csv --program mode1:450,2,2,5 --json
    """
    from skinlab.curves.curve import Setup
    from skinlab.curves.cutometer import step_numbers
    from skinlab.curves.program import parse_program
    from skinlab.errors import InputError
    from skinlab.recording.load_inputs import read_input

    asked = None if program is None else parse_program(program)
    # A CSV does not say what it was measured with, and nothing here depends on it.
    setup = Setup(
        6.0 if aperture_mm is None else aperture_mm,
        1.0 if thickness_mm is None else thickness_mm,
        asked,
    )
    stated = (aperture_mm, thickness_mm)
    found: list[tuple[str, tuple[float | None, float | None], StepNumbers | InputError]] = []
    for path in inputs:
        try:
            given = read_input(path, setup)
        except InputError as error:
            found.append((str(path), stated, error))
            continue
        noise_mm = None if given.noise_um is None else 1e-3 * given.noise_um
        for curve in given.curves:
            geometry = stated if curve.setup is setup else _geometry(curve.setup)
            try:
                found.append((curve.name, geometry, step_numbers(curve, noise_mm)))
            except InputError as error:
                found.append((curve.name, geometry, error))
    if as_json:
        print_json({"schema": SCHEMA, "curves": [_to_json(*entry) for entry in found]})
    else:
        texts = [_describe(result) for _, _, result in found if not isinstance(result, InputError)]
        if texts:
            echo_text("\n\n".join(texts))
    failed = [result for _, _, result in found if isinstance(result, InputError)]
    for failure in failed:
        echo(f"skinlab: {failure}", err=True)
    return 3 if failed else 0


def _geometry(setup: Setup) -> tuple[float, float]:
    return setup.aperture_mm, setup.thickness_mm


def _to_json(name: str, geometry: tuple[float | None, float | None], result: Any) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "file": name,
        "error": None,
        "aperture_mm": geometry[0],
        "thickness_mm": geometry[1],
        "pulses": [],
        "noise_um": None,
        "interval_s": None,
        "numbers": None,
        "inflection": None,
        "flags": [],
    }
    if isinstance(result, Exception):
        return entry | {"error": str(result)}
    return entry | {
        "pulses": [
            {
                "start_s": p.start_s,
                "stop_s": p.stop_s,
                "end_s": p.end_s,
                "rise_s": p.rise_s,
                "fall_s": p.fall_s,
                "pressure_mbar": p.pressure_mbar,
            }
            for p in result.pulses
        ],
        "noise_um": 1e3 * result.noise_mm,
        "interval_s": result.interval_s,
        "numbers": {n: _number(v) for n, v in result.numbers.items()},
        "inflection": {
            "time_s": result.bend_s,
            "reason": result.bend_reason,
            "numbers": {n: _number(v) for n, v in result.at_bend.items()},
        },
        "flags": list(result.flags),
    }


def _number(number: Number) -> dict[str, Any]:
    return {
        "value": number.value,
        "sd": number.sd,
        "unit": number.unit,
        "formula": number.formula,
        "reason": number.reason,
    }


def _describe(result: StepNumbers) -> str:
    first = result.pulses[0]
    lines = [
        f"{inert(result.name)}  ({len(result.pulses)} pulse{'s' * (len(result.pulses) > 1)} of "
        f"{first.pressure_mbar:.4g} mbar, {first.stop_s - first.start_s:.3g} s on; start is "
        f"t = {first.start_s:.3g} s; noise {1e3 * result.noise_mm:.2g} µm)"
    ]
    lines += [_line(name, number) for name, number in result.numbers.items()]
    if result.bend_s is None:
        lines.append(f"  at the inflection: none, {result.bend_reason}")
    else:
        lines.append(f"  at the inflection, {result.bend_s:.3g} s after the start:")
        lines += [_line(name, number) for name, number in result.at_bend.items()]
    if result.flags:
        lines.append(f"  flags: {', '.join(result.flags)}")
    return "\n".join(lines)


def _line(name: str, number: Number) -> str:
    if number.value is None:
        return f"  {name:<3}{'none':>9}{'':16}{number.formula}  ({number.reason})"
    unit = "mm" if number.unit == "mm" else "  "
    return f"  {name:<3}{number.value:9.4f} ± {number.sd:<8.4f}{unit}   {number.formula}"
