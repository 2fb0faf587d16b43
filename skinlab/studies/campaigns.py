"""Missing effects over a whole study: each campaign explained, and their evidence pooled.

A campaign is what a campaign.toml lists, a session, or the curves of one person, visit, site and
probe. A verdict of one of many campaigns has to survive that there are many (Benjamini and Hochberg
1995). An effect that is too weak in each may be plain in fifty: the size that each campaign gives
it, seen or not, is averaged over campaigns that share it. An effect of the sensor is shared by a
probe, one of the skin by a site.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, false_discovery_control
from scipy.stats import t as t_distribution

from skinlab.curves.campaign import Campaign
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.screen import left_of
from skinlab.discrepancy.workflow import explain
from skinlab.errors import SkinlabError
from skinlab.io.log import log_exception
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.fem.suction import SOLVER_VERSION
from skinlab.mechanics.model_file import BASE, Model
from skinlab.mechanics.names import effect_words
from skinlab.recording.session_names import is_session_name
from skinlab.report.page import Illustration, Section, Table
from skinlab.report.pictures import style, to_data_uri
from skinlab.studies.compute import SESSION_NOISE, curves_and_noise
from skinlab.studies.copies import copied_files
from skinlab.studies.facts import Facts
from skinlab.studies.plots import draw_pooled
from skinlab.studies.run import How
from skinlab.studies.settings import POOLS
from skinlab.studies.state import State
from skinlab.studies.table import Cell, held
from skinlab.tables.base import Database
from skinlab.text import counted
from skinlab.workers import on_cluster, on_processes

Array = NDArray[np.float64]
Row = dict[str, Cell]

_UPPER = 0.95  # share below the upper end of a 90 % interval


@dataclass(frozen=True)
class Task:
    """The curves that are explained together: files with what is known of them."""

    key: str
    wanted: str
    labels: dict[str, str]
    files: tuple[tuple[str, Facts], ...]


@dataclass(frozen=True)
class Shared:
    """What all tasks need."""

    table: Database
    model: Model = BASE


@dataclass(frozen=True)
class Explained:
    """What became of a campaign: a JSON text, of its verdict and the size of every effect."""

    key: str
    wanted: str
    text: str


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the campaigns say together."""

    campaigns: tuple[Row, ...]
    pooled: tuple[Row, ...]

    @property
    def found(self) -> list[Row]:
        """The pooled effects that hold at the study's false discovery rate."""
        return [r for r in self.pooled if r["holds"] is True]


def tasks_of(state: State, settings: str) -> Iterator[Task]:
    """Yield the campaigns of a study, in the order of their names, without copied files."""
    copies = copied_files([held(stored) for stored in state.curves()])
    groups: dict[str, list[tuple[str, Facts, str]]] = {}
    labels: dict[str, dict[str, str]] = {}
    for source in state.readable():
        if source.name in copies:
            continue
        known = source.labels
        if is_session_name(source.path):
            key = source.name
        elif "campaign" in source.facts:
            key = str(source.facts["campaign"])
        elif known.get("subject"):
            names = ("subject", "visit", "site", "probe")
            key = " ".join(known[n] for n in names if known.get(n))
        else:
            key = source.name
        groups.setdefault(key, []).append((str(source.path), source.facts, source.sha256))
        labels.setdefault(key, known)
    for key in sorted(groups):
        files = sorted(groups[key])
        by: list[Any] = [files, settings, SOLVER_VERSION]
        if any(is_session_name(Path(path)) for path, _, _ in files):
            by.append(SESSION_NOISE)
        said = json.dumps(by, sort_keys=True)
        wanted = hashlib.sha256(said.encode()).hexdigest()
        yield Task(key, wanted, labels[key], tuple((p, f) for p, f, _ in files))


