"""The functions of `import skinlab`; docs/python.md shows them at work."""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

from drivers.numbers import number_in
from skinlab.api.arguments import check_workers, checked
from skinlab.api.explaining import base_model, hashes_of, outcome_of
from skinlab.api.identifiers import check_stated, compose_identifier, find_table
from skinlab.api.paths import PathLike, as_path
from skinlab.api.results import (
    Campaign,
    Curve,
    Explanation,
    Identification,
    Measurement,
    OnResult,
    Session,
    Study,
)
from skinlab.api.simulation import simulated
from skinlab.curves import campaign as campaigns
from skinlab.curves import csv
from skinlab.curves import curve as curves
from skinlab.curves.distinct import check_distinct, named_apart
from skinlab.curves.one_skin import check_one_skin
from skinlab.curves.program import Program, parse_program
from skinlab.curves.program_check import check_program
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference import result as identifications
from skinlab.inference.batch import (
    fitted_together,
    judged,
    scatter_of,
    with_scatter,
    with_stated_noise,
)
from skinlab.mechanics.materials import get_law, law_names
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_file import Model
from skinlab.recording import load_inputs
from skinlab.recording import session as sessions
from skinlab.tables.table import Table
from skinlab.text import counted

_log = logging.getLogger("skinlab")
_CALLER = 3  # of a function behind `checked`: whose line a warning names


@checked
def read_curve(
    path: PathLike,
    *,
    aperture_mm: float,
    thickness_mm: float,
    program: str | Program | None = None,
    thickness_sd_mm: float | None = None,
    cycle: int = 1,
    repeat: int = 1,
    placement: str | None = None,
) -> Curve:
    """Return the curve of a CSV with the columns time_s, pressure_mbar and deflection_mm.

    aperture_mm: the opening's diameter, 2, 4, 6 or 8. program: what the pump did, such as
    "ramp:100@20"; None: read from the pressure. cycle: 1 is the first loading of the site.
    placement: a name for one putting-on of the probe; None: a curve of cycle 1 begins one.

    Raises:
        InputError: names the file, the line or field, and what was expected; or the pressure is
            far off the program.
    """
    named = curves.named_placement(placement) if isinstance(placement, str) else placement
    setup = curves.Setup(
        aperture_mm, thickness_mm, _program(program), cycle, repeat, thickness_sd_mm, named
    )
    return Curve.of(check_program(csv.read_curve(as_path(path), setup)))


@checked
def read_session(path: PathLike) -> Session:
    """Return what is in a session file.

    Raises:
        InputError: no such file, not a session, cut off, or changed since it was written.
    """
    file = as_path(path)
    return Session(file, sessions.read_session(file))


@checked
def read_campaign(path: PathLike) -> Campaign:
    """Return the curves of a campaign's TOML (or its folder), or of a session.

    Raises:
        InputError: the file or one of its curves is wrong; names file and field or line.
    """
    found, _ = load_inputs.read_campaign_or_session(as_path(path))
    named = tuple(Curve.of(c) for c in found.curves)
    noise = found.noise_um, found.pressure_noise_mbar
    return Campaign(found.title, *noise, named, found.placement_scatter)


@checked
def identify(
    curve: curves.Curve,
    *,
    method: str = "auto",
    model: PathLike | Model | None = None,
    prior: PathLike | None = None,
    site: str | None = None,
    age_years: float | None = None,
    seed: int = 0,
    kappa: KappaConvention | None = None,
    phases: str | Sequence[str] | None = None,
    noise_um: float | None = None,
    pressure_noise_mbar: float | None = None,
    database: PathLike | Table | None = None,
    **options: Any,
) -> Identification:
    """Return the skin's parameters from one curve.

    model: a MODEL.toml. prior: the study.toml of a population; site, age_years: of the person in
    it; None: as wide as all of them. kappa: "paper" or "consistent"; phases: which samples to fit,
    such as "load,hold"; None: the model's, else "paper" and "load".
    noise_um, pressure_noise_mbar: standard deviations of one sample; None: estimated.
    database: a file of `skinlab database build`.
    options: `samples`, `best`, `tolerance_um`, and those of the method (docs/methods.md). Same
    seed, same bits.

    Raises:
        InputError: a setting is wrong, or the curve has nothing to identify.
        NotTrustworthyError: the curve is outside the database.
    """
    identifier = compose_identifier(
        method=method,
        model=model,
        prior=prior,
        site=site,
        age_years=age_years,
        seed=seed,
        kappa=kappa,
        phases=phases,
        noise_um=noise_um,
        pressure_noise_mbar=pressure_noise_mbar,
        database=database,
        **options,
    )
    identifier = identifier.of_probe([curve])
    return Identification(_usable(judged(identifier, curve)), [curve], identifier)


