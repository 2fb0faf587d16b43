"""Options that several commands share, and how they become objects."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from skinlab.cli.method_options import method_options, single_settings

if TYPE_CHECKING:
    from skinlab.mechanics.model_file import Model

F = TypeVar("F", bound=Callable[..., Any])

METHODS = ("auto", "sto", "hka", "gn", "gn-linesearch", "rls", "lm")


def _stack(*options: Callable[[F], F]) -> Callable[[F], F]:
    def apply(function: F) -> F:
        for option in reversed(options):
            function = option(function)
        return function

    return apply


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
            "--thickness-sd-mm", type=float, help="Its standard deviation, where measured."
        ),
    )


def identification_options() -> Callable[[F], F]:
    """`--method`, `--samples`, `--best`, … and what only one method reads.

    The command's class must be `MethodCommand`.
    """
    return _stack(
        click.option(
            "--method",
            type=click.Choice(METHODS),
            default="auto",
            show_default=True,
            help="Inverse method; sto is the paper's.",
        ),
        click.option("--samples", type=int, help="Candidates a draw, N.  [default: 1000]"),
        click.option("--best", default=20, show_default=True, help="Of these span the next box."),
        click.option(
            "--tolerance-um", default=1e-5, show_default=True, help="Ends when E changes less."
        ),
        click.option("--seed", default=0, show_default=True, help="Of the random draws."),
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
            type=click.Path(path_type=Path),
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
            help="The same of one pressure sample  [default: estimated].",
        ),
        *method_options(),
    )


def kappa_option() -> Callable[[F], F]:
    """`--kappa`."""
    return click.option(
        "--kappa",
        type=click.Choice(["paper", "consistent"]),
        default="paper",
        show_default=True,
        help="What nu means: eq. (3) as printed, or linear elasticity.",
    )


def database_option() -> Callable[[F], F]:
    """`--database`."""
    return click.option(
        "--database",
        "database_path",
        type=click.Path(path_type=Path),
        help="A file that `skinlab database build` wrote  [default: the shipped one].",
    )


def json_option() -> Callable[[F], F]:
    """`--json`."""
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")


def prior_options(site: bool) -> Callable[[F], F]:
    """`--prior`, `--age-years`, and `--site` where the command has none; `prior_of` takes them."""
    return _stack(
        click.option(
            "--prior",
            "prior_path",
            type=click.Path(path_type=Path),
            help="STUDY.toml of `skinlab study`: what is known of such people.",
        ),
        click.option("--age-years", type=float, help="Of the person."),
        *([click.option("--site", help="Where on the body.")] if site else []),
    )


def reference_options() -> Callable[[F], F]:
    """`--reference` and `--sex`."""
    return _stack(
        click.option(
            "--reference",
            "reference_path",
            type=click.Path(path_type=Path),
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
    from skinlab.inference.population import read_prior, with_prior

    if prior_path is None:
        return identifier
    return with_prior(identifier, read_prior(prior_path, site or None, age_years))


def parse_phases(text: str) -> tuple[str, ...]:
    """Return the phases of `--phases`.

    Raises:
        click.BadParameter: one of them does not exist.
    """
    phases = tuple(part.strip() for part in text.split(",") if part.strip())
    known = ("load", "hold", "unload", "rest")
    for phase in phases:
        if phase not in known:
            raise click.BadParameter(
                f"{phase!r} is no phase; expected of {', '.join(known)}", param_hint="--phases"
            )
    if not phases:
        raise click.BadParameter("names no phase", param_hint="--phases")
    return phases


def make_identifier(
    *,
    method: str,
    samples: int | None = None,
    best: int,
    tolerance_um: float,
    seed: int,
    kappa: str,
    phases: str,
    noise_um: float | None = None,
    pressure_noise_mbar: float | None = None,
    model_path: Path | None = None,
    database_path: Path | None = None,
    **single: Any,
) -> Any:
    """Return the Identifier that the options describe; `single` are those of single methods.

    Raises:
        click.UsageError: the method does not read one of its options.
        InputError: an option is out of its range.
    """
    from skinlab.errors import InputError
    from skinlab.inference.custom_table import with_own_database
    from skinlab.inference.identify import Identifier
    from skinlab.inference.problem import Options, check
    from skinlab.inference.uncertainty import Sensor
    from skinlab.mechanics.model_file import read_model
    from skinlab.tables.model_database import ModelDatabase
    from skinlab.tables.store import read_database, shipped_table

    options = Options(
        best=best, tolerance_um=tolerance_um, **single_settings(method, samples, single)
    )
    check(options)
    if seed < 0:
        raise InputError(f"seed {seed}: expected zero or more")
    if noise_um is not None and not 0 < noise_um < 1e6:
        raise InputError(f"noise_um {noise_um:g}: expected a positive number")
    if pressure_noise_mbar is not None and not 0 <= pressure_noise_mbar < 1e3:
        raise InputError(f"pressure_noise_mbar {pressure_noise_mbar:g}: expected zero or more")
    identifier = Identifier(
        shipped_table() if database_path is None else read_database(database_path),
        method=method,
        options=options,
        seed=seed,
        kappa="consistent" if kappa == "consistent" else "paper",
        phases=parse_phases(phases),
        sensor=Sensor(noise_um, pressure_noise_mbar),
    )
    model = None if model_path is None else read_model(model_path)
    database = identifier.database
    if isinstance(database, ModelDatabase):
        own = database.spec.model
        if model is not None and model.hash != own.hash:
            raise InputError(
                f"{database_path}: built for the model {own.model.name!r}, and {model_path} is "
                "another; build a database of that, or leave --database out"
            )
        _check_kappa(database_path, own, kappa)
        return with_own_database(identifier, database, phases_said=was_said("phases"))
    if model is None:
        return identifier
    from skinlab.discrepancy.model_identifier import with_model

    _check_kappa(model_path, model, kappa)
    return with_model(identifier, model)


def _check_kappa(path: Path | None, model: Model, kappa: str) -> None:
    from skinlab.errors import InputError

    if was_said("kappa") and kappa != model.model.kappa:
        raise InputError(f"{path}: kappa is {model.model.kappa!r}, and --kappa says {kappa!r}")


def was_said(option: str) -> bool:
    """Return whether the user gave an option, rather than its default."""
    context = click.get_current_context(silent=True)
    if context is None:
        return False
    return context.get_parameter_source(option) not in (None, ParameterSource.DEFAULT)


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document; nothing in it may be NaN or infinite."""
    json.dump(document, sys.stdout, indent=1, allow_nan=False)
    sys.stdout.write("\n")
