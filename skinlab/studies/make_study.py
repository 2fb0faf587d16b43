"""A whole study: from folders to the table and all that is made from it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from drivers.numbers import number_in
from skinlab.errors import InputError
from skinlab.exchange.ro_crate import FILE as CRATE
from skinlab.exchange.ro_crate import ro_crate
from skinlab.inference.identify import Identifier
from skinlab.inference.population import PriorFile
from skinlab.io.files import write_file
from skinlab.report.pictures import NO_PICTURES, have_pictures
from skinlab.studies import reference as reference_file
from skinlab.studies.analysis import FACETS, usable, without_a_day
from skinlab.studies.campaigns import Evidence, Shared, evidence, explain_all, section
from skinlab.studies.labels import doubtful_labels
from skinlab.studies.population import Posterior, learn, to_toml
from skinlab.studies.reference import reference_of
from skinlab.studies.reliability import Reliability, reliability, repeats_for
from skinlab.studies.report import flags_of, html, main_analyses, people_of
from skinlab.studies.run import How, settings_of, update
from skinlab.studies.settings import REFERENCES
from skinlab.studies.sources import LEFT_ALONE, Plan, sha256_of
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
    "failures.csv": "Files and curves that could not be used, and why",
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

# Headings, which are there without a row too: what reads a table finds its columns.
COLUMNS: dict[str, str] = {
    "components.csv": "condition quantity scale curves people component sd variance low high share "
    "share_low share_high levels freedom level",
    "agreement.csv": "condition quantity scale facet by level measure k value low high unit "
    "definition",
    "bland_altman.csv": "condition quantity scale facet first second count bias bias_low bias_high "
    "sd lower lower_low lower_high upper upper_low upper_high level",
    "bland_altman_pairs.csv": "condition quantity scale facet first second target mean difference",
    "trends.csv": "condition quantity scale against slope low high level correlation count",
    "people.csv": "condition quantity subject curves visits value low high",
    "flags.csv": "flag curves share",
    "missing_effects.csv": "campaign subject visit site probe verdict effects gap_before_um "
    "gap_after_um noise_um p_value q_value holds error",
    "pooled_effects.csv": "shared_by group named_in effect campaigns size low high unit p_value "
    "instead_of q_value holds",
}


@dataclass(frozen=True)
class Made:
    """What a study says: the document, the same in lines, and what a user should know besides."""

    document: dict[str, Any]
    lines: tuple[str, ...]
    notices: tuple[str, ...]
    failures: int  # files left alone are none


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

    With `mdc_percent` it also says how many repeats show a change of so many per cent. Where
    nothing is new since its files were written they stay as they are.

    Raises:
        InputError: a folder does not exist, `out` cannot be written, or holds something else.
    """
    with State(out) as state:
        update(state, plan, identifier, how, resume=resume)
        layout = layout_of(state, identifier.database.law)
        table = out / "curves.csv"
        failures = [{"file": name, "reason": reason} for name, reason in state.failures()]
        told = _telling(rows(state, layout, identifier), failures)
        count = write_csv(table, layout.columns, told)
        failures.sort(key=lambda one: one["file"])  # a stable sort: curves stay in their order
        effects = None
        if explain:
            shared = Shared(_dimensionless(identifier), identifier.model)
            effects = explain_all(state, shared, how, settings_of(identifier))
        # All that the other files are made from: where it is as it was, so are they.
        columns = read_columns(table)
        doubts = doubtful_labels(columns.text, state.people())
        basis = (
            *(sha256_of(table), failures, doubts, effects, settings_of(identifier), versions()),
            *(str(out), mdc_percent, have_pictures(), find_spec("pyarrow") is not None),
        )
        key = hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()
        known = _as_it_was(out, state, key)
        if known is not None:
            return known
        if not write_parquet(out / "curves.parquet", layout, rows(state, layout, identifier)):
            (out / "curves.parquet").unlink(missing_ok=True)  # that of an earlier state
        identified = _identified(columns)
        prior = learn(
            _posteriors(state, layout, identifier),
            layout.parameters,
            identifier.provenance().model_hash,
            f"{out.resolve().name}, {identified} of {counted(count, 'curve')} identified",
            seed=identifier.seed,
        )
        evidenced = None if effects is None else evidence(effects)
        made = _write(
            out, identifier, columns, failures, doubts, prior, evidenced, mdc_percent, now
        )
        hashes = {name: sha256_of(out / name) for name in made.document["files"]}
        said = {"document": made.document, "lines": made.lines, "notices": made.notices}
        state.made = {"key": key, "hashes": hashes, **said}
    return made


def _as_it_was(out: Path, state: State, key: str) -> Made | None:
    """Return what the study said, where its files were made from the same and are as they were."""
    said = state.made
    if said is None or said["key"] != key:
        return None
    try:
        if any(sha256_of(out / name) != hashed for name, hashed in said["hashes"].items()):
            return None
    except OSError:
        return None
    document = said["document"]
    lines, notices = tuple(said["lines"]), tuple(said["notices"])
    return Made(document, lines, notices, _broken(document["failures"]))


