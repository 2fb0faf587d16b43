"""A whole study: from folders to the table and all that is made from it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinlab.inference.identify import Identifier
from skinlab.study.run import How, settings_of, update
from skinlab.study.sources import Plan
from skinlab.study.state import State
from skinlab.study.table import (
    NO_PARQUET,
    layout_of,
    rows,
    write_csv,
    write_parquet,
    write_text,
)
from skinlab.versions import versions

SCHEMA = "skinlab.study/1"


@dataclass(frozen=True)
class Made:
    """What a study says: the document, the same in lines, and what a user should know besides."""

    document: dict[str, Any]
    lines: tuple[str, ...]
    notices: tuple[str, ...]
    failures: int


def make_study(
    plan: Plan, out: Path, identifier: Identifier, how: How, *, resume: bool, explain: bool
) -> Made:
    """Bring the study in `out` up to date with the folders, and write all its files.

    Raises:
        InputError: a folder does not exist, `out` cannot be written, or holds something else.
    """
    notices: list[str] = []
    with State(out) as state:
        update(state, plan, identifier, how, resume=resume)
        layout = layout_of(state)
        count = write_csv(out / "curves.csv", layout.columns, rows(state, layout, identifier))
        if not write_parquet(out / "curves.parquet", layout, rows(state, layout, identifier)):
            notices.append(NO_PARQUET)
        failures = [{"file": name, "reason": reason} for name, reason in state.failures()]
    write_csv(out / "failures.csv", ("file", "reason"), failures)
    files = ["curves.csv", "curves.parquet", "failures.csv"]
    document = {
        "schema": SCHEMA,
        "folder": str(out),
        "curves": count,
        "failures": failures,
        "settings": json.loads(settings_of(identifier)),
        "versions": versions(),
        "files": [name for name in files if (out / name).exists()],
    }
    write_text(out / "study.json", json.dumps(document, indent=1, allow_nan=False) + "\n")
    lines = [f"{count} curves in {out / 'curves.csv'}"]
    if failures:
        lines.append(f"{len(failures)} files could not be used: {out / 'failures.csv'}")
    return Made(document, tuple(lines), tuple(notices), len(failures))
