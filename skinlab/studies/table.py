"""The tidy table: a row a curve, as CSV and as Parquet, and back into columns.

Rows are written as they come from the state: memory does not grow with their number.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from drivers.numbers import number_in
from drivers.reading import read_whole
from skinlab.curves.cutometer import FORMULAS
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.io.documents import text_of
from skinlab.io.files import whole_file, whole_text
from skinlab.mechanics.materials import get_law
from skinlab.recording.recorder import identification_settings
from skinlab.recording.session_names import is_session_name
from skinlab.studies.copies import Held, copies_of
from skinlab.studies.facts import LABELS, SETUP, pseudonym
from skinlab.studies.state import State, Stored
from skinlab.text import csv_cell, inert, needs
from skinlab.versions import versions

Array = NDArray[np.float64]
Cell = str | int | float | bool | None

STEP_NUMBERS = tuple(FORMULAS)
_ANSWER = ("error_um", "rms_um", "noise_um")
_GROUP_ROWS = 10_000  # of a Parquet file, held in memory at a time
TEXT = frozenset(
    {"file", "curve", "sha256", *LABELS, "program", "flags", "error", "method", "model"}
    | {"model_hash", "database_hash", "skinlab_version", "code", "numpy", "scipy", "same_as"}
)


@dataclass(frozen=True)
class Layout:
    """The columns of a study's table: parameters and covariates differ from study to study."""

    parameters: tuple[str, ...]
    derived: tuple[str, ...]  # what the law's reports show besides
    covariates: tuple[str, ...]
    steps: bool  # whether any curve has the Cutometer's numbers

    @property
    def columns(self) -> tuple[str, ...]:
        """Their names, in order."""
        return (
            "file",
            "curve",
            *LABELS,
            *SETUP,
            "points",
            "fitted_points",
            "partial",
            *(f"{name}{end}" for name in self.parameters for end in ("", "_low", "_high")),
            *self.derived,
            *_ANSWER,
            *(STEP_NUMBERS if self.steps else ()),
            "flags",
            "error",
            *self.covariates,
            "method",
            "seed",
            "model",
            "model_hash",
            "database_hash",
            "skinlab_version",
            "code",
            "numpy",
            "scipy",
            "sha256",
            "same_as",
        )


def layout_of(state: State, law: str) -> Layout:
    """Return the columns that the curves of a study need."""
    derived = get_law(law).derived_names
    parameters: dict[str, None] = {}
    covariates: set[str] = set()
    steps = False
    for stored in state.curves():
        parameters |= dict.fromkeys(stored.said["result"].get("order") or ())
        covariates |= stored.facts.keys()
        steps = steps or bool(stored.said["step"])
    for facts in state.people().values():
        covariates |= facts.keys()
    fixed = Layout(tuple(parameters), derived, (), True).columns
    names = sorted(covariates - {*fixed, "noise_um", "pressure_noise_mbar"})
    return Layout(tuple(parameters), derived, tuple(names), steps)


def rows(state: State, layout: Layout, identifier: Identifier) -> Iterator[dict[str, Cell]]:
    """Yield the rows of the table, in the order of the files."""
    same = _constant(identifier)
    people = state.people()
    copies = copies_of(held(stored) for stored in state.curves())
    placements = Placements()
    for stored in state.curves():
        row = _row(stored, layout, people) | same
        row["same_as"] = copies.get((stored.source, stored.number))
        row["placement"] = placements.of(row)
        yield row


def held(stored: Stored) -> Held:
    """Return what tells a stored curve from others."""
    labelled = bool({**stored.said["known"], **stored.facts}.get("subject"))
    readings = stored.said["readings"]
    return Held(stored.source, stored.number, stored.sha256, readings, labelled)


class Placements:
    """Numbers the placements where nothing states them.

    A curve begins one, unless its cycle is above that of the one before, within subject, visit,
    site, operator, probe and opening, in the order of the files.
    """

    def __init__(self) -> None:
        self._count: dict[tuple[Cell, ...], int] = {}
        self._cycle: dict[tuple[Cell, ...], int] = {}

    def of(self, row: Mapping[str, Cell]) -> str:
        """Return the placement of the next row."""
        stated = row["placement"]
        if stated not in (None, ""):
            return str(stated)
        names = ("subject", "visit", "site", "operator", "probe", "aperture_mm")
        key = tuple(row[n] for n in names)
        cycle = int(row["cycle"] or 1)
        if cycle <= self._cycle.get(key, cycle):
            self._count[key] = self._count.get(key, 0) + 1
        self._cycle[key] = cycle
        return str(self._count[key])


def _constant(identifier: Identifier) -> dict[str, Cell]:
    """Return the columns that are the same in all rows."""
    provenance, settings = identifier.provenance(), identification_settings(identifier)
    now = versions()
    return {
        "method": provenance.method,
        "seed": settings["seed"],
        "model": provenance.model_name,
        "model_hash": provenance.model_hash,
        "database_hash": provenance.database_hash,
        "skinlab_version": now["skinlab"],
        "code": now["code"],
        "numpy": now["numpy"],
        "scipy": now["scipy"],
    }