def _telling(
    found: Iterator[dict[str, Cell]], failures: list[dict[str, str]]
) -> Iterator[dict[str, Cell]]:
    """Yield rows; of curves that were not identified the failures get the reason, too."""
    for row in found:
        if row["error"]:
            file, curve, error = (str(row[name]) for name in ("file", "curve", "error"))
            alone = PurePosixPath(file).name == curve  # else one of several in a session
            reason = error.removeprefix(f"{curve}: ")
            where = file if alone else f"{file}: {curve}"
            failures.append({"file": file, "reason": f"{where}: {reason}"})
        yield row


def _identified(table: Columns) -> int:
    """Return of how many curves there is an answer."""
    return int((table.text["error"] == "").sum())


def _broken(failures: Sequence[Mapping[str, str]]) -> int:
    """Return how many files are wrong; of a session several curves may be."""
    return len({f["file"] for f in failures if not f["reason"].startswith(LEFT_ALONE)})


def _left_alone(failures: Sequence[Mapping[str, str]]) -> int:
    """Return how many files nobody would take for curves."""
    return len({f["file"] for f in failures if f["reason"].startswith(LEFT_ALONE)})


def _write(
    out: Path,
    identifier: Identifier,
    table: Columns,
    failures: list[dict[str, str]],
    doubts: list[str],
    prior: PriorFile | None,
    effects: Evidence | None,
    mdc_percent: float | None,
    now: datetime,
) -> Made:
    """Write all files but the tidy tables, which are there; say what they say."""
    notices = [] if (out / "curves.parquet").exists() else [NO_PARQUET]
    write_csv(out / "failures.csv", ("file", "reason"), failures)
    files = ["curves.csv", "curves.parquet", "failures.csv"]
    notices += without_a_day(usable(table))
    found = reliability(table, identifier.seed)
    files += _write_tables(out, table, found, failures, effects)
    if not have_pictures():
        notices.append(f"report.html is not written: {NO_PICTURES}")
    reference, missing = reference_of(
        table, out.resolve().name, bands=REFERENCES.age_bands, by_sex=True
    )
    for name, text in (
        ("study.toml", None if prior is None else to_toml(prior)),
        ("reference.toml", None if reference is None else reference_file.to_toml(reference)),
    ):
        if text is None:
            (out / name).unlink(missing_ok=True)  # that of an earlier state
        else:
            write_file(out / name, text, replace=True)
            files.append(name)
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "folder": str(out),
        "curves": len(table),
        "curves_identified": _identified(table),
        "curves_copied": int((table.text["same_as"] != "").sum()),
        "files_not_used": _broken(failures),
        "files_left_alone": _left_alone(failures),
        "failures": failures,
        "settings": json.loads(settings_of(identifier)),
        "versions": versions(),
        "reliability": _summary(found),
        "repeats": None if mdc_percent is None else _repeats(found, mdc_percent),
        "missing_effects": None
        if effects is None
        else {"campaigns": list(effects.campaigns), "pooled": list(effects.pooled)},
        "notes": [*found.notes, *missing, *doubts],
        "files": [*(name for name in files if (out / name).exists()), "study.json", CRATE],
    }
    write_file(out / "study.json", json_text(document) + "\n", replace=True)
    crate = ro_crate(
        out,
        {name: MEANING[name] for name in document["files"] if name != CRATE},
        name=f"skinlab study {out.resolve().name}",
        description=f"{document['curves']} suction curves of skin, identified and judged",
        date=now.isoformat(timespec="seconds"),
        versions=document["versions"],
        licence="Not stated. Data about people: not to be passed on without the owner's consent.",
    )
    write_file(out / CRATE, crate, replace=True)
    lines = [
        *_count_lines(document, out / "curves.csv"),
        *doubts,
        *_lines(found),
        *_repeat_lines(document["repeats"] or ()),
        *_effect_lines(effects),
        *_file_lines(document, out / "failures.csv"),
    ]
    return Made(document, tuple(lines), tuple(notices), document["files_not_used"])


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
            age = number_in(str(row.get("age_years")))
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
        write_csv(out / name, COLUMNS[name].split(), body)
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
            if one.owns(row) and row["k"] == 1
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


def _count_lines(document: Mapping[str, Any], table: Path) -> list[str]:
    count, copies = document["curves"], document["curves_copied"]
    lines = [f"{document['curves_identified']} of {counted(count, 'curve')} identified: {table}"]
    if copies:
        lines.append(f"{counted(copies, 'curve')} a second time (same_as), not counted again")
    return lines


def _file_lines(document: Mapping[str, Any], failures: Path) -> list[str]:
    kinds = (("files_not_used", "could not be used"), ("files_left_alone", "left alone"))
    return [
        f"{counted(document[name], 'file')} {words}, see {failures}"
        for name, words in kinds
        if document[name]
    ]


def _lines(found: Reliability) -> list[str]:
    """Return what is said on a terminal."""
    lines = []
    words = {facet.name: facet.words for facet in FACETS}
    for one in main_analyses(found):
        assert one.found is not None
        shares = ", ".join(f"{p.name} {100 * p.share:.0f} %" for p in one.found.parts)
        lines.append(f"{one.quantity} ({one.condition}; {one.people} people): {shares}")
        for row in filter(one.owns, found.agreement):
            if row["by"] == "components" and row["measure"] == "MDC95 %" and row["k"] == 1:
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
