"""A whole study: from folders to the table and all that is made from it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from skinlab.errors import InputError
from skinlab.exchange.ro_crate import FILE as CRATE
from skinlab.exchange.ro_crate import ro_crate
from skinlab.inference.identify import Identifier
from skinlab.io.files import write_file
from skinlab.report.pictures import NO_PICTURES, have_pictures
from skinlab.studies.campaigns import Evidence, Shared, evidence, explain_all, section
from skinlab.studies.population import Posterior, learn, to_toml
from skinlab.studies.reference import reference_of, write_reference
from skinlab.studies.reliability import FACETS, Analysis, Reliability, reliability, repeats_for
from skinlab.studies.report import flags_of, html, main_analyses, people_of
from skinlab.studies.run import How, settings_of, update
from skinlab.studies.sources import Plan
from skinlab.studies.state import State
from skinlab.studies.table import (
    NO_PARQUET,
    Cell,
    Columns,
    Layout,
    layout_of,
    read_columns,
    rows,
    write_csv,
    write_parquet,
)
from skinlab.tables.base import Database
from skinlab.text import counted, json_text
from skinlab.versions import versions

SCHEMA = "skinlab.study/1"

MEANING = {
    "curves.csv": "The tidy table: a row a curve",
    "curves.parquet": "The same as Parquet",
    "failures.csv": "Files that could not be used, and why",
    "components.csv": "Components of variance with intervals",
    "agreement.csv": "Intraclass correlations, SEM, CV and MDC95",
    "bland_altman.csv": "Mean differences and limits of agreement",
    "bland_altman_pairs.csv": "The pairs that these are of",
    "trends.csv": "Slopes over age, other numbers known of people, and visits",
    "people.csv": "Each person's mean with its interval",
    "flags.csv": "How many curves have each flag",
    "missing_effects.csv": "Missing effects of all campaigns",
    "pooled_effects.csv": "Sizes of missing effects, averaged over campaigns that share them",
    "report.html": "All of it on one page, with pictures",
    "reference.toml": "Reference ranges of these people",
    "study.toml": "The population, as a prior for skinlab identify",
    "study.json": "The main figures, settings and versions",
}
AGE_BANDS = ((0.0, 20.0), (20.0, 40.0), (40.0, 60.0), (60.0, 80.0), (80.0, 120.0))


@dataclass(frozen=True)
class Made:
    """What a study says: the document, the same in lines, and what a user should know besides."""

    document: dict[str, Any]
    lines: tuple[str, ...]
    notices: tuple[str, ...]
    failures: int
    analyses: tuple[Analysis, ...]  # one a quantity


def make_study(
    plan: Plan,
    out: Path,
    identifier: Identifier,
    how: How,
    *,
    resume: bool,
    explain: bool,
    mdc_percent: float | None = None,
    now: datetime,
) -> Made:
    """Bring the study in `out` up to date with the folders, and write all its files.

    With `mdc_percent` it also says how many repeats show a change of so many per cent.

    Raises:
        InputError: a folder does not exist, `out` cannot be written, or holds something else.
    """
    notices: list[str] = []
    with State(out) as state:
        update(state, plan, identifier, how, resume=resume)
        layout = layout_of(state, identifier.database.law)
        count = write_csv(out / "curves.csv", layout.columns, rows(state, layout, identifier))
        if not write_parquet(out / "curves.parquet", layout, rows(state, layout, identifier)):
            notices.append(NO_PARQUET)
        prior = learn(
            _posteriors(state, layout, identifier),
            layout.parameters,
            identifier.provenance().model_hash,
            f"{out.resolve().name}, {count} curves",
            seed=identifier.seed,
        )
        found_effects = None
        if explain:
            shared = Shared(_dimensionless(identifier), identifier.model)
            found_effects = evidence(explain_all(state, shared, how, settings_of(identifier)))
        failures = [{"file": name, "reason": reason} for name, reason in state.failures()]
    write_csv(out / "failures.csv", ("file", "reason"), failures)
    files = ["curves.csv", "curves.parquet", "failures.csv"]
    table = read_columns(out / "curves.csv")
    found = reliability(table, identifier.seed)
    files += _write_tables(out, table, found, failures, found_effects)
    if not have_pictures():
        notices.append(f"report.html is not written: {NO_PICTURES}")
    if prior is not None:
        write_file(out / "study.toml", to_toml(prior), replace=True)
        files.append("study.toml")
    reference, missing = reference_of(table, out.resolve().name, bands=AGE_BANDS, by_sex=True)
    if reference is not None:
        write_file(out / "reference.toml", write_reference(reference), replace=True)
        files.append("reference.toml")
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "folder": str(out),
        "curves": count,
        "failures": failures,
        "settings": json.loads(settings_of(identifier)),
        "versions": versions(),
        "reliability": _summary(found),
        "repeats": None if mdc_percent is None else _repeats(found, mdc_percent),
        "missing_effects": None
        if found_effects is None
        else {"campaigns": list(found_effects.campaigns), "pooled": list(found_effects.pooled)},
        "notes": [*found.notes, *missing],
        "files": [name for name in files if (out / name).exists()],
    }
    document["files"] += ["study.json", CRATE]
    write_file(out / "study.json", json_text(document) + "\n", replace=True)
    crate = ro_crate(
        out,
        {name: MEANING[name] for name in document["files"] if name != CRATE},
        name=f"skinlab study {out.resolve().name}",
        description=f"{count} suction curves of skin, identified and judged",
        date=now.isoformat(timespec="seconds"),
        versions=document["versions"],
        licence="Not stated. Data about people: not to be passed on without the owner's consent.",
    )
    write_file(out / CRATE, crate, replace=True)
    lines = [f"{counted(count, 'curve')} in {out / 'curves.csv'}", *_lines(found)]
    lines += _repeat_lines(document["repeats"] or ())
    lines += _effect_lines(found_effects)
    if failures:
        some = counted(len(failures), "file")
        lines.append(f"{some} could not be used: {out / 'failures.csv'}")
    return Made(document, tuple(lines), tuple(notices), len(failures), tuple(main_analyses(found)))


def _posteriors(state: State, layout: Layout, identifier: Identifier) -> Iterator[Posterior]:
    """Yield the draws of every whole first-cycle curve that counts, with whose it is."""
    stored = state.curves()
    for row, one in zip(rows(state, layout, identifier), stored, strict=True):
        if row["error"] or row["same_as"] or row["partial"] or row["cycle"] != 1:
            continue
        if tuple(one.said["result"]["order"]) != layout.parameters or not row["subject"]:
            continue
        draws = np.frombuffer(one.draws, dtype="<f4").astype(float)
        try:
            age = float(str(row.get("age_years")))
        except ValueError:
            age = math.nan
        yield Posterior(
            str(row["subject"]),
            str(row["site"] or ""),
            age if math.isfinite(age) else None,
            draws.reshape(-1, len(layout.parameters)),
        )


def _write_tables(
    out: Path,
    table: Columns,
    found: Reliability,
    failures: list[dict[str, str]],
    effects: Evidence | None,
) -> list[str]:
    """Write the tables and the page that shows them; return their names."""
    people = {one.quantity: people_of(table, one) for one in main_analyses(found)}
    tables: dict[str, Sequence[Mapping[str, Cell]]] = {
        "components.csv": found.components,
        "agreement.csv": found.agreement,
        "bland_altman.csv": found.bland_altman,
        "bland_altman_pairs.csv": found.pairs,
        "trends.csv": found.trends,
        "people.csv": [row for rows_ in people.values() for row in rows_],
        "flags.csv": flags_of(table),
    }
    if effects is not None:
        tables["missing_effects.csv"] = effects.campaigns
        tables["pooled_effects.csv"] = effects.pooled
    for name, body in tables.items():
        columns = dict.fromkeys(key for row in body for key in row)
        write_csv(out / name, tuple(columns) or ("empty",), body)
    if not have_pictures():
        (out / "report.html").unlink(missing_ok=True)  # that of an earlier state
        return list(tables)
    more = [] if effects is None else [section(effects)]
    page = html(f"Study {out.resolve().name}", table, found, people, failures, more)
    write_file(out / "report.html", page, replace=True)
    return [*tables, "report.html"]


def _summary(found: Reliability) -> list[dict[str, Any]]:
    """Return the main figures of each quantity, as plain data."""
    summary = []
    for one in main_analyses(found):
        assert one.found is not None
        agreement = [
            {k: v for k, v in row.items() if k not in one.key}
            for row in found.agreement
            if all(row[k] == v for k, v in one.key.items()) and row["k"] == 1
        ]
        summary.append(
            {
                **one.key,
                "curves": one.found.count,
                "people": one.people,
                "mean": one.found.mean,
                "components": [asdict(part) for part in one.found.parts],
                "agreement": agreement,
            }
        )
    return summary


def _lines(found: Reliability) -> list[str]:
    """Return what is said on a terminal."""
    lines = []
    words = {facet.name: facet.words for facet in FACETS}
    for one in main_analyses(found):
        assert one.found is not None
        shares = ", ".join(f"{p.name} {100 * p.share:.0f} %" for p in one.found.parts)
        lines.append(f"{one.quantity} ({one.condition}; {one.people} people): {shares}")
        for row in found.agreement:
            if all(row[k] == v for k, v in one.key.items()) and (
                row["by"] == "components" and row["measure"] == "MDC95 %" and row["k"] == 1
            ):
                lines.append(
                    f"  smallest change that can be shown, {words[str(row['facet'])]}: "
                    f"{row['value']:.0f} %"
                )
    return lines


def _repeats(found: Reliability, percent: float) -> list[dict[str, Any]]:
    """Return how many placements each quantity needs; None: no number is enough."""
    return [
        {
            **one.key,
            "facet": facet.name,
            "mdc_percent": percent,
            "repeats": repeats_for(one, percent, facet),
        }
        for one in main_analyses(found)
        for facet in one.facets()
    ]


def _repeat_lines(repeats: Sequence[Mapping[str, Any]]) -> list[str]:
    words = {facet.name: facet.words for facet in FACETS}
    return [
        f"to show a change of {row['mdc_percent']:g} % in {row['quantity']}, "
        f"{words[row['facet']]}: "
        + (
            "no number of repeats is enough"
            if row["repeats"] is None
            else f"{row['repeats']} placement{'s' * (row['repeats'] > 1)} each time"
        )
        for row in repeats
    ]


def _effect_lines(found: Evidence | None) -> list[str]:
    if found is None:
        return []
    held = [r for r in found.campaigns if r.get("holds")]
    some = counted(len(found.campaigns), "campaign")
    lines = [f"{some}: more than the model in {len(held)} of them"]
    lines += [
        f"  {r['effect']}, {r['shared_by']} {r['group']}: {r['size']:+.2g} times "
        f"({r['low']:+.2g} to {r['high']:+.2g}) of {r['unit']}, in {r['campaigns']} campaigns"
        for r in found.found
    ]
    return lines


def _dimensionless(identifier: Identifier) -> Database:
    if identifier.database.fixed_geometry is not None:
        raise InputError("--explain needs the shipped database, which speaks of all openings")
    return identifier.database
