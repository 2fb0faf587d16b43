"""A whole headless measurement: from a port to a session file, whatever happens on the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.dialect import Dialect
from drivers.dialects import split_dialect, stream_of
from drivers.dose import Dose, program_dose
from drivers.limits import DEFAULT_DOSE_MBAR_S
from drivers.probe import DEFAULT_LIMITS, Probe
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement import Policy
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.pipeline import Listener, Pipeline
from skinlab.acquisition.shutdown import HeldInterrupt
from skinlab.acquisition.sources import LiveSource, check_opening, wire_segments
from skinlab.curves.curve import MOST_LOADINGS, Setup
from skinlab.curves.program import Program
from skinlab.errors import AcquisitionError, InputError
from skinlab.recording.recorder import Recording

if TYPE_CHECKING:
    from drivers.events import Hello
    from skinlab.curves.probe_file import ProbeErrors
    from skinlab.inference.identify import Identifier


def plan_of(setup: Setup, repeats: int, rest_s: float, rate_hz: float | None) -> Plan:
    """Return the plan of a headless measurement.

    Raises:
        InputError: a number is out of its range.
    """
    if not 1 <= repeats <= 1000:
        raise InputError(f"repeats {repeats}: expected 1–1000")
    if rate_hz is not None and not 0 < rate_hz <= 1e5:
        raise InputError(f"rate_hz {rate_hz:g}: expected a positive number of samples a second")
    if not 0 <= rest_s <= 3600:
        raise InputError(f"rest_s {rest_s:g}: expected 0–3600 s")
    last = setup.cycle + repeats + Policy().most_outages  # each loading counts, a cut one too
    if last > MOST_LOADINGS:
        raise InputError(
            f"cycle {setup.cycle} with {repeats} repeats: loading {last} may be reached; expected "
            f"at most {MOST_LOADINGS}"
        )
    return Plan(setup, repeats=repeats, rest_s=rest_s, rate_hz=rate_hz)


def nothing_to_fit(program: Program, phases: tuple[str, ...]) -> str | None:
    """Return a complaint where a program has none of the phases that are fitted, else None."""
    if set(phases) & set(program.phases):
        return None
    found = ", ".join(dict.fromkeys(program.phases))
    return f"{program} has no {','.join(phases)}, so that nothing could be fitted; it has {found}"


def run_session(
    port: str,
    plan: Plan,
    out: Path,
    identifier: Identifier,
    *,
    dialect: Dialect,
    saved: Callable[[Path, Dose], None],
    subject: str = "",
    site: str = "",
    dose_limit_mbar_s: float | None = None,
    trail: Sequence[tuple[str, Mapping[str, Any]]] = (),
    listener: Listener = lambda _: None,
    opened: Callable[[Hello], None] = lambda _: None,
    ready: Callable[[], None] = lambda: None,
    waits: Callable[[], None] = lambda: None,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Measure by the plan into a session; curves are identified as they complete.

    `trail` are entries for the audit trail, written before anything is measured.
    `ready` is called once all is checked, before the journal is begun; `opened` with what the
    instrument says of itself; `saved` with the session and its dose once it is written, also where
    the measurement failed; `waits` many times a second while it is measured; `say` with a sentence
    where a failed one could not be written either.

    Raises:
        InputError: the plan needs more than the dose limit; nothing was begun.
        AcquisitionError, DriverError, KeyboardInterrupt: after the probe was told to vent and the
            session was written.
    """
    make_probe = probes(dose_limit_mbar_s)
    check_dose(plan, dose_limit_mbar_s)
    known = identifier.sensor.probe
    if known is not None:
        known.check_use(plan.setup.aperture_mm, datetime.now(UTC))
    if not dialect.capabilities.controllable:
        check_opening(plan.setup, stream_of(dialect).aperture_mm)
    ready()
    recording = Recording(out, identifier, subject=subject, site=site, url=port, dialect=dialect)
    for what, detail in trail:
        recording.audit(what, **detail)
    failed: BaseException | None = None
    try:
        with make_probe(port, dialect=dialect, on_bytes=recording.journal.raw) as probe:
            hello = probe.open()
            opened(hello)
            if known is not None:
                say(_check_probe(known, hello, recording))
            before = recording.carry_dose(simulated=hello.simulated)
            if before.time_s:
                say(
                    f"the site had {before.suction_mbar_s:.0f} mbar·s in this visit before, in "
                    "other sessions of the same folder"
                )
                check_dose(plan, dose_limit_mbar_s, before)
                probe.carry_dose(before)
            source = LiveSource(probe, recording.journal)
            pipeline = Pipeline(identifier, [recording, listener])
            measure(source, plan, pipeline, acknowledged=recording.acknowledged, waits=waits)
    except BaseException as error:
        failed = error
        raise
    finally:
        with HeldInterrupt():  # an impatient second one must not interrupt the saving
            path = _finish(recording, failed, say)
            if path is not None:
                # Where nothing can be printed, what failed before is what is said
                with nullcontext() if failed is None else suppress(OSError):
                    saved(path, recording.dose)


def _check_probe(known: ProbeErrors, hello: Hello, recording: Recording) -> str:
    """Return how this instrument stands to the probe file, once that is in the audit trail.

    Raises:
        InputError: the file is of another instrument.
    """
    now = datetime.now(UTC)
    known.check_instrument(hello.serial_number, hello.aperture_mm, now)
    agrees, words = known.standing(now)
    recording.audit("probe file", agrees=agrees, words=words)
    return words


def probes(dose_limit_mbar_s: float | None, dialect: str | None = None) -> Callable[..., Probe]:
    """Return what makes a Probe with the dose limit that the user asked for; None: the usual one.

    dialect: of ports that do not name their own; the simulated probe always does.

    Raises:
        InputError: it is no limit.
    """
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


def check_dose(plan: Plan, dose_limit_mbar_s: float | None, before: Dose | None = None) -> None:
    """Refuse, before any suction, a plan that the site may not have as a whole.

    `before`: what it had in this visit already.

    Raises:
        InputError: it says what the plan needs.
    """
    if plan.setup.program is None:
        return
    limit_mbar_s = DEFAULT_DOSE_MBAR_S if dose_limit_mbar_s is None else dose_limit_mbar_s
    once = program_dose(wire_segments(plan.setup.program)).suction_mbar_s
    had = 0.0 if before is None else before.suction_mbar_s
    if plan.repeats * once + had > limit_mbar_s:
        already = f", with the {had:.6g} mbar·s that the site had," if had else ","
        raise InputError(
            f"{plan.repeats} times {plan.setup.program} needs a dose of {plan.repeats * once:.6g} "
            f"mbar·s{already} more than the {limit_mbar_s:.6g} mbar·s allowed in one visit "
            "(--dose-limit-mbar-s)"
        )


def _finish(
    recording: Recording, failed: BaseException | None, say: Callable[[str], None]
) -> Path | None:
    """Write the session; where that fails too, say both.

    Raises:
        AcquisitionError, InputError: the session cannot be written.
    """
    trouble = recording.journal.trouble
    try:
        return recording.finish()
    except InputError as error:
        if failed is None:
            raise
        if not isinstance(failed, AcquisitionError):
            say(str(error))
            return None
        # A disk that is full has stopped the measurement: one cause, one sentence.
        before = "recording failed, the probe was told to vent" if trouble else failed
        raise AcquisitionError(f"{before}; {error}") from None