def explain_task(shared: Shared, task: Task) -> Explained:
    """Return what the workflow says of one campaign; whatever is wrong with it is its verdict."""
    said: dict[str, Any] = {"campaign": task.key, "labels": task.labels, "error": None}
    try:
        read = [curves_and_noise(Path(p), f) for p, f in task.files]
        noise, pressure = ({n[k] for _, n in read} for k in range(2))
        campaign = Campaign(
            task.key,
            noise.pop() if len(noise) == 1 else None,
            pressure.pop() if len(pressure) == 1 else None,
            tuple(c for curves, _ in read for c in curves if not c.partial),
        )
        outcome = explain(campaign, shared.table, model=shared.model)
        said |= {"outcome": outcome.to_json(), "scores": scores_of(outcome)}
        said["p_value"] = p_value_of(outcome)
    except SkinlabError as error:
        said["error"] = str(error)
    except Exception as error:  # noqa: BLE001 -- one campaign never stops the rest; see the log
        where = log_exception(error)
        said["error"] = f"internal error ({type(error).__name__}: {error}); see {where}"
        return Explained(task.key, "", json.dumps(said))  # the next run tries again
    return Explained(task.key, task.wanted, json.dumps(said, allow_nan=False))


def scores_of(outcome: Outcome) -> dict[str, Any]:
    """Return the score test of every effect at the model as it is, before any bound.

    `names`; `score`, by how much each effect's signature is in what is left; and `gram`, the
    signatures' products with each other, all per typical size: score / gram is an effect's size. A
    size below zero is as good a piece of evidence against an effect as one above zero is for it.
    The one place that knows the inside of the workflow's result.
    """
    found = outcome.found
    measured = np.concatenate([r.straight_mm for r in found.records])
    left = left_of(found.base.fit, found.errors, measured)
    seen = {n: s for n, s in found.signatures.items() if math.isfinite(s.detectable)}
    directions = np.array([s.direction for s in seen.values()]).reshape(len(seen), -1)
    return {
        "names": list(seen),
        "score": (directions @ left).tolist() if seen else [],
        "gram": (directions @ directions.T).tolist(),
    }


def p_value_of(outcome: Outcome) -> float:
    """Return how likely the noise alone leaves as much, for all that was looked at."""
    signatures = outcome.found.signatures.values()
    most = max((s.gain for s in signatures), default=0.0)
    by_effect = min(1.0, max(len(outcome.found.signatures), 1) * float(chi2.sf(most, 1)))
    return min(1.0, 2.0 * min(by_effect, outcome.found.base.left.p_value))


def explain_all(state: State, shared: Shared, how: How, settings: str) -> list[dict[str, Any]]:
    """Return what is said of every campaign; those that are known are not explained again.

    Raises:
        InputError: the dask cluster is lost.
    """
    tasks = list(tasks_of(state, settings))
    known = state.explained()
    missing = [t for t in tasks if known.get(t.key, ("", ""))[0] != t.wanted]
    done = len(tasks) - len(missing)
    how.explaining(done, len(tasks))
    for explained in _results(shared, missing, how):
        state.add_explained(explained.key, explained.wanted, explained.text)
        done += 1
        how.explaining(done, len(tasks))
    known = state.explained()
    return [json.loads(known[t.key][1]) for t in tasks if t.key in known]


def _results(shared: Shared, tasks: Sequence[Task], how: How) -> Iterator[Explained]:
    if how.dask is not None:
        yield from on_cluster(explain_task, shared, iter(tasks), how.dask)
        return
    if how.workers <= 1 or len(tasks) <= 1:
        yield from (explain_task(shared, task) for task in tasks)
        return
    for task, found in on_processes(explain_task, shared, iter(tasks), how.workers):
        yield found if found is not None else _died(task)


def _died(task: Task) -> Explained:
    error = "the process that explained it died"
    said = {"campaign": task.key, "labels": task.labels, "error": error}
    return Explained(task.key, "", json.dumps(said))


# ---- over the study -------------------------------------------------------------------------


def evidence(explained: Sequence[dict[str, Any]]) -> Evidence:
    """Return the campaigns' verdicts at the study's false discovery rate, and pooled effects."""
    good = [e for e in explained if not e["error"]]
    q = _controlled([e["p_value"] for e in good])
    campaigns: list[Row] = []
    for one, adjusted in zip(good, q, strict=True):
        outcome = one["outcome"]
        campaigns.append(
            {
                "campaign": one["campaign"],
                **{n: one["labels"].get(n) for n in ("subject", "visit", "site", "probe")},
                "verdict": outcome["verdict"],
                "effects": "; ".join(" and ".join(e) for e in outcome["effects"]),
                "gap_before_um": outcome["gap"]["before_um"],
                "gap_after_um": outcome["gap"]["after_um"],
                "noise_um": outcome["gap"]["noise_um"],
                "p_value": one["p_value"],
                "q_value": adjusted,
                "holds": bool(adjusted <= POOLS.false_discoveries and outcome["verdict"] != "none"),
                "error": None,
            }
        )
    campaigns += [
        {"campaign": e["campaign"], "verdict": None, "error": e["error"]}
        for e in explained
        if e["error"]
    ]
    pooled = list(_pooled(good))
    q = _controlled([float(r["p_value"] or 0.0) for r in pooled])
    for row, adjusted in zip(pooled, q, strict=True):
        row["q_value"] = adjusted
        row["holds"] = bool(adjusted <= POOLS.false_discoveries and not row["instead_of"])
    pooled.sort(key=lambda r: (bool(r["instead_of"]), float(r["p_value"] or 0.0)))
    return Evidence(tuple(campaigns), tuple(pooled))


