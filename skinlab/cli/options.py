"""Options that several commands share, and how they become objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from drivers.numbers import number_in
from skinlab.cli.method_options import parsed
from skinlab.cli.output import output_kept
from skinlab.cli.paths import PATH
from skinlab.errors import InputError

if TYPE_CHECKING:
    from skinlab.curves.curve import Curve
    from skinlab.inference.identify import Identifier
    from skinlab.mechanics.materials.compressibility import KappaConvention

F = TypeVar("F", bound=Callable[..., Any])

_MOST_WORKERS = 1024


def _stack(*options: Callable[[F], F]) -> Callable[[F], F]:
    def apply(function: F) -> F:
        for option in reversed(options):
            function = option(function)
        return function

    return apply


def control_option() -> Callable[[F], F]:
    """`--control BEFORE AFTER`."""
    return click.option(
        "--control",
        nargs=2,
        type=PATH,
        metavar="BEFORE AFTER",
        help="For a comparison: sessions of a site that was left alone, on the same days.",
    )


def study_option() -> Callable[[F], F]:
    """`--study FOLDER`."""
    return click.option(
        "--study",
        type=PATH,
        help="For a comparison: what `skinlab study` wrote, on how much visits, operators and "
        "placements scatter.",
    )


def geometry_options(required: bool) -> Callable[[F], F]:
    """`--aperture-mm`, `--thickness-mm`, `--thickness-sd-mm`."""
    return _stack(
        click.option(
            "--aperture-mm",
            type=float,
            required=required,
            help="Diameter of the probe's opening: 2, 4, 6 or 8.",
        ),
        click.option(
            "--thickness-mm", type=float, required=required, help="Thickness of the skin."
        ),
        click.option(
            "--thickness-sd-mm",
            type=float,
            help="Standard deviation of the thickness, where it was measured.",
        ),
    )


def identification_options() -> Callable[[F], F]:
    """`--method`, `--samples` and what else all methods have in common.

    The command's class must be `MethodCommand`, which adds what only some methods read.
    """
    from skinlab.inference.methods import METHODS

    return _stack(
        click.option(
            "--method",
            type=click.Choice(METHODS.names()),
            default="auto",
            show_default=True,
            help="Inverse method; sto is the paper's.",
        ),
        click.option("--samples", type=int, help="Candidates in a draw, N.  [default: 1000]"),
        click.option(
            "--best",
            default=20,
            show_default=True,
            help="How many of the best span the next box.",
        ),
        click.option(
            "--tolerance-um",
            default=1e-5,
            show_default=True,
            help="Stop when the error changes by less.",
        ),
        click.option("--seed", default=0, show_default=True, help="Seed of the random draws."),
        kappa_option(),
        click.option(
            "--phases",
            default="load",
            show_default=True,
            help="Which samples to fit: load, hold, unload, rest, separated by commas.",
        ),
        click.option(
            "--model",
            "model_path",
            type=PATH,
            help="MODEL.toml: bounds, priors, and effects in the law.",
        ),
        click.option(
            "--noise-um",
            type=float,
            help="Standard deviation of one deflection sample  [default: estimated].",
        ),
        click.option(
            "--pressure-noise-mbar",
            type=float,
            help="Standard deviation of one pressure sample  [default: estimated].",
        ),
    )


def kappa_option() -> Callable[[F], F]:
    """`--kappa`."""
    return click.option(
        "--kappa",
        type=click.Choice(["paper", "consistent"]),
        default="paper",
        show_default=True,
        help="What ν means: the paper's eq. (3), or linear elasticity.",
    )


def database_option(default: str = "the shipped one") -> Callable[[F], F]:
    """`--database`."""
    return click.option(
        "--database",
        "database_path",
        type=PATH,
        help=f"A file that `skinlab database build` wrote  [default: {default}].",
    )


def data_on_stdout() -> None:
    """Keep standard output for the data of the command that runs, until it ends.

    What others print meanwhile, as a plugin may, goes to standard error.
    """
    click.get_current_context().with_resource(output_kept())


def json_option() -> Callable[[F], F]:
    """`--json`."""

    def keep(ctx: click.Context, parameter: click.Parameter, as_json: bool) -> bool:
        if as_json:
            data_on_stdout()
        return as_json

    return click.option(
        "--json", "as_json", is_flag=True, callback=keep, help="Print one JSON document."
    )


def probe_option(kept: bool = False) -> Callable[[F], F]:
    """`--probe`; `kept`: what is read may have come with one."""
    own = "  [default: the session's own; none leaves it out]" if kept else "."
    return click.option(
        "--probe",
        "probe_path",
        type=PATH,
        help=f"PROBE.toml of `skinlab calibrate`: the errors of this probe{own}",
    )


def read_by(curves: Iterable[Curve], probe_path: Path | None) -> tuple[Curve, ...]:
    """Return curves with the probe file of `--probe`, or without one; None: with their own.

    Raises:
        InputError: the file is wrong.
    """
    from dataclasses import replace

    if probe_path is None:
        return tuple(curves)
    from skinlab.curves.probe_file import read_probe

    probe = None if str(probe_path) == "none" else read_probe(probe_path)
    return tuple(replace(curve, probe=probe) for curve in curves)


def prior_options(site: bool) -> Callable[[F], F]:
    """`--prior`, `--age-years`, `--site` where the command has none, for `with_prior_option`."""
    return _stack(
        click.option(
            "--prior",
            "prior_path",
            type=PATH,
            help="STUDY.toml of `skinlab study`: what is known of such people.",
        ),
        click.option("--age-years", type=float, help="Age of the person."),
        *([click.option("--site", help="Where on the body.")] if site else []),
    )


def reference_options() -> Callable[[F], F]:
    """`--reference` and `--sex`."""
    return _stack(
        click.option(
            "--reference",
            "reference_path",
            type=PATH,
            help="REFERENCE.toml: say at which percentile a value stands.",
        ),
        click.option("--sex", type=click.Choice(["f", "m"]), help="For --reference."),
    )


def with_prior_option(
    identifier: Any, prior_path: Path | None, site: str | None, age_years: float | None
) -> Any:
    """Return the identifier with the population of `--prior`.

    Raises:
        InputError: the file is wrong, or does not fit.
    """
    if prior_path is None:
        return identifier
    from skinlab.inference.population import read_prior, with_prior

    return with_prior(identifier, read_prior(prior_path, site or None, age_years))


def parse_phases(text: str) -> tuple[str, ...]:
    """Return the phases of `--phases`.

    Raises:
        click.BadParameter: one of them does not exist.
    """
    from skinlab.api.identifiers import read_phases

    try:
        return read_phases(text)
    except InputError as error:
        raise click.BadParameter(str(error), param_hint="--phases") from None


def make_identifier(
    *,
    method: str,
    samples: int | None = None,
    best: int,
    tolerance_um: float,
    seed: int,
    kappa: KappaConvention,
    phases: str,
    noise_um: float | None = None,
    pressure_noise_mbar: float | None = None,
    model_path: Path | None = None,
    database_path: Path | None = None,
    probe_path: Path | None = None,
    **single: Any,
) -> Identifier:
    """Return the Identifier that the options describe; `single` are those of single methods.

    Raises:
        click.UsageError: the method does not read one of its options.
        InputError: an option is out of its range.
    """
    from skinlab.api.identifiers import compose_identifier

    return compose_identifier(
        method=method,
        samples=samples,
        best=best,
        tolerance_um=tolerance_um,
        seed=seed,
        kappa=kappa if was_said("kappa") else None,
        phases=parse_phases(phases) if was_said("phases") else None,
        noise_um=noise_um,
        pressure_noise_mbar=pressure_noise_mbar,
        model=model_path,
        database=database_path,
        probe=probe_path,
        **parsed(method, samples, single),
    )


def was_said(option: str) -> bool:
    """Return whether the user gave an option, rather than its default."""
    context = click.get_current_context(silent=True)
    if context is None:
        return False
    return context.get_parameter_source(option) not in (None, ParameterSource.DEFAULT)


def workers_option(says: str = "", default: int | None = None) -> Callable[[F], F]:
    """`--workers`: how many processes, one for every core without a default."""
    return click.option(
        "--workers",
        type=click.INT,
        callback=_check_workers,
        default=default,
        metavar="N",
        help=f"Processes{says}  [default: {default or 'one a core'}].",
    )


def _check_workers(
    context: click.Context, option: click.Parameter, workers: int | None
) -> int | None:
    if workers is not None and not 1 <= workers <= _MOST_WORKERS:
        raise InputError(f"workers {workers}: expected 1–{_MOST_WORKERS}")  # as from Python
    return workers


def placement_scatter_option(
    begin: str = "How", default: str = "as the campaign says, else auto"
) -> Callable[[F], F]:
    """`--placement-scatter`; `inference.batch.scatter_of` takes it."""
    return click.option(
        "--placement-scatter",
        metavar="auto|NUMBER",
        callback=_read_scatter,
        help=f"{begin} much stiffness scatters between placements of the probe, 0.05 for 5 %; "
        f"auto learns it, 0 is none  [default: {default}].",
    )


def _read_scatter(
    context: click.Context, option: click.Parameter, text: str | None
) -> float | str | None:
    if text in (None, "auto"):
        return text
    from skinlab.curves.campaign import range_missed  # slow to import

    try:
        value = number_in(text)
    except ValueError:
        raise click.BadParameter(f"{text}: expected auto, or 0 to below 1") from None
    if range_missed("placement_scatter", value) is not None:
        raise InputError(f"placement_scatter {text}: expected auto, or 0 to below 1")
    return value


def dialect_option() -> Callable[[F], F]:
    """`--dialect`: what the instrument speaks."""
    return click.option(
        "--dialect",
        metavar="NAME|FILE.toml",
        help="What the instrument speaks [default: as the port's ?dialect= says, or reference].",
    )
