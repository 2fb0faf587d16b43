"""`skinlab identify`: from curves to parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
    print_json,
)


@click.command(cls=MethodCommand)
@click.argument("inputs", nargs=-1, required=True, type=click.Path(path_type=Path))
@geometry_options(required=False)
@identification_options()
@click.option("--strict", is_flag=True, help="Exit with 5 where a result is not trustworthy.")
@json_option()
def command(
    inputs: tuple[Path, ...],
    aperture_mm: float | None,
    thickness_mm: float | None,
    thickness_sd_mm: float | None,
    strict: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Identify the skin's parameters from INPUTS: curve CSVs, sessions or campaigns.

    A CSV needs --aperture-mm and --thickness-mm. Its header is time_s,pressure_mbar,deflection_mm.

    \b
    Example: skinlab identify curve.csv --aperture-mm 6 --thickness-mm 1.0 --json
    """
    from skinlab.errors import InputError
    from skinlab.identify.result import Identification, document, not_trustworthy
    from skinlab.inputs import read_input
    from skinlab.report.text import describe

    identifier = make_identifier(**options)
    geometry = None
    if aperture_mm is not None and thickness_mm is not None:
        from skinlab.curve import Setup

        geometry = Setup(aperture_mm, thickness_mm, thickness_sd_mm=thickness_sd_mm)
    elif any(path.suffix.lower() == ".csv" for path in inputs):
        raise click.UsageError("a curve CSV needs --aperture-mm and --thickness-mm")
    results: list[Identification] = []
    for path in inputs:
        try:
            for curve in read_input(path, geometry):
                results.append(identifier(curve))
        except InputError as error:
            results.append(Identification(str(path), geometry, str(error)))
    if as_json:
        print_json(document(identifier.provenance(), results))
    else:
        for result in results:
            if result.error is None:
                click.echo(describe(result))
    failed = [r for r in results if r.error is not None]
    for result in failed:
        click.echo(f"skinlab: {result.error}", err=True)
    if any("outside_database" not in r.flags for r in failed):
        return 3
    if failed:
        return 5
    if strict and any(not_trustworthy(r) for r in results):
        click.echo("skinlab: a result is not trustworthy (its flags say why)", err=True)
        return 5
    return 0
