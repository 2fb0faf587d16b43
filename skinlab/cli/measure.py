"""`skinlab measure`: acquire, identify and record without a screen."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.capabilities import READ_ONLY
from drivers.limits import DEFAULT_DOSE_MBAR_S
from skinlab.cli.awaited import Awaited
from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    database_option,
    dialect_option,
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
    parse_phases,
    prior_options,
    probe_option,
    with_prior_option,
)
from skinlab.cli.output import echo, echo_text, print_json, reader_may_leave
from skinlab.cli.paths import PATH
from skinlab.cli.protocol import protocol_options, read_step

if TYPE_CHECKING:
    from drivers.dialect import Dialect
    from drivers.dose import Dose
    from drivers.events import Hello
    from skinlab.acquisition.measurement_messages import Plan
    from skinlab.curves.program import Program
    from skinlab.recording.stream import Message


@click.command(cls=MethodCommand)
@click.option("--port", required=True, help="pyserial URL: /dev/ttyUSB0, COM3, socket://…, sim://")
@dialect_option()
@geometry_options(required=False)
@click.option(
    "--program",
    help="What the pump does, e.g. ramp:100@20; of a read-only instrument, if known.",
)
@click.option("--repeats", type=int, help="How many curves  [default: 1].")
@click.option("--rest-s", type=float, help="Rest between repeats  [default: 5].")
@protocol_options()
@click.option("--rate-hz", type=float, help="Samples a second [default: the instrument's].")
@click.option("--subject", default="", help="Pseudonym; never a name.")
@click.option("--site", default="", help="Where on the body.")
@click.option("--first-cycle", default=1, show_default=True, help="Cycle of the first repeat.")
@click.option(
    "--dose-limit-mbar-s",
    type=float,
    help="Largest dose (suction × time) for the site in this visit "
    f"[default: {DEFAULT_DOSE_MBAR_S:g}].",
)
@click.option("--out", required=True, type=PATH, help="The session to write.")
@identification_options()
@database_option()
@probe_option()
@prior_options(site=False)
@json_option()
def command(
    port: str,
    dialect: str | None,
    aperture_mm: float | None,
    thickness_mm: float | None,
    thickness_sd_mm: float | None,
    program: str | None,
    repeats: int | None,
    rest_s: float | None,
    protocol_path: Path | None,
    step: int,
    conditions: tuple[str, ...],
    rate_hz: float | None,
    subject: str,
    site: str,
    first_cycle: int,
    dose_limit_mbar_s: float | None,
    out: Path,
    prior_path: Path | None,
    age_years: float | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Measure: each curve is identified as it completes, and everything is recorded.

    \b
    Example: skinlab measure --port "sim://?seed=1" --aperture-mm 6 --thickness-mm 1.0 \\
             --program ramp:100@20 --repeats 2 --out visit.h5 --json

    An instrument whose dialect says that it only streams is measured read-only: you start it, and
    a curve begins when the pressure leaves zero. --repeats counts curves; Ctrl-C saves what came.
    """
    from drivers.probe import choose_dialect
    from skinlab.acquisition.session_run import plan_of
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.recording.session_names import check_session_name

    check_session_name(out)
    _, speaks = choose_dialect(port, dialect)
    controls = speaks.capabilities.controllable
    trail: list[tuple[str, dict[str, Any]]] = []
    if protocol_path is not None:
        if aperture_mm is not None or program is not None:
            raise click.UsageError("--protocol gives opening and program: leave them out")
        found = read_step(protocol_path, step, conditions)
        aperture_mm, program = found.step.aperture_mm, found.step.program
        trail = found.trail(site, repeats, rest_s)
        repeats = found.step.repeats if repeats is None else repeats
        rest_s = found.step.rest_s if rest_s is None else rest_s
        for clause in found.otherwise(site, repeats, rest_s):
            echo(f"skinlab: otherwise than the protocol says: {clause}", err=True)
    elif conditions:
        raise click.UsageError("--condition is for --protocol")
    if aperture_mm is None:
        raise click.UsageError("Missing option '--aperture-mm'.")
    if thickness_mm is None:
        raise click.UsageError("Missing option '--thickness-mm'.")
    repeats = 1 if repeats is None else repeats
    rest_s = 5.0 if rest_s is None else rest_s
    if program is None and controls:
        raise click.UsageError("Missing option '--program'.")
    if rate_hz is not None and not controls:
        raise click.BadParameter(READ_ONLY, param_hint="--rate-hz")
    asked = None if program is None else parse_program(program)
    if asked is not None:
        _check_phases(asked, options["phases"])
    setup = Setup(
        aperture_mm,
        thickness_mm,
        asked,
        cycle=first_cycle,
        thickness_sd_mm=thickness_sd_mm,
    )
    plan = plan_of(setup, repeats, rest_s, rate_hz)
    if age_years is not None and prior_path is None:
        raise click.UsageError("--age-years is for --prior")
    identifier = with_prior_option(make_identifier(**options), prior_path, site, age_years)
    return run(
        port,
        plan,
        out,
        identifier,
        subject,
        site,
        dialect=speaks,
        dose_limit_mbar_s=dose_limit_mbar_s,
        trail=trail,
        as_json=as_json,
    )


