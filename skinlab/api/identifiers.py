"""An Identifier from what a user says: database, model, method and options in one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from skinlab.api.arguments import checked
from skinlab.api.paths import PathLike, as_path
from skinlab.curves.campaign import range_missed
from skinlab.curves.probe_file import check_counted_once, read_probe
from skinlab.curves.program import Phase
from skinlab.errors import InputError
from skinlab.inference.custom_table import with_custom_table
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import METHODS, get_method
from skinlab.inference.problem import Options, check
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_file import Model, read_model
from skinlab.plugins import warn
from skinlab.tables.store import read, shipped_table
from skinlab.tables.table import NOT_MEASURED, Table

PHASES = get_args(Phase)


def read_phases(phases: str | Sequence[str]) -> tuple[str, ...]:
    """Return phases, also of a text that separates them by commas.

    Raises:
        InputError: one of them does not exist, or there is none.
    """
    parts = phases.split(",") if isinstance(phases, str) else phases
    found = tuple(dict.fromkeys(part.strip() for part in parts if part.strip()))
    for phase in found:
        if phase not in PHASES:
            raise InputError(
                f"{phase!r} is not a phase; expected one or more of {', '.join(PHASES)}"
            )
    if not found:
        raise InputError("names no phase")
    return found


def settle_options(
    method: str, options: Options, samples: int | None, own: Mapping[str, Any]
) -> Options:
    """Return the options with N and those that are this method's own, by name.

    Raises:
        InputError: the method does not read one of them, N is given twice, or one is out of range.
    """
    chosen = get_method(method)
    declared = {option.name: option for option in chosen.options}
    said = {}
    for name, value in own.items():
        if name not in declared:
            readers = [m.name for m in METHODS.all() if name in {o.name for o in m.options}]
            whose = f"belongs to method {' or '.join(readers)}" if readers else "is not an option"
            raise InputError(f"{name} {whose}; {method} does not read it")
        if declared[name].instead_of == "samples" and samples is not None:
            raise InputError(f"{name} gives the number of samples; leave samples out")
        with METHODS.at_work(method):
            said[name] = declared[name].checked(value)
    if samples is not None:
        options = replace(options, samples=samples)
    options = options.having(**said)
    with METHODS.at_work(method):
        chosen.check(options)
        options = chosen.settle(options)
    check(options)
    return options


@checked
def compose_identifier(
    *,
    method: str = "auto",
    samples: int | None = None,
    best: int = 20,
    tolerance_um: float = 1e-5,
    seed: int = 0,
    kappa: KappaConvention | None = None,
    phases: str | Sequence[str] | None = None,
    noise_um: float | None = None,
    pressure_noise_mbar: float | None = None,
    model: PathLike | Model | None = None,
    prior: PathLike | None = None,
    site: str | None = None,
    age_years: float | None = None,
    probe: PathLike | None = None,
    database: PathLike | Table | None = None,
    **own: Any,
) -> Identifier:
    """Return the Identifier of these settings; `own` are options of the method alone.

    kappa, phases: None: those of the model or database, else paper, and load. model: a MODEL.toml.
    database: a file of `skinlab database build`; None: the shipped one. prior: a study.toml, of
    this site and age; None: as wide as all of them. probe: a PROBE.toml of `skinlab calibrate`.

    Raises:
        InputError: a setting is out of its range, or two contradict each other.
    """
    if prior is None and (site, age_years) != (None, None):
        raise InputError("site and age_years are for a prior; expected a study.toml beside them")
    options = settle_options(method, Options(best=best, tolerance_um=tolerance_um), samples, own)
    if seed < 0:
        raise InputError(f"seed {seed}: expected zero or more")
    check_stated("noise_um", noise_um)
    check_stated("pressure_noise_mbar", pressure_noise_mbar)
    check_kappa(kappa)
    table = find_table(database)
    calibrated = None if probe is None else read_probe(as_path(probe))
    identifier = Identifier(
        table,
        method=method,
        options=options,
        seed=seed,
        kappa="paper" if kappa is None else kappa,
        phases=("load",) if phases is None else read_phases(phases),
        sensor=Sensor(noise_um, pressure_noise_mbar, probe=calibrated),
    )
    asked = find_model(model)
    own_model = table.spec.model
    if own_model is not None:
        if asked is not None and asked.hash != own_model.hash:
            raise InputError(
                f"{called(database, 'the database')}: built for the model "
                f"{own_model.model.name!r}, and {called(model, 'the model')} is another; build a "
                "database of that, or leave the database out"
            )
        check_kappa(kappa, own_model, called(database, "the database"))
        identifier = with_custom_table(identifier, table, phases_said=phases is not None)
    elif asked is not None:
        check_kappa(kappa, asked, called(model, "the model"))
        from skinlab.discrepancy.model_identifier import with_model  # slow to import

        identifier = with_model(identifier, asked)
    check_counted_once(calibrated, identifier.model.effects)
    if prior is None:
        return identifier
    from skinlab.inference.population import read_prior, with_prior

    return with_prior(identifier, read_prior(as_path(prior), site or None, age_years))


def find_table(database: PathLike | Table | None) -> Table:
    """Return the table that is meant; None: the shipped one.

    Raises:
        InputError: the file cannot be read.
    """
    if isinstance(database, Table):
        return database
    if database is None:
        return shipped_table()
    table = read(as_path(database))
    if table.spec.between(table) is None:
        warn(f"{database}: {NOT_MEASURED}")
    return table


def find_model(model: PathLike | Model | None) -> Model | None:
    """Return the model that is meant, read where it is a file.

    Raises:
        InputError: the file cannot be read.
    """
    return model if model is None or isinstance(model, Model) else read_model(as_path(model))


def called(given: object, else_: str) -> str:
    """Return how a sentence names what was given: the file, where it is one."""
    return str(given) if isinstance(given, str | Path) else else_


def check_stated(name: str, value: float | None) -> None:
    """Refuse a number that no campaign may state by this name either.

    Raises:
        InputError: it is out of its range.
    """
    if (words := range_missed(name, value)) is not None:
        raise InputError(f"{name} {value:g}: expected {words}")


def check_kappa(
    kappa: KappaConvention | None, model: Model | None = None, where: str = "the model"
) -> None:
    """Refuse a convention that there is not, or that is not the model's.

    Raises:
        InputError: it says what was expected.
    """
    if kappa not in (None, *get_args(KappaConvention)):
        raise InputError(f"kappa {kappa!r}: expected {' or '.join(get_args(KappaConvention))}")
    if model is not None and kappa not in (None, model.model.kappa):
        raise InputError(f"{where}: kappa is {model.model.kappa!r}, and {kappa!r} was asked for")