def _controlled(p_values: Sequence[float]) -> list[float]:
    if not p_values:
        return []
    return [float(v) for v in false_discovery_control(np.clip(p_values, 0.0, 1.0))]


def _pooled(good: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield the effects' sizes over the campaigns of one probe, of one site, and of all."""
    for shared_by in ("probe", "site"):
        groups: dict[str, list[dict[str, Any]]] = {}
        for one in good:
            groups.setdefault(str(one["labels"].get(shared_by) or ""), []).append(one)
        if len(groups) > 1:
            groups["all"] = list(good)
        for group, members in sorted(groups.items()):
            if len(members) >= POOLS.fewest:
                for row in _of_group([m["scores"] for m in members]):
                    physical = get_effect(str(row["effect"])).physical
                    if ("site" if physical else "probe") != shared_by:
                        continue
                    named = sum(
                        one["outcome"]["verdict"] == "named"
                        and any(row["effect"] in e for e in one["outcome"]["effects"])
                        for one in members
                    )
                    yield {"shared_by": shared_by, "group": group, "named_in": named, **row}


def _of_group(scores: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield each effect's size in campaigns that share it.

    Effects look alike: where one is there, others seem to be. So the one that explains most, over
    all of them, is taken first, and the others are judged by what they explain beyond it, and so
    on; one that explains nothing more has in `instead_of` which were taken.
    """
    names = sorted({n for one in scores for n in one["names"]})
    taken: list[str] = []
    explained: list[float] = []
    while len(taken) < POOLS.most_taken:
        left = {n: _sizes(scores, n, taken) for n in names if n not in taken}
        gains = {n: _test(sizes) for n, sizes in left.items() if len(sizes) >= POOLS.fewest}
        best = min(gains, key=lambda n: (gains[n][3], -abs(gains[n][0] / gains[n][1])), default="")
        if not best or gains[best][3] > POOLS.false_discoveries / max(len(gains), 1):
            break
        explained.append((gains[best][0] / gains[best][1]) ** 2)
        if explained[-1] < POOLS.curvature * explained[0]:
            break
        taken.append(best)
    for name in names:
        before = taken[: taken.index(name)] if name in taken else taken
        sizes = _sizes(scores, name, [t for t in before if t != name])
        alone = _sizes(scores, name, [])
        if len(alone) < POOLS.fewest:
            continue
        shown = sizes if len(sizes) >= POOLS.fewest else alone
        mean, error, freedom, p_value = _test(shown)
        reach = float(t_distribution.ppf(_UPPER, freedom)) * error
        # Not taken, and seen alone, or in what a large one leaves: that one is what there is.
        like = bool(taken) and name not in taken
        like = like and min(_test(alone)[3], p_value) <= POOLS.false_discoveries
        yield {
            "effect": name,
            "campaigns": len(shown),
            "size": mean,
            "low": mean - reach,
            "high": mean + reach,
            "unit": _typical(name),
            "p_value": p_value,
            "instead_of": " and ".join(taken) if like else "",
        }


def _sizes(scores: Sequence[dict[str, Any]], name: str, taken: Sequence[str]) -> Array:
    """Return sizes and their deviations (campaigns, 2) of an effect, beyond those taken already."""
    found = []
    for one in scores:
        if name not in one["names"]:
            continue
        i = one["names"].index(name)
        others = [one["names"].index(t) for t in taken if t in one["names"]]
        gram, score = np.array(one["gram"]), np.array(one["score"])
        information, value = gram[i, i], score[i]
        if others:
            inverse = np.linalg.pinv(gram[np.ix_(others, others)], hermitian=True)
            information = information - gram[i, others] @ inverse @ gram[others, i]
            value = value - gram[i, others] @ inverse @ score[others]
        if information > POOLS.invisible * gram[i, i]:
            found.append((value / information, 1.0 / math.sqrt(information)))
    return np.array(found).reshape(-1, 2)


def _test(sizes: Array) -> tuple[float, float, int, float]:
    """Return the mean size, its standard error, degrees of freedom and p-value."""
    mean, error, freedom = pool(sizes[:, 0], sizes[:, 1])
    return mean, error, freedom, 2.0 * float(t_distribution.sf(abs(mean) / error, freedom))


def pool(size: Array, deviation: Array) -> tuple[float, float, int]:
    """Return the mean of sizes (n,), its standard error and its degrees of freedom.

    With a scatter of their own between campaigns (DerSimonian and Laird 1986), and the error from
    how they scatter in fact where that is more than they state (Hartung and Knapp 2001): so that
    noise which is correlated, or placements, are no evidence of anything.
    """
    n = len(size)
    weight = 1.0 / np.square(deviation)
    mean = float(weight @ size / weight.sum())
    excess = float(weight @ np.square(size - mean)) - (n - 1)
    spread = weight.sum() - np.square(weight).sum() / weight.sum()
    between = max(excess / float(spread), 0.0)
    weight = 1.0 / (np.square(deviation) + between)
    mean = float(weight @ size / weight.sum())
    seen = float(weight @ np.square(size - mean)) / (n - 1)
    return mean, math.sqrt(max(seen, 1.0) / float(weight.sum())), n - 1


def _typical(name: str) -> str:
    """Return what one unit of a size is: a typical value of the effect's first parameter."""
    effect = get_effect(name)
    parameter = next(p for p in effect.parameters if p.zero is not None)
    return f"{parameter.name} {parameter.zero:g} to {parameter.typical:g}"


def section(found: Evidence) -> Section:
    """Return what the report says of it."""
    named = [r for r in found.campaigns if r["verdict"] not in (None, "none")]
    shown = [r for r in found.pooled if r["holds"] or r["instead_of"]]
    rows = [
        [
            str(r["effect"]),
            f"{r['shared_by']} {r['group']}".strip(),
            str(r["campaigns"]),
            f"{r['size']:+.3g}",
            f"{r['low']:+.2g} to {r['high']:+.2g}",
            str(r["unit"]),
            "yes" if r["holds"] else f"no: {r['instead_of']} explains it",
        ]
        for r in shown
    ]
    singles = [
        [
            str(r["campaign"]),
            str(r["verdict"]),
            str(r["effects"]),
            "yes" if r["holds"] else "no",
        ]
        for r in named
    ]
    tables = []
    if rows:
        head = ["effect", "shared by", "campaigns", "size", "90 %", "1 is", "holds"]
        tables.append(
            Table(head, rows, "Sizes of effects, averaged over campaigns that share them")
        )
    if singles:
        tables.append(
            Table(["campaign", "verdict", "effects", "holds"], singles, "Single campaigns")
        )
    words = [
        f"{counted(len(found.campaigns), 'campaign')} explained, {len(named)} by more than the "
        f"model. At most some {100 * POOLS.false_discoveries:g} % of what holds over the study is "
        "there by chance. A pooled effect is one that the curves of many campaigns share; its "
        "size is linear, in typical sizes."
    ]
    if rest := len(found.pooled) - len(shown):
        words.append(
            f"{counted(rest, 'pooled size')} more do not hold: pooled_effects.csv has all."
        )
    figures = []
    if found.pooled:
        with style():
            picture = to_data_uri(draw_pooled(found.pooled), "svg")
        caption = "Filled: holds. The size 1 is a typical one, 0 is none. 90 % intervals."
        alt = "Sizes of pooled effects with their intervals, those that hold first."
        figures.append(Illustration(picture, alt, caption))
    names = re.findall(r"\w+", " ".join(str(r["effects"]) for r in named))
    mentioned = dict.fromkeys([*(str(r["effect"]) for r in shown), *names])
    meanings = [said for name in mentioned if (said := effect_words(name)) != name]
    return Section("Missing effects", words, points=meanings, figures=figures, tables=tables)