def _check_phases(program: Program, phases: str) -> None:
    """Refuse, before any suction, a program that holds nothing to fit."""
    from skinlab.acquisition.session_run import nothing_to_fit

    complaint = nothing_to_fit(program, parse_phases(phases))
    if complaint is not None:
        raise click.BadParameter(complaint, param_hint="--phases")


def run(
    port: str,
    plan: Plan,
    out: Path,
    identifier: Any,
    subject: str = "",
    site: str = "",
    *,
    dialect: Dialect,
    dose_limit_mbar_s: float | None = None,
    trail: Sequence[tuple[str, dict[str, Any]]] = (),
    as_json: bool,
) -> int:
    """Measure by the plan, print results as they come (or one JSON document at the end).

    Raises:
        InputError: the plan needs more than the dose limit; nothing was begun.
        AcquisitionError, DriverError, KeyboardInterrupt: after the probe was told to vent and the
            session was written.
    """
    from skinlab.acquisition.gc_tuning import shorten_pauses
    from skinlab.acquisition.session_run import run_session
    from skinlab.inference.result import Identification, document
    from skinlab.recording.session import read_session
    from skinlab.recording.stream import Flagged, Happened, Identified
    from skinlab.report.outage import outage_words
    from skinlab.report.session_text import clock_warning
    from skinlab.report.text import describe, describe_dose

    results: list[Identification] = []
    onlooker = None if dialect.capabilities.controllable else Awaited(plan.repeats, dialect.name)
    limit_mbar_s = DEFAULT_DOSE_MBAR_S if dose_limit_mbar_s is None else dose_limit_mbar_s

    def show(message: Message) -> None:
        if onlooker is not None:
            onlooker(message)
        if isinstance(message, Identified):
            results.append(message.result)
            if not as_json:
                with reader_may_leave():  # which is no reason to end a measurement
                    echo_text(describe(message.result))
        elif isinstance(message, Flagged):
            echo(f"skinlab: curve {message.index}: {message.finding}", err=True)
        elif isinstance(message, Happened) and (words := outage_words(message.event)):
            echo(f"skinlab: {words}", err=True)

    def opened(hello: Hello) -> None:
        if onlooker is not None:
            onlooker.begin()
        if hello.simulated and sys.stderr.isatty():
            echo(f"SIMULATED probe: {hello.model} {hello.firmware}", err=True)

    def saved(path: Path, dose: Dose) -> None:
        with reader_may_leave():
            if as_json:
                print_json(document(identifier.provenance(), results, session=str(path), dose=dose))
            else:
                echo(f"{describe_dose(dose)}; limit {limit_mbar_s:g} mbar·s")
                echo(f"session: {path}")
        if onlooker is not None and (words := clock_warning(read_session(path))):
            echo(f"skinlab: {words}", err=True)

    run_session(
        port,
        plan,
        out,
        identifier,
        dialect=dialect,
        saved=saved,
        subject=subject,
        site=site,
        dose_limit_mbar_s=dose_limit_mbar_s,
        trail=trail,
        listener=show,
        opened=opened,
        ready=shorten_pauses,
        waits=lambda: None if onlooker is None else onlooker.wait(),
        say=lambda sentence: echo(f"skinlab: {sentence}", err=True),
    )
    return 0
