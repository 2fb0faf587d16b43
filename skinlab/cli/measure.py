"""`skinlab measure`: acquire, identify and record without a screen."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.interrupts import interrupt_on_signals
from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
    parse_phases,
    print_json,
    prior_options,
    with_prior_option,
)

if TYPE_CHECKING:
    from skinlab.curves.program import Program


@click.command(cls=MethodCommand)
@click.option("--port", required=True, help="pyserial URL: /dev/ttyUSB0, COM3, socket://…, sim://")
@geometry_options(required=True)
@click.option("--program", required=True, help="What the pump does, e.g. ramp:100@20.")
@click.option("--repeats", default=1, show_default=True, help="How many curves.")
@click.option("--rest-s", default=5.0, show_default=True, help="Rest between repeats.")
@click.option("--rate-hz", type=float, help="Samples a second [default: the instrument's].")
@click.option("--subject", default="", help="Pseudonym; never a name.")
@click.option("--site", default="", help="Where on the body.")
@click.option("--first-cycle", default=1, show_default=True, help="Cycle of the first repeat.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="The session to write.")
@identification_options()
@prior_options(site=False)
@json_option()
def command(
    port: str,
    aperture_mm: float,
    thickness_mm: float,
    thickness_sd_mm: float | None,
    program: str,
    repeats: int,
    rest_s: float,
    rate_hz: float | None,
    subject: str,
    site: str,
    first_cycle: int,
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
    """
    from skinlab.acquisition.measure import Plan
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.errors import InputError

    if not 1 <= repeats <= 1000:
        raise InputError(f"repeats {repeats}: expected 1–1000")
    if rate_hz is not None and not 0 < rate_hz <= 1e5:
        raise InputError(f"rate_hz {rate_hz:g}: expected a positive number of samples a second")
    if not 0 <= rest_s <= 3600:
        raise InputError(f"rest_s {rest_s:g}: expected 0–3600 s")
    asked = parse_program(program)
    _check_phases(asked, options["phases"])
    setup = Setup(
        aperture_mm,
        thickness_mm,
        asked,
        cycle=first_cycle,
        thickness_sd_mm=thickness_sd_mm,
    )
    plan = Plan(setup, repeats=repeats, rest_s=rest_s, rate_hz=rate_hz)
    if age_years is not None and prior_path is None:
        raise click.UsageError("--age-years is for --prior")
    identifier = with_prior_option(make_identifier(**options), prior_path, site, age_years)
    return run(port, plan, out, identifier, subject, site, as_json=as_json)


def _check_phases(program: Program, phases: str) -> None:
    """Refuse, before any suction, a program that holds nothing to fit."""
    if not set(parse_phases(phases)) & set(program.phases):
        found = ", ".join(dict.fromkeys(program.phases))
        raise click.BadParameter(
            f"{program} has no {phases}, so that nothing could be fitted; it has {found}",
            param_hint="--phases",
        )


def run(
    port: str,
    plan: Any,
    out: Path,
    identifier: Any,
    subject: str = "",
    site: str = "",
    *,
    as_json: bool,
) -> int:
    """Measure by the plan, print results as they come (or one JSON document at the end).

    Raises:
        AcquisitionError, DriverError, KeyboardInterrupt: after the probe was told to vent and the
            session was written.
    """
    from drivers.probe import Probe
    from skinlab.acquisition.gc_tuning import shorten_pauses
    from skinlab.acquisition.measure import measure
    from skinlab.acquisition.pipeline import Pipeline
    from skinlab.acquisition.sources import LiveSource
    from skinlab.inference.result import Identification, document
    from skinlab.recording.recorder import Recording
    from skinlab.recording.stream import Flagged, Happened, Identified, Message
    from skinlab.report.outage import outage_words
    from skinlab.report.text import describe

    results: list[Identification] = []

    def show(message: Message) -> None:
        if isinstance(message, Identified):
            results.append(message.result)
            if not as_json:
                click.echo(describe(message.result))
        elif isinstance(message, Flagged):
            click.echo(f"skinlab: curve {message.index}: {message.finding}", err=True)
        elif isinstance(message, Happened) and (words := outage_words(message.event)):
            click.echo(f"skinlab: {words}", err=True)

    # A terminated process, or one whose terminal is closed, vents like an interrupted one.
    interrupt_on_signals()
    recording = Recording(out, identifier, subject=subject, site=site, url=port)
    shorten_pauses()
    failed: BaseException | None = None
    try:
        with Probe(port, on_bytes=recording.journal.raw) as probe:
            hello = probe.open()
            if hello.simulated and sys.stderr.isatty():
                click.echo(f"SIMULATED probe: {hello.model} {hello.firmware}", err=True)
            source = LiveSource(probe, recording.journal)
            measure(source, plan, Pipeline(identifier, [recording, show]))
    except BaseException as error:
        failed = error
        raise
    finally:
        saved = _finish(recording, failed)
        if saved and as_json:
            print_json(document(identifier.provenance(), results, session=str(saved)))
        elif saved:
            click.echo(f"session: {saved}")
    return 0


def _finish(recording: Any, failed: BaseException | None) -> Path | None:
    """Write the session; where that fails too, say both.

    Raises:
        AcquisitionError, InputError: the session cannot be written.
    """
    from skinlab.errors import AcquisitionError, InputError

    trouble = recording.journal.trouble
    try:
        saved: Path | None = recording.finish()
    except InputError as error:
        if failed is None:
            raise
        if not isinstance(failed, AcquisitionError):
            click.echo(f"skinlab: {error}", err=True)
            return None
        # A disk that is full has stopped the measurement: one cause, one sentence.
        before = "recording failed, the probe was told to vent" if trouble else failed
        raise AcquisitionError(f"{before}; {error}") from None
    return saved
