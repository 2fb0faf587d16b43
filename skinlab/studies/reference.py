"""Reference ranges as data: what is usual at a site, by age and sex, under one opening and program.

REFERENCE.toml is documented in docs/study.md. None ships: published tables are not ours to copy.
A range is made from your own study, or typed in from a publication, with its source and licence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from scipy.stats import norm

from drivers.numbers import number_in
from drivers.reading import read_whole
from skinlab.curves.apertures import check_aperture
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.io.documents import decode, of_schema, read_toml, toml_text
from skinlab.io.files import named_in_errors
from skinlab.report.page import Section, Table
from skinlab.studies.analysis import main_scale, usable
from skinlab.studies.settings import REFERENCES
from skinlab.studies.table import Columns

SCHEMA = "skinlab.reference/1"
ANY = "any"

_Test = Callable[["Range"], bool]
_Known = Callable[[Sequence["Range"]], str]
_NO_PROGRAM = "not stated (a campaign.toml states it, or `skinlab import --program`)"


class Range(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One quantity at one site: its percentiles among n people."""

    quantity: str
    site: str
    aperture_mm: float
    program: str
    percentiles: dict[str, float]
    n: Annotated[int, Meta(ge=1)]
    source: str = ""
    licence: str = ""
    sex: str = ANY
    age_years: tuple[float, float] | None = None
    model_hash: str | None = None  # of identified parameters: another law means other numbers

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        check_aperture(self.aperture_mm)
        parse_program(self.program)
        if len(self.percentiles) < 2:
            raise ValueError("percentiles: expected at least two")
        at, values = self.points
        if not (at[0] > 0 and at[-1] < 100):
            raise ValueError("percentiles: expected numbers between 0 and 100")
        if any(b <= a for a, b in pairwise(values)):
            raise ValueError("percentiles: the values must increase")
        if self.age_years is not None and not 0 <= self.age_years[0] < self.age_years[1]:
            raise ValueError("age_years: expected [from, to]")

    @property
    def points(self) -> tuple[list[float], list[float]]:
        """The percentiles and their values, in order."""
        try:
            pairs = sorted((number_in(p), float(v)) for p, v in self.percentiles.items())
        except ValueError:
            raise ValueError("percentiles: expected names such as '5'") from None
        return [p for p, _ in pairs], [v for _, v in pairs]

    @property
    def span(self) -> tuple[float, float]:
        """The values of the outermost percentiles."""
        _, values = self.points
        return values[0], values[-1]

    @property
    def narrowed(self) -> int:
        """By how many of sex and age it is of some people only."""
        return (self.sex != ANY) + (self.age_years is not None)

    @property
    def words(self) -> str:
        """Whom it describes."""
        parts = [self.site]
        if self.sex != ANY:
            parts.append({"f": "women", "m": "men"}.get(self.sex, self.sex))
        if self.age_years is not None:
            parts.append(f"{self.age_years[0]:g} to {self.age_years[1]:g} years")
        return f"{', '.join(parts)}, n = {self.n}"


class Reference(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A whole REFERENCE.toml; `source` and `licence` hold for ranges without their own."""

    schema: str
    range: list[Range]
    title: str = ""
    source: str = ""
    licence: str = ""

    def __post_init__(self) -> None:
        """Refuse what nobody could check."""
        if self.schema != SCHEMA:
            raise ValueError(f"schema: {self.schema!r}, expected {SCHEMA!r}")
        for number, one in enumerate(self.range, start=1):
            for name in ("source", "licence"):
                if not (getattr(one, name) or getattr(self, name)):
                    raise ValueError(f"range {number}: {name} is missing")


@dataclass(frozen=True)
class Placed:
    """Where a value stands: its percentile, or beyond the outermost one that is known."""

    quantity: str
    percentile: float
    beyond: str  # "", "below" or "above": the percentile is then the outermost one
    range: Range
    source: str

    @property
    def words(self) -> str:
        """The same as a sentence's part."""
        at = f"{_ordinal(self.percentile)} percentile"
        return f"{self.beyond} the {at}" if self.beyond else f"at the {at}"

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "percentile": self.percentile,
            "beyond": self.beyond or None,
            "of": self.range.words,
            "source": self.source,
        }


