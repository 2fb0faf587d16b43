"""`skinlab measure`: acquire, identify and record without a screen."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.capabilities import CANNOT_VENT, READ_ONLY
from drivers.events import Damaged, InstrumentState, Sample, State
from drivers.limits import DEFAULT_DOSE_MBAR_S
from drivers.line_dialect import IGNORED
from skinlab.cli.interrupts import interrupt_on_signals
from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    dialect_option,
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
    parse_phases,
    prior_options,
    with_prior_option,
)
from skinlab.cli.output import echo, echo_text, print_json

if TYPE_CHECKING:
    from drivers.dialects import Dialect
    from drivers.probe import Probe
    from skinlab.acquisition.measurement import Plan
    from skinlab.curves.program import Program
    from skinlab.recording.stream import Message

_NOT_UNDERSTOOD = 10  # lines, after which it is said


@click.command(cls=MethodCommand)
@click.option("--port", required=True, help="pyserial URL: /dev/ttyUSB0, COM3, socket://…, sim://")
@dialect_option()
@geometry_options(required=True)
@click.option(
    "--program",
    help="What the pump does, e.g. ramp:100@20; of a read-only instrument, if known.",
)
@click.option("--repeats", default=1, show_default=True, help="How many curves.")
@click.option("--rest-s", default=5.0, show_default=True, help="Rest between repeats.")
@click.option("--rate-hz", type=float, help="Samples a second [default: the instrument's].")
@click.option("--subject", default="", help="Pseudonym; never a name.")
@click.option("--site", default="", help="Where on the body.")
@click.option("--first-cycle", default=1, show_default=True, help="Cycle of the first repeat.")
@click.option(
    "--dose-limit-mbar-s",
    type=float,
    help=f"Most suction times time for the site in this visit [default: {DEFAULT_DOSE_MBAR_S:g}].",
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="The session to write.")
@identification_options()
@prior_options(site=False)
@json_option()
def command(
    port: str,
    dialect: str | None,
    aperture_mm: float,
    thickness_mm: float,
    thickness_sd_mm: float | None,
    program: str | None,
    repeats: int,
    rest_s: float,
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
    from skinlab.acquisition.measurement import Plan
    from skinlab.curves.curve import Setup
    from skinlab.curves.program import parse_program
    from skinlab.errors import InputError

    if not 1 <= repeats <= 1000:
        raise InputError(f"repeats {repeats}: expected 1–1000")
    if rate_hz is not None and not 0 < rate_hz <= 1e5:
        raise InputError(f"rate_hz {rate_hz:g}: expected a positive number of samples a second")
    if not 0 <= rest_s <= 3600:
        raise InputError(f"rest_s {rest_s:g}: expected 0–3600 s")
    _, speaks = choose_dialect(port, dialect)
    controls = speaks.capabilities.controllable
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
    plan = Plan(setup, repeats=repeats, rest_s=rest_s, rate_hz=rate_hz)
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
        as_json=as_json,
    )


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
    plan: Plan,
    out: Path,
    identifier: Any,
    subject: str = "",
    site: str = "",
    *,
    dialect: Dialect,
    dose_limit_mbar_s: float | None = None,
    as_json: bool,
) -> int:
    """Measure by the plan, print results as they come (or one JSON document at the end).

    Raises:
        InputError: the plan needs more than the dose limit; nothing was begun.
        AcquisitionError, DriverError, KeyboardInterrupt: after the probe was told to vent and the
            session was written.
    """
    from skinlab.acquisition.gc_tuning import shorten_pauses
    from skinlab.acquisition.measure import measure
    from skinlab.acquisition.pipeline import Pipeline
    from skinlab.acquisition.sources import LiveSource
    from skinlab.inference.result import Identification, document
    from skinlab.recording.recorder import Recording
    from skinlab.recording.stream import Flagged, Happened, Identified
    from skinlab.report.outage import outage_words
    from skinlab.report.text import describe, describe_dose

    results: list[Identification] = []
    onlooker = None if dialect.capabilities.controllable else _Onlooker(plan.repeats, dialect.name)

    def show(message: Message) -> None:
        if onlooker is not None:
            onlooker(message)
        if isinstance(message, Identified):
            results.append(message.result)
            if not as_json:
                echo_text(describe(message.result))
        elif isinstance(message, Flagged):
            echo(f"skinlab: curve {message.index}: {message.finding}", err=True)
        elif isinstance(message, Happened) and (words := outage_words(message.event)):
            echo(f"skinlab: {words}", err=True)

    make_probe = probes(dose_limit_mbar_s)
    limit_mbar_s = DEFAULT_DOSE_MBAR_S if dose_limit_mbar_s is None else dose_limit_mbar_s
    _check_dose(plan, limit_mbar_s)
    # A terminated process, or one whose terminal is closed, vents like an interrupted one.
    interrupt_on_signals()
    recording = Recording(out, identifier, subject=subject, site=site, url=port, dialect=dialect)
    shorten_pauses()
    failed: BaseException | None = None
    try:
        with make_probe(port, dialect=dialect, on_bytes=recording.journal.raw) as probe:
            hello = probe.open()
            if onlooker is not None:
                onlooker.begin()
            if hello.simulated and sys.stderr.isatty():
                echo(f"SIMULATED probe: {hello.model} {hello.firmware}", err=True)
            source = LiveSource(probe, recording.journal)
            measure(source, plan, Pipeline(identifier, [recording, show]))
    except BaseException as error:
        failed = error
        raise
    finally:
        saved = _finish(recording, failed)
        if saved and as_json:
            whole = document(
                identifier.provenance(), results, session=str(saved), dose=recording.dose
            )
            print_json(whole)
        elif saved:
            echo(f"{describe_dose(recording.dose)}; limit {limit_mbar_s:g} mbar·s")
            echo(f"session: {saved}")
    return 0


class _Onlooker:
    """Says on standard error what is waited for, where somebody else starts the instrument."""

    def __init__(self, repeats: int, dialect: str) -> None:
        self._repeats = repeats
        self._dialect = dialect
        self._curves = 0
        self._readings = self._damaged = 0

    def begin(self) -> None:
        """Say what this is."""
        echo(f"skinlab: read-only: {READ_ONLY}; {CANNOT_VENT}", err=True)

    def __call__(self, message: Message) -> None:
        from skinlab.recording.stream import CurveCompleted, CurveStarted, Happened, Sampled

        match message:
            case Sampled() | Happened(Sample()):
                self._readings += 1
            case Happened(Damaged(reason, data)) if reason != IGNORED:
                self._damaged += 1
                if self._damaged == _NOT_UNDERSTOOD and not self._readings:
                    what = (
                        f"{_NOT_UNDERSTOOD} lines came, and dialect {self._dialect!r} understands"
                    )
                    echo(f"skinlab: {what} none ({reason}), the last one {data[:60]!r}", err=True)
            case CurveStarted(index):
                echo(f"skinlab: curve {index}: the pressure left zero", err=True)
            case CurveCompleted(_, _, None):
                self._curves += 1
            case Happened(State(InstrumentState.ARMED)):
                of = f"curve {self._curves + 1} of {self._repeats}"
                echo(f"skinlab: {of}: start the instrument; Ctrl-C ends and saves", err=True)
            case _:
                pass


def probes(dose_limit_mbar_s: float | None, dialect: str | None = None) -> Callable[..., Probe]:
    """Return what makes a Probe with the dose limit that the user asked for; None: the usual one.

    dialect: of ports that do not name their own; the simulated probe always does.

    Raises:
        InputError: it is no limit.
    """
    from drivers.dialects import split_dialect
    from drivers.probe import DEFAULT_LIMITS, Probe
    from skinlab.errors import InputError

    common: dict[str, Any] = {}
    if dose_limit_mbar_s is not None:
        try:
            common["limits"] = replace(DEFAULT_LIMITS, max_dose_mbar_s=dose_limit_mbar_s)
        except ValueError:
            raise InputError(
                f"dose_limit_mbar_s {dose_limit_mbar_s:g}: expected a positive number of mbar·s"
            ) from None

    def make(port: str, **arguments: Any) -> Probe:
        if dialect is not None and not port.startswith("sim:") and split_dialect(port)[1] is None:
            arguments = {"dialect": dialect, **arguments}
        return Probe(port, **common, **arguments)

    return make


def _check_dose(plan: Plan, limit_mbar_s: float) -> None:
    """Refuse, before any suction, a plan that the site may not have as a whole."""
    from drivers.dose import program_dose
    from skinlab.acquisition.sources import wire_segments
    from skinlab.errors import InputError

    if plan.setup.program is None:
        return
    once = program_dose(wire_segments(plan.setup.program)).suction_mbar_s
    if plan.repeats * once > limit_mbar_s:
        raise InputError(
            f"{plan.repeats} times {plan.setup.program} needs a dose of {plan.repeats * once:.6g} "
            f"mbar·s, more than the {limit_mbar_s:.6g} mbar·s allowed in one visit "
            "(--dose-limit-mbar-s)"
        )


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
            echo(f"skinlab: {error}", err=True)
            return None
        # A disk that is full has stopped the measurement: one cause, one sentence.
        before = "recording failed, the probe was told to vent" if trouble else failed
        raise AcquisitionError(f"{before}; {error}") from None
    return saved
