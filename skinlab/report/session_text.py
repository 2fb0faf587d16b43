"""What is in a session, in words."""

from __future__ import annotations

from pathlib import Path

from skinlab.recording.audit import entries
from skinlab.recording.dose import dose_of
from skinlab.recording.session import Session
from skinlab.report.text import describe_dose
from skinlab.text import inert


def describe_session(path: Path, session: Session) -> str:
    """Return the text: where it is from, its curves with their results, and the audit trail."""
    lines: list[str] = []

    def tell(line: str) -> None:
        lines.append(inert(line))

    meta = session.meta
    instrument = meta.get("instrument") or {}
    imported = meta.get("imported")
    done = "measured" if imported is None else "imported"
    tell(f"{path}: {done} {meta.get('created_utc')} with skinlab {meta.get('skinlab_version')}")
    tell(f"  subject {meta.get('subject') or '-'}, site {meta.get('site') or '-'}")
    if imported is None:
        simulated = " (SIMULATED)" if instrument.get("simulated") else ""
        tell(f"  instrument {instrument.get('model', '-')}{simulated} at {meta.get('url')}")
        dialect = meta.get("dialect") or {}
        if dialect:
            file = f", a file, sha256:{dialect['sha256']}" if "sha256" in dialect else ""
            tell(f"  dialect {dialect.get('name')}, version {dialect.get('version')}{file}")
        if meta.get("control"):
            tell(f"  read-only: {meta['control']}")
    else:
        files = "one file" if len(imported) == 1 else f"{len(imported)} files"
        tell(f"  from {files} of other software; no instrument was connected")
    if imported is None:
        tell(f"  {describe_dose(dose_of(session))}")
    for curve, result in zip(session.curves, session.results, strict=True):
        setup = curve.setup
        state = " partial" if curve.partial else ""
        tell(
            f"  {curve.name}: {setup.aperture_mm:g} mm, {setup.thickness_mm:g} mm skin, "
            f"{setup.program}, cycle {setup.cycle}, {len(curve)} samples{state}"
        )
        values = (result or {}).get("parameters") or {}
        if values:
            text = ", ".join(f"{name} {entry['value']:.4g}" for name, entry in values.items())
            error_um = (result or {}).get("error_um")
            tell(f"    {text}" + ("" if error_um is None else f", E {error_um:.3g} µm"))
    for entry in entries(session.records):
        detail = ", ".join(
            f"{key} {value}"
            for key, value in entry.detail.items()
            if value is not None
            and not isinstance(value, dict | list)
            and not (entry.what == "protocol" and key == "text")
        )
        about = f": {detail}" if detail and entry.what != "session opened" else ""
        tell(f"  {entry.number:3d}  {entry.utc[:23]}  {entry.who}  {entry.what}{about}")
    return "\n".join(lines)