@checked
def identify_joint(
    curves: Sequence[curves.Curve] | campaigns.Campaign,
    *,
    method: str = "auto",
    model: PathLike | Model | None = None,
    prior: PathLike | None = None,
    site: str | None = None,
    age_years: float | None = None,
    seed: int = 0,
    kappa: KappaConvention | None = None,
    phases: str | Sequence[str] | None = None,
    noise_um: float | None = None,
    pressure_noise_mbar: float | None = None,
    placement_scatter: float | Literal["auto"] | None = None,
    database: PathLike | Table | None = None,
    **options: Any,
) -> Identification:
    """Return one answer for several curves of one skin, or for a campaign's.

    Arguments as of `identify`. Noise that is not given is a campaign's, else it is estimated.
    placement_scatter: deviation of log stiffness between placements of the probe; "auto": learned;
    None: the campaign's, else learned. Curves of later cycles are left out where there are first
    ones, unless the model has effects of rate or cycle.

    Raises:
        InputError, NotTrustworthyError: as `identify`; or the curves are of sessions of two people
            or two sites.
    """
    stated = curves if isinstance(curves, campaigns.Campaign) else None
    several = tuple(curves.curves if isinstance(curves, campaigns.Campaign) else curves)
    if not several or not all(map(_is_curve, several)):  # of a generator
        raise InputError("expected one curve or more, such as skinlab.read_curve returns")
    check_distinct(several)
    _tell_whose(several)
    several = named_apart(several)
    if isinstance(placement_scatter, str):
        if placement_scatter != "auto":
            raise InputError(f"placement_scatter {placement_scatter!r}: expected auto or a number")
    else:
        check_stated("placement_scatter", placement_scatter)
    identifier = compose_identifier(
        method=method,
        model=model,
        prior=prior,
        site=site,
        age_years=age_years,
        seed=seed,
        kappa=kappa,
        phases=phases,
        noise_um=noise_um,
        pressure_noise_mbar=pressure_noise_mbar,
        database=database,
        **options,
    )
    noise = (None, None) if stated is None else (stated.noise_um, stated.pressure_noise_mbar)
    scatter = scatter_of(placement_scatter, None if stated is None else stated.placement_scatter)
    chosen = fitted_together(identifier, several)
    knowing = with_scatter(with_stated_noise(identifier, *noise), scatter)
    if len(chosen) < len(several):
        left = len(several) - len(chosen)
        warnings.warn(f"{counted(left, 'curve')} of later cycles left out", stacklevel=_CALLER)
    return Identification(_usable(knowing.joint(chosen)), chosen, identifier.of_probe(chosen))


@checked
def forward(
    *,
    aperture_mm: float,
    thickness_mm: float,
    program: str | Program,
    model: PathLike | Model | None = None,
    direct: bool = False,
    law: str | None = None,
    kappa: KappaConvention | None = None,
    rate_hz: float = 20.0,
    cycle: int = 1,
    database: PathLike | Table | None = None,
    **parameters: float,
) -> Curve:
    """Return the simulated curve of a skin.

    parameters: the law's own by their names: X1_MPa, X2_MPa and nu of the paper's. direct: by
    finite elements; else the database answers. law, kappa: None: the model's or database's, else
    the paper's. Where a skin creases at the tape's edge its curve goes on with a blunter edge; one
    that the model cannot follow to its end is cut there. Each comes with a warning.

    Raises:
        InputError: a value is out of its range, missing, or none of the law's.
        NotTrustworthyError: the model does not hold even for the first samples.
    """

    def values_of(name: str) -> tuple[float, ...]:
        names = get_law(name).names
        wrong = [one for one in parameters if one not in names]
        missing = [one for one in names if one not in parameters]
        for what, found in (("not of", wrong), ("missing for", missing)):
            if found:
                raise InputError(
                    f"{', '.join(found)}: {what} the law {name}, which takes {', '.join(names)} "
                    f"(laws: {', '.join(law_names())})"
                )
        return tuple(_number(one, parameters[one]) for one in names)

    setup = curves.Setup(aperture_mm, thickness_mm, _program(program), cycle)
    curve, warning = simulated(
        setup,
        values_of,
        law=law,
        kappa=kappa,
        rate_hz=rate_hz,
        direct=direct,
        model=model,
        database=database,
    )
    if warning is not None:
        warnings.warn(warning, stacklevel=_CALLER)
    return Curve.of(curve)


