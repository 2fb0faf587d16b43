"""`skinlab session`: check a session, or say what is in it."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def command() -> None:
    """Check a session, or say what is in it."""


@command.command()
@click.argument("session", type=click.Path(path_type=Path))
def verify(session: Path) -> int:
    """Check that SESSION says what it said when it was written.

    \b
    Example: skinlab session verify visit.h5
    """
    from skinlab.session import read_session

    read = read_session(session)
    click.echo(f"{session}: unchanged; {len(read.curves)} curves, {len(read.records)} records")
    return 0


@command.command()
@click.argument("session", type=click.Path(path_type=Path))
def info(session: Path) -> int:
    """Say what is in SESSION.

    \b
    Example: skinlab session info visit.h5
    """
    from skinlab.session import read_session

    read = read_session(session)
    meta = read.meta
    instrument = meta.get("instrument") or {}
    imported = meta.get("imported")
    done = "measured" if imported is None else "imported"
    click.echo(
        f"{session}: {done} {meta.get('created_utc')} with skinlab {meta.get('skinlab_version')}"
    )
    click.echo(f"  subject {meta.get('subject') or '-'}, site {meta.get('site') or '-'}")
    if imported is None:
        simulated = " (SIMULATED)" if instrument.get("simulated") else ""
        click.echo(f"  instrument {instrument.get('model', '-')}{simulated} at {meta.get('url')}")
    else:
        files = "one file" if len(imported) == 1 else f"{len(imported)} files"
        click.echo(f"  from {files} of other software; no instrument was connected")
    for curve, result in zip(read.curves, read.results, strict=True):
        setup = curve.setup
        state = " partial" if curve.partial else ""
        click.echo(
            f"  {curve.name}: {setup.aperture_mm:g} mm, {setup.thickness_mm:g} mm skin, "
            f"{setup.program}, cycle {setup.cycle}, {len(curve)} samples{state}"
        )
        values = (result or {}).get("parameters") or {}
        if values:
            text = ", ".join(f"{name} {entry['value']:.4g}" for name, entry in values.items())
            click.echo(f"    {text}, E {result['error_um']:.3g} µm" if result else "")
    return 0