def read_reference(path: Path) -> Reference:
    """Return the ranges of a file.

    Raises:
        InputError: it cannot be read, or a field is unknown, missing or wrong.
    """
    with named_in_errors(path):
        return decode(of_schema(read_toml(read_whole(path)), SCHEMA), Reference)


def to_toml(reference: Reference) -> str:
    """Return the file's text."""
    return toml_text(_plain(msgspec.to_builtins(reference)))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items() if v != ""}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


def place(
    reference: Reference,
    values: Mapping[str, float],
    *,
    site: str,
    aperture_mm: float,
    program: str | None,
    sex: str | None = None,
    age_years: float | None = None,
    model_hash: str | None = None,
) -> list[Placed]:
    """Return where values (by quantity) stand.

    Raises:
        InputError: no range is of this site, or none of them of this opening, program, model, sex
            or age: nothing is compared with what it cannot be compared with.
    """
    here = [r for r in reference.range if r.site == site]
    if not here:
        sites = ", ".join(sorted({r.site for r in reference.range})) or "none"
        raise InputError(f"the reference has no site {site!r}; expected one of: {sites}")
    asked = str(parse_program(program)) if program else None
    tests: tuple[tuple[str, _Test, _Known], ...] = (
        (f"an opening of {aperture_mm:g} mm", lambda r: r.aperture_mm == aperture_mm, _openings),
        (
            f"the program {asked or _NO_PROGRAM}",
            lambda r: str(parse_program(r.program)) == asked,
            _programs,
        ),
        (
            "this model",
            lambda r: model_hash is None or r.model_hash in (None, model_hash),
            _models,
        ),
        (f"sex {sex or 'not stated'}", lambda r: r.sex in (ANY, sex), _sexes),
        (
            "an age that is not stated" if age_years is None else f"an age of {age_years:g} years",
            lambda r: (
                r.age_years is None
                or (age_years is not None and r.age_years[0] <= age_years < r.age_years[1])
            ),
            _ages,
        ),
    )
    for words, fits, known in tests:
        left = [r for r in here if fits(r)]
        if not left:
            raise InputError(
                f"the reference has nothing for {site} with {words}; it has {known(here)}"
            )
        here = left
    best: dict[str, Range] = {}
    for one in here:  # a range for this sex and age says more than one for all
        other = best.get(one.quantity)
        if other is None or one.narrowed > other.narrowed:
            best[one.quantity] = one
    return [
        _placed(reference, one, values[name])
        for name, one in best.items()
        if name in values and math.isfinite(values[name])
    ]


def _openings(ranges: Sequence[Range]) -> str:
    return ", ".join(f"{a:g} mm" for a in sorted({r.aperture_mm for r in ranges}))


def _programs(ranges: Sequence[Range]) -> str:
    return ", ".join(sorted({r.program for r in ranges}))


def _models(ranges: Sequence[Range]) -> str:
    return ", ".join(sorted({str(r.model_hash) for r in ranges}))


def _sexes(ranges: Sequence[Range]) -> str:
    return ", ".join(sorted({r.sex for r in ranges}))


def _ages(ranges: Sequence[Range]) -> str:
    return ", ".join(
        f"{a:g} to {b:g}" for a, b in sorted({r.age_years for r in ranges if r.age_years})
    )


def _placed(reference: Reference, one: Range, value: float) -> Placed:
    at, values = one.points
    source = one.source or reference.source
    if value < values[0]:
        return Placed(one.quantity, at[0], "below", one, source)
    if value > values[-1]:
        return Placed(one.quantity, at[-1], "above", one, source)
    logs = main_scale(one.quantity) == "log" and values[0] > 0
    x = np.log(values) if logs else np.array(values)
    # Straight between the points where percentiles are drawn as normal deviates.
    deviate = np.interp(math.log(value) if logs else value, x, norm.ppf(np.array(at) / 100))
    return Placed(one.quantity, round(100 * float(norm.cdf(deviate)), 1), "", one, source)


def _ordinal(number: float) -> str:
    whole = round(number)
    last = "th" if 10 <= whole % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(whole % 10, "th")
    return f"{whole}{last}"