def _row(
    stored: Stored, layout: Layout, people: Mapping[str, Mapping[str, Any]]
) -> dict[str, Cell]:
    said, answer = stored.said, stored.said["result"]
    known = {**said["known"], **stored.facts}  # what tables and paths say comes before the session
    row: dict[str, Cell] = dict.fromkeys(layout.columns)
    row["file"], row["curve"], row["sha256"] = stored.source, said["curve"], stored.sha256
    for name in LABELS:
        row[name] = known.get(name)
    if not row["visit"] and is_session_name(Path(stored.source)):
        row["visit"] = stored.source  # see `analysis.undated`
    if row["subject"]:
        row["subject"] = pseudonym(str(row["subject"]))
    row |= said["setup"]
    row["points"], row["fitted_points"] = answer["points"], answer["fitted_points"]
    row["partial"] = said["partial"]
    for name, value in (answer["parameters"] or {}).items():
        row[name], row[f"{name}_low"], row[f"{name}_high"] = (
            value["value"],
            value["low"],
            value["high"],
        )
    for name in (*layout.derived, *_ANSWER):
        row[name] = answer.get(name)
    row |= said["step"] if layout.steps else {}
    row["flags"] = " ".join(answer["flags"])
    row["error"] = answer["error"]
    facts = {**people.get(str(row["subject"]), {}), **known}
    for name in layout.covariates:
        row[name] = facts.get(name)
    return {n: inert(value) if isinstance(value, str) else value for n, value in row.items()}


def write_csv(path: Path, columns: Sequence[str], found: Iterable[Mapping[str, Cell]]) -> int:
    """Write rows; the file appears whole or not at all. Return how many there were."""
    count = 0
    with whole_text(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in found:
            writer.writerow([_cell(row.get(name)) for name in columns])
            count += 1
    return count


def _cell(value: Cell) -> Cell:
    if isinstance(value, bool):
        return str(value).lower()
    return cast(Cell, csv_cell(value))


NO_PARQUET = f"{needs('curves.parquet needs', 'pyarrow', 'study')} (curves.csv has the same table)"


def write_parquet(path: Path, layout: Layout, found: Iterator[dict[str, Cell]]) -> bool:
    """Write rows as Parquet, some thousands at a time; return False where pyarrow is missing.

    Raises:
        InputError: it cannot be written.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        return False
    whole = {"cycle", "repeat", "points", "fitted_points", "seed"}
    text = TEXT | set(layout.covariates)
    schema = pa.schema(
        [
            pa.field(
                name,
                pa.string()
                if name in text
                else pa.int64()
                if name in whole
                else pa.bool_()
                if name == "partial"
                else pa.float64(),
            )
            for name in layout.columns
        ]
    )
    with (
        whole_file(path, replace=True) as partial,
        partial.open("r+b") as stream,  # here: Arrow opens no name that is not UTF-8
        pq.ParquetWriter(stream, schema) as writer,
    ):
        while group := list(islice(found, _GROUP_ROWS)):
            for row in group:
                row.update({n: str(row[n]) for n in text if row.get(n) is not None})
            writer.write_table(pa.Table.from_pylist(group, schema))
    return True


# ---- back into columns ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Columns:
    """A tidy table in memory: text by column (n,), and numbers by column (n,), NaN where none."""

    text: Mapping[str, NDArray[np.str_]]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(next(iter(self.text.values()), ()))

    def number(self, name: str) -> Array:
        """Return a column (n,) as numbers; NaN where it has none."""
        return np.array([_number(v) for v in self.text[name].tolist()], dtype=float)

    def where(self, mask: NDArray[np.bool_]) -> Columns:
        """Return the rows of a mask (n,)."""
        return Columns({k: v[mask] for k, v in self.text.items()}, self.names)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The identified parameters: columns that have an interval beside them."""
        return tuple(
            n for n in self.names if f"{n}_low" in self.names and f"{n}_high" in self.names
        )

    @property
    def quantities(self) -> tuple[str, ...]:
        """Parameters, and the Cutometer's numbers where there are any."""
        return (*self.parameters, *(n for n in STEP_NUMBERS if n in self.names))


def _number(text: str) -> float:
    try:
        return number_in(text)
    except ValueError:
        return math.nan


def read_columns(path: Path) -> Columns:
    """Return the table of a curves.csv.

    Raises:
        InputError: it cannot be read, or is no such table.
    """
    try:
        reader = csv.reader(io.StringIO(text_of(read_whole(path)), newline=""))
        names = tuple(next(reader, []))
        body = list(reader)
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: {error}") from None
    if "file" not in names or "subject" not in names:
        raise InputError(f"{path}: expected the curves.csv of a study")
    for line, row in enumerate(body, start=2):
        if len(row) != len(names):
            raise InputError(f"{path}: line {line}: {len(row)} fields, expected {len(names)}")
    columns = list(zip(*body, strict=True)) or [()] * len(names)
    return Columns({n: np.array(c, dtype=str) for n, c in zip(names, columns, strict=True)}, names)
