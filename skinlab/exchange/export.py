"""A session as tidy files, for whoever reads it with other tools."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.io.documents import toml_text
from skinlab.io.files import write_file
from skinlab.mechanics.names import is_effects, of_law
from skinlab.recording.clocks import clock_readings
from skinlab.recording.labels import LABELS, labels_of
from skinlab.recording.session import Session, stated_noise
from skinlab.recording.session_fit import excluded_of, left_out_of
from skinlab.recording.stream import setup_to_json
from skinlab.text import csv_cell, inert, json_text

SCHEMA = "skinlab.export/1"


def to_json(session: Session, file: str | None = None) -> dict[str, str]:
    """Return the one file: what is known of the session, its curves and their results.

    `file` is the session's own name, without folders; None: it is of no file.
    """
    clocks = clock_readings(session.meta, session.records) or (None,) * len(session.curves)
    curves = [
        {
            "name": curve.name,
            "partial": curve.partial,
            "setup": setup_to_json(curve.setup),
            "time_s": curve.time_s.tolist(),
            "pressure_mbar": curve.pressure_mbar.tolist(),
            "deflection_mm": curve.deflection_mm.tolist(),
            "segment": None if curve.segment is None else curve.segment.tolist(),
            "phase": curve.phase.tolist(),
            "result": result,
            "clock": None if clock is None else clock.to_json(),
        }
        for curve, result, clock in zip(session.curves, session.results, clocks, strict=True)
    ]
    whole = {"schema": SCHEMA, "session_file": file, "meta": session.meta, "curves": curves}
    return {"session.json": json_text(whole) + "\n"}


def to_csv(session: Session, file: str | None = None) -> dict[str, str]:
    """Return a file for each curve, one with a row for each, and a campaign of them.

    The curves' numbers are written so that they read back as the same bits. The folder can be given
    to `identify` or `discrepancy` as a campaign of the curves that count together, and to `study`.
    `file` is the session's own name, as of `to_json`.
    """
    files = {_file(k): _curve_csv(curve) for k, curve in enumerate(session.curves, start=1)}
    files["curves.csv"] = _overview(session, file)
    if session.curves:
        files["campaign.toml"] = _campaign(session)
    return files


FORMATS: dict[str, Callable[[Session, str | None], dict[str, str]]] = {
    "csv": to_csv,
    "json": to_json,
}


def export(session: Session, kind: str, folder: Path, file: str | None = None) -> list[Path]:
    """Write the files of this kind into the folder; return their paths.

    They say that the session is of this `file` (None: of none).

    Raises:
        InputError: one of them exists already, or cannot be written.
    """
    return write_new(
        folder, {name: text.encode("utf-8") for name, text in FORMATS[kind](session, file).items()}
    )


def check_free(folder: Path, names: Iterable[str]) -> None:
    """Make sure that nothing would be overwritten.

    Raises:
        InputError: a file of such a name is in the folder, or the folder is none.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: cannot be written (it is not a folder)")
    for name in names:
        if (folder / name).exists():
            raise InputError(f"{folder / name}: exists already; expected a folder without it")


def write_new(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write files into the folder, which is made where it is missing; return their paths.

    Raises:
        InputError: one of them exists already, or cannot be written.
    """
    check_free(folder, files)
    for name, content in files.items():
        write_file(folder / name, content)
    return [folder / name for name in files]


def _file(number: int) -> str:
    return f"curve_{number:04d}.csv"


def _curve_csv(curve: Curve) -> str:
    segment = [""] * len(curve) if curve.segment is None else curve.segment.tolist()
    columns = (
        curve.time_s.tolist(),
        curve.pressure_mbar.tolist(),
        curve.deflection_mm.tolist(),
        segment,
        curve.phase.tolist(),
    )
    header = ("time_s", "pressure_mbar", "deflection_mm", "segment", "phase")
    return _csv([header, *zip(*columns, strict=True)])


def _overview(session: Session, file: str | None) -> str:
    setup_columns = ("aperture_mm", "thickness_mm", "thickness_sd_mm", "program", "cycle", "repeat")
    results = [result or {} for result in session.results]
    found_names = [result.get("parameters") or () for result in results]
    effects = dict.fromkeys(n for names in found_names for n in names if is_effects(n))
    names = (*of_law(found_names), *effects)
    header = (
        "file", "name", "samples", "partial", *setup_columns,
        *(f"{name}{end}" for name in names for end in ("", "_low", "_high")),
        "error_um", "rms_um", "flags", "not_identified", "left_out", "placement", *LABELS,
        "session_file",
    )  # fmt: skip
    out, whose = excluded_of(session), labels_of(session)
    labels = [whose.get(name) for name in LABELS]
    rows: list[Any] = [header]
    for number, (curve, result) in enumerate(
        zip(session.curves, session.results, strict=True), start=1
    ):
        setup = setup_to_json(curve.setup)
        found = result or {}
        values = found.get("parameters") or {}
        row = [_file(number), curve.name, len(curve), str(curve.partial).lower()]
        row += [setup[name] for name in setup_columns]
        for name in names:
            row += [values.get(name, {}).get(key) for key in ("value", "low", "high")]
        row += [found.get("error_um"), found.get("rms_um"), " ".join(found.get("flags") or [])]
        row += [found.get("error"), out.get(curve.name), curve.setup.placement]
        rows.append([*row, *labels, file])
    return _csv(rows)


def _csv(rows: list[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([csv_cell(c) for c in row] for row in rows)
    return text.getvalue()


def _campaign(session: Session) -> str:
    noise_um, pressure_noise_mbar = stated_noise(session.meta)
    out = left_out_of(session)
    numbered = list(enumerate(session.curves, start=1))
    used = [(number, curve) for number, curve in numbered if curve.name not in out]
    return toml_text(
        {
            "campaign": {
                "title": inert(str(session.meta.get("site") or "exported")),
                "noise_um": noise_um,
                "pressure_noise_mbar": pressure_noise_mbar,
            },
            "curve": [
                {"file": _file(number)} | setup_to_json(curve.setup)
                for number, curve in used or numbered  # a campaign has one at least
            ],
        }
    )
