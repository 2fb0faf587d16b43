"""`skinlab forward`: a simulated curve."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.law_options import LawCommand, law_values
from skinlab.cli.options import data_on_stdout, database_option, kappa_option, was_said
from skinlab.cli.output import echo, echo_text
from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from skinlab.mechanics.materials.compressibility import KappaConvention


@click.command(cls=LawCommand)
@click.option("--aperture-mm", type=float, required=True, help="Opening's diameter: 2, 4, 6, 8.")
@click.option("--thickness-mm", type=float, required=True, help="Thickness of the skin.")
@click.option("--program", required=True, help="What the pump does, e.g. ramp:100@20.")
@click.option("--law", help="The constitutive law  [default: the model's, the database's]")
@kappa_option()
@click.option("--rate-hz", default=20.0, show_default=True, help="Samples a second.")
@click.option("--direct", is_flag=True, help="Run the finite elements; else the database answers.")
@click.option(
    "--model",
    "model_path",
    type=PATH,
    help="MODEL.toml: its effects act on the curve; physical ones imply --direct.",
)
@database_option()
@click.option("--cycle", default=1, show_default=True, help="1: first loading of the site.")
@click.option(
    "--csv",
    "csv_path",
    type=PATH,
    help="Write to this new file; one that is there is kept, unless --force is given.",
)
@click.option("--force", is_flag=True, help="Let --csv replace a file.")
def command(
    aperture_mm: float,
    thickness_mm: float,
    program: str,
    law: str | None,
    kappa: KappaConvention,
    rate_hz: float,
    direct: bool,
    model_path: Path | None,
    database_path: Path | None,
    cycle: int,
    csv_path: Path | None,
    force: bool,
    **values: Any,
) -> int:
    """Simulate the curve of a skin and print it as CSV.

    Where the skin creases at the tape's edge the finite elements go on with a blunter edge, and say
    so on standard error; where the model ends before the program does the exit status is 5.

    \b
    Example: skinlab forward --direct --x1-mpa 0.03 --x2-mpa 1.0 --nu 0.32 \\
             --aperture-mm 6 --thickness-mm 1 --program ramp:100@20 --csv curve.csv
    """
    from skinlab.api.simulation import simulated
    from skinlab.curves.csv import write_curve
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.errors import InputError
    from skinlab.io.files import write_file

    data_on_stdout()
    if csv_path is not None and csv_path.is_file() and not force:
        raise InputError(f"{csv_path}: exists already; --force replaces it")
    if database_path is not None and direct:
        raise click.UsageError("--database answers, or --direct: not both")
    setup = Setup(aperture_mm, thickness_mm, parse_program(program), cycle=cycle)
    curve, warning = simulated(
        setup,
        lambda name: law_values(name, values),
        law=law,
        kappa=kappa if was_said("kappa") else None,
        rate_hz=rate_hz,
        direct=direct,
        model=model_path,
        database=database_path,
    )
    text = io.StringIO()
    write_curve(text, curve)
    if csv_path is None:
        echo_text(text.getvalue().rstrip("\n"))
    else:
        write_file(csv_path, text.getvalue(), replace=True)
    if warning:
        echo(f"skinlab: {warning}", err=True)
    assert setup.program is not None
    ends_early = curve.time_s[-1] + 1.0 / rate_hz <= setup.program.duration_s
    return 5 if ends_early else 0
