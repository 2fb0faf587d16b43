"""What is in a session, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from drivers.limits import DEFAULT_LIMITS
from skinlab.errors import InputError
from skinlab.mechanics.names import plain
from skinlab.recording.audit import entries
from skinlab.recording.clocks import ClockReading, clock_readings
from skinlab.recording.dose import dose_of
from skinlab.recording.session import Session, measured_utc
from skinlab.report.text import describe_dose
from skinlab.text import counted, inert


def describe_session(path: Path, session: Session) -> str:
    """Return the text: where it is from, its curves with their results, and the audit trail."""
    clocks = _clocks(session)
    lines = _origin(path, session)
    if any(clocks):
        lines.append(f"  {_describe_clocks([c for c in clocks if c is not None])}")
    lines += _curve_lines(session, clocks)
    lines += _audit_lines(session)
    return "\n".join(inert(line) for line in lines)


def _origin(path: Path, session: Session) -> list[str]:
    """Return from whom, when and by what the curves are."""
    meta = session.meta
    imported = meta.get("imported")
    done = "measured" if imported is None else "imported"
    lines = [
        f"{path}: {done} {meta.get('created_utc')} with skinlab {meta.get('skinlab_version')}",
        f"  subject {meta.get('subject') or '-'}, site {meta.get('site') or '-'}",
    ]
    if imported is not None:
        return [
            *lines,
            f"  measured {measured_utc(meta) or 'on a day that nobody stated'}",
            f"  from {counted(len(imported), 'file')} of other software; "
            "no instrument was connected",
        ]
    instrument = meta.get("instrument") or {}
    simulated = " (SIMULATED)" if instrument.get("simulated") else ""
    lines.append(f"  instrument {instrument.get('model', '-')}{simulated} at {meta.get('url')}")
    if dialect := meta.get("dialect"):
        file = f", a file, sha256:{dialect['sha256']}" if "sha256" in dialect else ""
        lines.append(f"  dialect {dialect.get('name')}, version {dialect.get('version')}{file}")
    if meta.get("control"):
        lines.append(f"  read-only: {meta['control']}")
    lines.append(f"  {describe_dose(dose_of(session))}")
    return lines


def _curve_lines(session: Session, clocks: Sequence[ClockReading | None]) -> Iterator[str]:
    """Yield what each curve is of, how its clock went, and its result."""
    for k, (curve, result) in enumerate(zip(session.curves, session.results, strict=True)):
        setup = curve.setup
        placed = "" if setup.placement is None else f", placement {setup.placement}"
        state = " partial" if curve.partial else ""
        yield (
            f"  {curve.name}: {setup.aperture_mm:g} mm, {setup.thickness_mm:g} mm skin, "
            f"{setup.program or 'program not stated'}, cycle {setup.cycle}{placed}, "
            f"{len(curve)} samples{state}"
        )
        if k < len(clocks) and (clock := clocks[k]) is not None:
            yield f"    {_describe_clock(clock)}"
        found = result or {}
        if values := found.get("parameters"):
            text = ", ".join(_value(name, entry["value"]) for name, entry in values.items())
            error_um = found.get("error_um")
            yield f"    {text}" + ("" if error_um is None else f", fit error {error_um:.3g} µm")


def _audit_lines(session: Session) -> Iterator[str]:
    """Yield the entries of the audit trail."""
    for entry in entries(session.records):
        detail = ", ".join(
            f"{key} {value}"
            for key, value in entry.detail.items()
            if value is not None
            and not isinstance(value, dict | list)
            and not (entry.what == "protocol" and key == "text")
        )
        about = f": {detail}" if detail and entry.what != "session opened" else ""
        yield f"  {entry.number:3d}  {entry.utc[:23]}  {entry.who}  {entry.what}{about}"


def _value(name: str, value: float) -> str:
    label, unit = plain(name)
    return f"{label} {value:.4g} {unit}".rstrip()


def _clocks(session: Session) -> tuple[ClockReading | None, ...]:
    try:
        return clock_readings(session.meta, session.records)
    except InputError:  # a dialect that is not installed here: all else can be said
        return ()


def _describe_clocks(clocks: list[ClockReading]) -> str:
    """Return in one line how the instrument's clock goes by the host's."""
    rates = [clock.rate for clock in clocks]
    known = max(clock.rate_uncertainty for clock in clocks)
    each = [_pace(rate, known) for rate in (min(rates), max(rates))]
    alike = max(rates) - min(rates) <= known or each[0] == each[1]
    said = each[0] if alike else f"{each[0]} to {each[1]}"
    return (
        f"the instrument's clock by this computer's: {said} (± {100 * known:.2g} %); "
        "times and rates of curves are by the instrument's"
    )


def clock_warning(session: Session) -> str | None:
    """Return what is to be said where the clock of an instrument that nobody controls is wrong."""
    most = DEFAULT_LIMITS.clock_fraction
    off = [c for c in _clocks(session) if c and abs(c.rate - 1.0) > most + c.rate_uncertainty]
    if not off:
        return None
    return (
        f"{_describe_clocks(off)}, the dose by this computer's: are rate_hz and the unit of the "
        "time in its dialect right?"
    )


def _pace(rate: float, known: float) -> str:
    off = 100.0 * (rate - 1.0)
    if abs(rate - 1.0) <= known:
        return "the same"
    return f"{abs(off):.2g} % {'fast' if off > 0 else 'slow'}"


def _describe_clock(clock: ClockReading) -> str:
    try:
        began = datetime.fromtimestamp(clock.utc_s, UTC).isoformat(sep=" ", timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        began = f"{clock.utc_s:g}"
    return (
        f"began {began} ({clock.host_time_s:.3f} s on this computer's steady clock), "
        f"the instrument's clock {100.0 * (clock.rate - 1.0):+.2f} % ± "
        f"{100.0 * clock.rate_uncertainty:.2g} %, even to {1e3 * clock.wander_s:.0f} ms"
    )