@checked
def explain(
    campaign: PathLike | campaigns.Campaign,
    *,
    model: PathLike | Model | None = None,
    workers: int | None = None,
    database: PathLike | Table | None = None,
    cached: bool = True,
) -> Explanation:
    """Return where model and measurement disagree, and which physical effect is missing.

    campaign: what `read_campaign` returns, or a path that it takes. model: the one to start from.
    workers: processes; None: one a core; same answers. cached: what was computed before is kept.

    Raises:
        InputError: the campaign or the model cannot be used; or the curves are of two people or two
            sites.
        NotTrustworthyError: the model does not hold for these curves.
    """
    if not isinstance(campaign, campaigns.Campaign):
        campaign = read_campaign(campaign)
    _tell_whose(campaign.curves)
    table = find_table(database)
    base = base_model(model, table)
    outcome = outcome_of(campaign, base, table, workers=workers, cached=cached)
    return Explanation(outcome, base, table, hashes_of(campaign))


@checked
def measure(
    url: str,
    *,
    aperture_mm: float,
    thickness_mm: float,
    program: str | Program | None,
    out: PathLike,
    repeats: int = 1,
    rest_s: float = 5.0,
    rate_hz: float | None = None,
    thickness_sd_mm: float | None = None,
    subject: str = "",
    site: str = "",
    first_cycle: int = 1,
    dose_limit_mbar_s: float | None = None,
    dialect: PathLike | None = None,
    on_result: OnResult | None = None,
    **identification: Any,
) -> Measurement:
    """Measure, identify each curve as it completes, and record all in the new session `out`.

    url: a serial port or pyserial's URL, or sim://. program: None only of a read-only instrument.
    subject: a pseudonym. dose_limit_mbar_s: None: the driver's. dialect: what the instrument
    speaks. on_result is called with each answer. identification: what `identify` takes. What the
    operator must know at once goes to the logger "skinlab" as a warning.

    Raises:
        InputError: refused before any suction.
        AcquisitionError, KeyboardInterrupt: after the probe was told to vent and what was measured
            was saved; a note of the error names the session.
    """
    from drivers.errors import (
        DialectFileError,
        DriverError,
        PortFileError,
        PortUrlError,
        UnknownDialectError,
    )
    from drivers.probe import choose_dialect
    from skinlab.acquisition.gc_tuning import short_pauses
    from skinlab.acquisition.session_run import nothing_to_fit, plan_of, run_session
    from skinlab.errors import AcquisitionError
    from skinlab.inference.result import document
    from skinlab.recording.stream import Happened, Identified, Message
    from skinlab.report.outage import outage_words
    from skinlab.report.text import describe_dose

    try:
        _, speaks = choose_dialect(url, None if dialect is None else str(dialect))
    except (DialectFileError, PortUrlError, UnknownDialectError) as error:
        raise InputError(str(error)) from None
    asked = _program(program)
    if asked is None and speaks.capabilities.controllable:
        raise InputError("program: expected what the pump is to do, such as ramp:100@20")
    if identification.get("prior") is not None:
        identification["site"] = site
    identifier = compose_identifier(**identification)
    complaint = None if asked is None else nothing_to_fit(asked, identifier.phases)
    if complaint is not None:
        raise InputError(complaint)
    setup = curves.Setup(
        aperture_mm, thickness_mm, asked, first_cycle, thickness_sd_mm=thickness_sd_mm
    )
    results: list[identifications.Identification] = []
    answers: list[Identification] = []
    recorded: list[Curve] = []
    ends: list[tuple[Path, Any]] = []

    def listener(message: Message) -> None:
        if isinstance(message, Identified):
            results.append(message.result)
            recorded.append(Curve.of(message.curve))
            answers.append(Identification(message.result, [message.curve], identifier))
            if on_result is not None:
                on_result(answers[-1])
        elif isinstance(message, Happened) and (words := outage_words(message.event)):
            _log.warning("%s", words)

    try:
        with short_pauses():
            run_session(
                url,
                plan_of(setup, repeats, rest_s, rate_hz),
                as_path(out),
                identifier,
                dialect=speaks,
                saved=lambda path, dose: ends.append((path, dose)),
                subject=subject,
                site=site,
                dose_limit_mbar_s=dose_limit_mbar_s,
                listener=listener,
                say=_log.warning,
            )
    except (PortFileError, PortUrlError) as error:
        raise InputError(str(error)) from None
    except DriverError as error:
        raise _with_note(AcquisitionError(str(error)), ends) from error
    except BaseException as error:
        _with_note(error, ends)
        raise
    if not ends:
        raise AcquisitionError("no curve was begun: there is no session")
    path, dose = ends[0]
    whole = document(identifier.provenance(), results, session=str(path), dose=dose)
    return Measurement(whole, answers, recorded, describe_dose(dose))


