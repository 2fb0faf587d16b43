"""`skinlab forward`: a simulated curve."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.law_options import LawCommand, law_values
from skinlab.cli.options import database_option, kappa_option, was_said
from skinlab.cli.output import echo, echo_text

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
    type=click.Path(path_type=Path),
    help="MODEL.toml: its effects act on the curve; physical ones imply --direct.",
)
@database_option()
@click.option("--cycle", default=1, show_default=True, help="1: first loading of the site.")
@click.option(
    "--csv",
    "csv_path",
    type=click.Path(path_type=Path),
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

    \b
    Example: skinlab forward --direct --x1-mpa 0.03 --x2-mpa 1.0 --nu 0.32 \\
             --aperture-mm 6 --thickness-mm 1 --program ramp:100@20 --csv curve.csv
    """
    from skinlab.curves.csv import write_curve
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.errors import InputError
    from skinlab.io.files import write_file
    from skinlab.mechanics.fem.skin import Skin
    from skinlab.mechanics.materials import DEFAULT_LAW, get_law
    from skinlab.mechanics.model_file import read_model
    from skinlab.tables.forward import simulate, simulate_from
    from skinlab.tables.store import read

    if csv_path is not None and csv_path.is_file() and not force:
        raise InputError(f"{csv_path}: exists already; --force replaces it")
    if database_path is not None and direct:
        raise click.UsageError("--database answers, or --direct: not both")
    setup = Setup(aperture_mm, thickness_mm, parse_program(program), cycle=cycle)
    table = None if database_path is None else read(database_path)
    effects = {}
    said = was_said("kappa")
    if model_path is not None:
        model = read_model(model_path)
        if said and kappa != model.model.kappa:
            raise InputError(
                f"{model_path}: kappa is {model.model.kappa!r}, and --kappa says {kappa!r}"
            )
        if law is not None and law != model.model.law:
            raise InputError(f"{model_path}: law is {model.model.law!r}, and --law says {law!r}")
        law, kappa, effects, said = model.model.law, model.model.kappa, model.values, True
    if table is not None:
        law = table.law if law is None else law
        own = table.spec.model
        if own is not None and not said:
            kappa = own.model.kappa
    law = DEFAULT_LAW if law is None else law
    get_law(law)
    skin = Skin(law_values(law, values), kappa, law)
    if table is not None:
        curve, warning = simulate_from(table, skin, effects, setup, rate_hz)
    else:
        curve, warning = simulate(skin, setup, rate_hz, direct=direct, effects=effects)
    text = io.StringIO()
    write_curve(text, curve)
    if csv_path is None:
        echo_text(text.getvalue().rstrip("\n"))
    else:
        write_file(csv_path, text.getvalue(), replace=True)
    if warning:
        echo(f"skinlab: {warning}", err=True)
        return 5
    return 0
