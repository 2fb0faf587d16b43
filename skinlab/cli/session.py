"""`skinlab session`: check a session, or say what is in it."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.output import echo


@click.group()
def command() -> None:
    """Check a session, or say what is in it."""


@command.command()
@click.argument("session", type=click.Path(path_type=Path))
def verify(session: Path) -> int:
    """Check SESSION: its bytes, its audit trail, and its curves against what was recorded.

    Status 1 where something does not hold. The hash of the last audit entry binds all that was
    recorded: noted elsewhere, it shows even a session that was forged from end to end.

    \b
    Example: skinlab session verify visit.h5
    """
    from skinlab.recording.audit import entries
    from skinlab.recording.seal import Seal, read_seal
    from skinlab.recording.session_check import audit_head, check, complaints_about_changed

    if read_seal(session) is Seal.BROKEN:
        return _tell(session, complaints_about_changed(session))
    read, found = check(session)
    if found:
        return _tell(session, found)
    echo(f"{session}: unchanged; {len(read.curves)} curves, {len(read.records)} records")
    head = audit_head(read)
    if head is None:
        echo("  no audit trail")
    else:
        echo(f"  {len(entries(read.records))} audit entries, the last one's hash is {head}")
    return 0


def _tell(session: Path, found: list[str]) -> int:
    for sentence in found:
        echo(f"skinlab: {session}: {sentence}", err=True)
    return 1


@command.command()
@click.argument("session", type=click.Path(path_type=Path))
def info(session: Path) -> int:
    """Say what is in SESSION.

    \b
    Example: skinlab session info visit.h5
    """
    from skinlab.recording.audit import entries
    from skinlab.recording.dose import dose_of
    from skinlab.recording.session import read_session
    from skinlab.report.text import describe_dose

    read = read_session(session)
    meta = read.meta
    instrument = meta.get("instrument") or {}
    imported = meta.get("imported")
    done = "measured" if imported is None else "imported"
    echo(f"{session}: {done} {meta.get('created_utc')} with skinlab {meta.get('skinlab_version')}")
    echo(f"  subject {meta.get('subject') or '-'}, site {meta.get('site') or '-'}")
    if imported is None:
        simulated = " (SIMULATED)" if instrument.get("simulated") else ""
        echo(f"  instrument {instrument.get('model', '-')}{simulated} at {meta.get('url')}")
        dialect = meta.get("dialect") or {}
        if dialect:
            file = f", a file, sha256:{dialect['sha256']}" if "sha256" in dialect else ""
            echo(f"  dialect {dialect.get('name')}, version {dialect.get('version')}{file}")
        if meta.get("control"):
            echo(f"  read-only: {meta['control']}")
    else:
        files = "one file" if len(imported) == 1 else f"{len(imported)} files"
        echo(f"  from {files} of other software; no instrument was connected")
    if imported is None:
        echo(f"  {describe_dose(dose_of(read))}")
    for curve, result in zip(read.curves, read.results, strict=True):
        setup = curve.setup
        state = " partial" if curve.partial else ""
        echo(
            f"  {curve.name}: {setup.aperture_mm:g} mm, {setup.thickness_mm:g} mm skin, "
            f"{setup.program}, cycle {setup.cycle}, {len(curve)} samples{state}"
        )
        values = (result or {}).get("parameters") or {}
        if values:
            text = ", ".join(f"{name} {entry['value']:.4g}" for name, entry in values.items())
            error_um = (result or {}).get("error_um")
            echo(f"    {text}" + ("" if error_um is None else f", E {error_um:.3g} µm"))
    for entry in entries(read.records):
        detail = ", ".join(
            f"{key} {value}"
            for key, value in entry.detail.items()
            if value is not None and not isinstance(value, dict | list)
        )
        about = f": {detail}" if detail and entry.what != "session opened" else ""
        echo(f"  {entry.number:3d}  {entry.utc[:23]}  {entry.who}  {entry.what}{about}")
    return 0
