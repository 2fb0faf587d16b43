"""What a study's table is analysed by: conditions, facets, and the components of a quantity.

One opening and one program at a time. Stiffnesses scatter by a factor, so that they are taken in
logarithms (`scale` is `log`), and once more as they are (`linear`); all else is taken as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.names import is_logarithmic
from skinlab.recording.session_names import is_session_name
from skinlab.studies.components import Components, components
from skinlab.studies.design import WITHIN, Effect, effect
from skinlab.studies.facts import LABELS
from skinlab.studies.settings import NORMAL_90
from skinlab.studies.table import Cell, Columns
from skinlab.text import counted

Array = NDArray[np.float64]
Row = dict[str, Cell]

PEOPLE = ("subject", "subject:site")
NOT_STATED = "program not stated"
_DAY = re.compile(r"\d{4}-\d\d-\d\d")


@dataclass(frozen=True)
class Facet:
    """What is done anew when a skin is measured again."""

    name: str
    error: tuple[str, ...]
    words: str
    form: str  # the number that Shrout and Fleiss give such an intraclass correlation

    @property
    def same(self) -> tuple[str, ...]:
        """What stays part of the thing measured: the people, and the visit where it is one."""
        return PEOPLE if "visit" in self.error else (*PEOPLE, "visit")


PLACED = ("placement", WITHIN)
FACETS = (
    Facet("placement", PLACED, "placed anew: same visit, operator and probe", "1"),
    Facet("operator", ("operator", *PLACED), "another operator: same visit and probe", "2"),
    Facet("probe", ("probe", *PLACED), "another probe: same visit and operator", "2"),
    Facet("visit", ("visit", *PLACED), "another visit: same operator and probe", "2"),
    Facet(
        "anew",
        ("visit", "operator", "probe", *PLACED),
        "another visit, operator and probe",
        "2",
    ),
)


@dataclass(frozen=True, eq=False)
class Analysis:
    """One quantity under one opening and program, on one scale."""

    condition: str
    quantity: str
    scale: str
    people: int
    found: Components | None
    why: str | None  # why there are no components
    identification: float | None  # mean variance of single curves' own intervals

    @property
    def key(self) -> Row:
        """The columns that name it."""
        return {"condition": self.condition, "quantity": self.quantity, "scale": self.scale}

    def owns(self, row: Mapping[str, Cell]) -> bool:
        """Return whether a row of a table is of this analysis."""
        return all(row[name] == value for name, value in self.key.items())

    def facets(self) -> Iterator[Facet]:
        """Yield the facets of which the study can say something."""
        if self.found is None:
            return
        for facet in FACETS:
            own = [n for n in facet.error if n not in PLACED]
            if all(self.found.has(n) for n in own) or (
                facet.name == "anew" and sum(self.found.has(n) for n in own) >= 2
            ):
                yield facet


def main_scale(quantity: str) -> str:
    """Return the scale on which a quantity scatters most evenly."""
    return "log" if is_logarithmic(quantity) else "linear"


def usable(table: Columns) -> Columns:
    """Return the rows that count: whole curves, each file once, that tell some parameter."""
    once = table.text["same_as"] == ""
    whole = table.text["partial"] != "true"
    return table.where(once & whole & ~tells_nothing(table))


def tells_nothing(table: Columns) -> NDArray[np.bool_]:
    """Return of which rows (n,) no parameter is identified, as where the pump did not pull."""
    nothing = {f"not_identifiable:{name}" for name in table.parameters} or {""}
    flags = table.text["flags"].tolist()
    return np.array([nothing <= set(said.split()) for said in flags], dtype=bool)


def undated(table: Columns) -> NDArray[np.bool_]:
    """Return of which rows (n,) nobody said the day: of sessions that were imported without it.

    Each such session is a visit of its own, under its file's name: a session is one visit. It has
    no place among the person's first, second and so on.
    """
    pairs = zip(table.text["file"].tolist(), table.text["visit"].tolist(), strict=True)
    return np.array(
        [file == visit and is_session_name(PurePath(file)) for file, visit in pairs],
        dtype=bool,
    )


def without_a_day(table: Columns) -> Iterator[str]:
    """Yield how many sessions have no place in time, and what that means."""
    files = np.unique(table.text["file"][undated(table)])
    if files.size:
        yield (
            f"{counted(files.size, 'imported session')} without the day of the measurement: each "
            "is a visit of its own, in no order with the others (`skinlab import --measured` "
            "states the day)"
        )


def numbered(table: Columns) -> Columns:
    """Return the table with each person's days numbered, where visits are days, as sessions say.

    Else hardly two people have a visit in common, and no two visits could be held together.
    """
    subject, visit = table.text["subject"], table.text["visit"]
    rows = list(zip(subject.tolist(), visit.tolist(), undated(table).tolist(), strict=True))
    days: dict[str, set[str]] = {}
    for who, day, without in rows:
        if without:
            continue
        if not _DAY.fullmatch(day):
            return table
        days.setdefault(who, set()).add(day)
    number = {
        (who, day): str(k) for who, own in days.items() for k, day in enumerate(sorted(own), 1)
    }
    numbers = [day if without else number[who, day] for who, day, without in rows]
    return Columns({**table.text, "visit": np.array(numbers, dtype=str)}, table.names)


def conditions(table: Columns) -> Iterator[tuple[str, Columns]]:
    """Yield the openings and programs of a table with their rows, the most frequent first."""
    names = np.array(
        [
            f"{float(a):g} mm, {p or NOT_STATED}"
            for a, p in zip(
                table.text["aperture_mm"].tolist(), table.text["program"].tolist(), strict=True
            )
        ],
        dtype=str,
    )
    found, counts = np.unique(names, return_counts=True)
    for name in found[np.argsort(-counts, kind="stable")].tolist():
        yield name, table.where(names == name)


def effects_of(table: Columns) -> list[Effect]:
    """Return the random effects that the labels of a table describe."""
    subject, visit, site, operator, probe, placement = (table.text[n] for n in LABELS)
    several_sites = len(np.unique(site)) > 1
    effects = [effect("subject", subject)]
    if several_sites:
        effects += [effect("site", site), effect("subject:site", subject, site)]
    effects += [
        effect("visit", subject, visit),
        effect("operator", operator),
        effect("probe", probe),
        effect("placement", subject, visit, site, operator, probe, placement),
    ]
    return effects


def cycles_of(table: Columns) -> Array | None:
    """Return columns (n, k) of fixed effects: later cycles of a site differ from its first."""
    cycle = table.text["cycle"]
    later = np.unique(cycle)[1:]
    if not later.size:
        return None
    return np.asarray(cycle[:, None] == later[None], dtype=float)


def analysis_of(
    condition: str, quantity: str, scale: str, table: Columns, y: Array, seed: int
) -> Analysis:
    """Return the analysis of the values (n,) of a quantity, on this scale, in these rows."""
    found, why = None, None
    people = len(np.unique(table.text["subject"]))
    try:
        found = components(y, effects_of(table), cycles_of(table), seed=seed)
    except ValueError as error:
        why = f"{quantity}, {condition}: no components of variance ({error})"
    return Analysis(
        condition, quantity, scale, people, found, why, _identification(table, quantity, scale)
    )


def _identification(table: Columns, quantity: str, scale: str) -> float | None:
    """Return the mean variance that single curves' own intervals state."""
    if quantity not in table.parameters:
        return None
    low, high = table.number(f"{quantity}_low"), table.number(f"{quantity}_high")
    if scale == "log":
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = np.log(low), np.log(high)
    variance = np.square((high - low) / (2 * NORMAL_90))
    variance = variance[np.isfinite(variance)]
    return float(variance.mean()) if variance.size else None