@checked
def study(
    folder: PathLike | Sequence[PathLike],
    *,
    out: PathLike,
    explain: bool = False,
    resume: bool = False,
    workers: int | None = None,
    dask: str | None = None,
    layout: str | None = None,
    aperture_mm: float | None = None,
    thickness_mm: float | None = None,
    thickness_sd_mm: float | None = None,
    program: str | Program | None = None,
    progress: Callable[[int, int], None] | None = None,
    **identification: Any,
) -> Study:
    """Identify every curve in a folder, or several; write the study into the folder `out`.

    explain: look for missing effects, too. resume: refuse other settings than those before.
    workers: processes; None: one a core. dask: a scheduler's address instead. layout: what paths
    say, such as "{subject}/{site}/v{visit}". aperture_mm, thickness_mm, thickness_sd_mm, program:
    where nothing else says them. progress is called with files (done, of all), then, to explain,
    with campaigns. identification: what `identify` takes, but for a prior: a study learns one. Only
    what is new or changed is computed (docs/study.md).

    Raises:
        InputError: a folder or a setting is wrong. Files that cannot be used are in `failures`.
    """
    import os
    from datetime import UTC, datetime

    from skinlab.studies.make_study import make_study
    from skinlab.studies.run import How
    from skinlab.studies.sources import Plan

    if dask is not None and workers is not None:
        raise InputError("dask and workers exclude each other")
    if identification.get("prior") is not None:
        raise InputError(
            "prior: the curves of a study are identified by themselves, as what it tells of people "
            "and its own study.toml come from them; expected none"
        )
    check_workers(workers)
    folders = [folder] if isinstance(folder, str | os.PathLike) else list(folder)
    if not folders:
        raise InputError("expected a folder of curves, or several")
    asked = _program(program)
    stated = {
        "aperture_mm": aperture_mm,
        "thickness_mm": thickness_mm,
        "thickness_sd_mm": thickness_sd_mm,
        "program": None if asked is None else str(asked),
    }
    to = as_path(out)
    plan = Plan(
        tuple(as_path(one) for one in folders),
        {name: value for name, value in stated.items() if value is not None},
        layout,
        to.resolve(),
    )
    tell = progress or (lambda done, total: None)
    how = How(workers or os.cpu_count() or 1, dask, tell, tell)
    identifier = compose_identifier(**identification)
    now = datetime.now(UTC)
    made = make_study(plan, to, identifier, how, resume=resume, explain=explain, now=now)
    for sentence in made.notices:
        _log.warning("%s", sentence)
    return Study(made, to)


def _is_curve(value: object) -> bool:
    return isinstance(value, curves.Curve)


def _tell_whose(together: Sequence[curves.Curve]) -> None:
    """Warn of what has to be known of whose skin curves together are of.

    Raises:
        InputError: they are of two people, or of two sites.
    """
    for sentence in check_one_skin(together):
        warnings.warn(sentence, stacklevel=_CALLER + 1)


def _with_note(error: BaseException, ends: list[tuple[Path, Any]]) -> BaseException:
    if ends:
        error.add_note(f"what was measured is in the session {ends[0][0]}")
    return error


def _usable(found: identifications.Identification) -> identifications.Identification:
    """Return the answer where there is one.

    Raises:
        InputError, NotTrustworthyError: there is none; says why.
    """
    if found.error is None:
        return found
    if "outside_database" in found.flags:
        raise NotTrustworthyError(found.error)
    raise InputError(found.error)


def _program(program: str | Program | None) -> Program | None:
    return parse_program(program) if isinstance(program, str) else program


def _number(name: str, value: Any) -> float:
    try:
        number = number_in(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool | bytes | bytearray):  # float takes these
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} {value!r}: expected a number")
    return number