def section(found: Sequence[tuple[str, Sequence[Placed] | str]]) -> Section:
    """Return what a report says: of each curve, by name, where it stands, or why it is refused."""
    rows = [
        [name, one.quantity, one.words, one.range.words, one.source]
        for name, placed in found
        if not isinstance(placed, str)
        for one in placed
    ]
    head = ["curve", "quantity", "stands", "among", "source"]
    return Section(
        "Beside a reference",
        [
            "A percentile among others is not a diagnosis; the value's interval may span many.",
            *(f"{name}: not compared, {why}." for name, why in found if isinstance(why, str)),
        ],
        tables=[Table(head, rows)] if rows else [],
    )


def reference_of(
    table: Columns, title: str, *, bands: Sequence[tuple[float, float]] = (), by_sex: bool = False
) -> tuple[Reference | None, list[str]]:
    """Return the ranges of a study, one person one value, and what could not be made of it.

    People count with the mean of their curves at a site (of logarithms where those are compared).
    """
    kept = usable(table)
    ranges: list[Range] = []
    missing: list[str] = []
    ages = kept.number("age_years") if "age_years" in kept.names else None
    sexes = kept.text["sex"] if "sex" in kept.names else None
    bands_of: list[tuple[float, float] | None] = [None, *(bands if ages is not None else ())]
    sexes_of = [ANY, *(["f", "m"] if by_sex and sexes is not None else [])]
    keys = sorted(
        set(zip(*(kept.text[n].tolist() for n in ("site", "aperture_mm", "program")), strict=True))
    )
    for site, aperture, program in keys:
        if not program:
            missing.append(f"{site or 'no site'}: no reference range, the program is not stated")
            continue
        here = (
            (kept.text["site"] == site)
            & (kept.text["aperture_mm"] == aperture)
            & (kept.text["program"] == program)
        )
        for band, sex in product(bands_of, sexes_of):
            mask = here
            if band is not None and ages is not None:
                mask = mask & (ages >= band[0]) & (ages < band[1])
            if sex != ANY and sexes is not None:
                mask = mask & (sexes == sex)
            rows = kept.where(mask)
            people = len(np.unique(rows.text["subject"]))
            if not people:
                continue
            if people < REFERENCES.fewest_people:
                who = f"{band[0]:g} to {band[1]:g} years" if band else "all ages"
                missing.append(
                    f"{site or 'no site'}, {float(aperture):g} mm, {program}, {who}, sex {sex}: "
                    f"no reference range of {people} people; expected at least "
                    f"{REFERENCES.fewest_people}"
                )
                continue
            for quantity in kept.quantities:
                one = _range(rows, quantity, site or "not stated", aperture, program, sex, band)
                if one is not None:
                    ranges.append(one)
    if not ranges:
        return None, missing
    made = Reference(
        schema=SCHEMA,
        title=title,
        source=f"own study: {title}",
        licence="of the study's owner; not to be passed on unless they say so",
        range=ranges,
    )
    return made, missing


def _range(
    rows: Columns,
    quantity: str,
    site: str,
    aperture: str,
    program: str,
    sex: str,
    band: tuple[float, float] | None,
) -> Range | None:
    values = rows.number(quantity)
    logs = main_scale(quantity) == "log"
    there = np.isfinite(values) & ((values > 0) if logs else True)
    y = np.log(values[there]) if logs else values[there]
    _, at = np.unique(rows.text["subject"][there], return_inverse=True)
    if not at.size or int(at.max()) + 1 < REFERENCES.fewest_people:
        return None
    means = np.bincount(at, y) / np.bincount(at)
    shares = REFERENCES.percentiles
    found = np.percentile(means, shares)
    found = np.exp(found) if logs else found
    if not (np.diff(found) > 0).all():
        return None
    model = rows.text["model_hash"][0] if quantity in rows.parameters else None
    return Range(
        quantity=quantity,
        site=site,
        aperture_mm=float(aperture),
        program=program,
        percentiles={str(p): float(f"{v:.6g}") for p, v in zip(shares, found, strict=True)},
        n=len(means),
        sex=sex,
        age_years=band,
        model_hash=None if model is None else str(model),
    )
