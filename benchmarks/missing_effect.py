# ruff: noqa: E501  (rows of figures)
"""The missing-effect workflow on simulated campaigns whose truth is hidden from it.

    python benchmarks/missing_effect.py --part none [--campaigns 15] [--seed 1] [--workers 2]
    python benchmarks/missing_effect.py --summary

What the parts are: `challenge/campaigns.py`. Every campaign is one line of
`results/missing_effect.jsonl`, appended as it is done, so that a run goes on where the last one
stopped; lines of other versions of the workflow do not count. Each run ends with the confusion
matrix and the figures, with 90 % intervals (Clopper and Pearson), saved in
`results/missing_effect.json`. Peers (`peers.py`) look at the campaigns with errors as in life too.

An effect's strength is told in multiples of the smallest detectable size: the length of what the
base model, refitted to the curves without their noise, leaves, over five standard deviations. It is
separable where no other effect of the library, its signature linearised at that refit, leaves less
than five standard deviations of it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from challenge.campaigns import (
    BREATHING_HZ,
    FAMILIES,
    PARTS,
    PULSE_HZ,
    Life,
    Made,
    Truth,
    curve_of,
    make,
)
from challenge.score import share
from numpy.typing import NDArray
from peers import ask

import skinlab
from skinlab.discrepancy.fit import Fitter
from skinlab.discrepancy.misfit import errors_of, mesh_columns
from skinlab.discrepancy.next_measurement import Planned
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.records import Record, coarsened, records_of
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import ERRORS
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.discrepancy.workflow import explain
from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck
from skinlab.inference.noise import slope_mm_per_mbar
from skinlab.mechanics.effects.model import forget
from skinlab.tables.store import shipped_table

Array = NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
LINES = RESULTS / "missing_effect.jsonl"
SUMMARY = RESULTS / "missing_effect.json"
NOTHING = ("life_none", "life_plans_none")  # parts with errors of life in which nothing is hidden,
ONE = ("life_single", "life_crossed", "life_plans")  # and one effect
BEYOND = ("life_outside", "life_time")  # and something that the library does not have

# ---- judging one campaign ------------------------------------------------------------------------


def judge(
    part: str,
    seed: int,
    version: str,
    number: int,
    *,
    scatter: float | None,
    peers: bool = True,
    plans: bool = True,
) -> dict[str, Any]:
    """Return the line of one campaign; peers are asked only where errors are as in life.

    `scatter` of placements is stated, if given. What is advised for a tie is measured with `plans`.
    """
    forget()
    truth, made = make(part, seed, number)
    if scatter is not None:
        made = replace(made, campaign=replace(made.campaign, placement_scatter=scatter))
    forget()
    begin, cpu = time.monotonic(), time.process_time()
    outcome = explain(made.campaign, shipped_table())
    seconds, cpu = time.monotonic() - begin, time.process_time() - cpu
    verdict = outcome.verdict
    line: dict[str, Any] = {
        "part": part, "seed": seed, "number": number, "version": version,
        "hidden": sorted(truth.effects), "values": truth.effects,
        "outside": truth.distortion, "outside_size": truth.distortion_size,
        "skin": list(truth.skin.values),
        "thickness_mm": truth.thickness_mm, "noise_um": truth.noise_um,
        "pressure_noise_mbar": truth.pressure_noise_mbar, "stated": truth.stated,
        "verdict": verdict.name, "effects": [sorted(c.effects) for c in verdict.explanations],
        "seconds": seconds, "cpu_seconds": cpu,
        "placement_scatter": scatter,
        "estimated_noise_um": records_of(made.campaign)[0].noise_um,
        "base_p": outcome.found.base.left.p_value,
        "life": None if truth.life is None else vars(truth.life),
        "repeats": max(entry.setup.repeat for entry in made.campaign.curves),
        "family": None if outcome.learned is None else outcome.learned.family.family,
        "trials": [[t.name, t.passed, t.sentence] for t in outcome.trials],
        "gap_um": [outcome.gap_before.rms_um, outcome.gap_after.rms_um],
        "gap_noise_um": outcome.gap_after.noise_um,
        "gap_expected_um": outcome.gap_after.expected_um,
        "candidates": [
            [sorted(c.effects), c.log10_evidence, c.left.p_value, c.fit.settled]
            for c in outcome.found.candidates[:6]
        ],
    }  # fmt: skip
    line |= _strength(truth, made, outcome)
    if truth.effects and part.startswith("life"):
        line["truth_leads"] = _lead_of_the_truth(truth, made, outcome)
    line["parameters"] = outcome.parameters(outcome.best)
    if peers and part.startswith("life"):
        line["peers"] = ask(made.campaign, shipped_table()).line()
    if plans and verdict.name == "ambiguous" and outcome.next_measurement is not None:
        following = outcome.next_measurement
        line["next"] = [following.aperture_mm, following.program, following.placements]
        line["expected_log10_evidence"] = following.expected_log10_evidence
        line["expected_settled"] = None if following.alone is None else following.alone.settled

        def after(measurements: Sequence[Planned]) -> list[Any] | None:
            rng = np.random.default_rng([seed, PARTS.index(part), number, 2])
            each = [(m.aperture_mm, m.program) for m in measurements for _ in range(m.placements)]
            more = [curve_of(truth, (*one, 1, 9 + k), rng) for k, one in enumerate(each)]
            if not all(one is not None for one in more):
                return None
            curves = (*made.campaign.curves, *(one[0] for one in more if one is not None))
            second = explain(replace(made.campaign, curves=curves), shipped_table()).verdict
            return [second.name, [sorted(c.effects) for c in second.explanations]]

        plan, alone = following.plan, following.alone
        if alone is not None and (then := after(alone.measurements)) is not None:
            line["then"] = then
        if plan is not None:
            line["plan"] = [list(vars(m).values()) for m in plan.measurements]
            line["plan_expected_settled"] = plan.settled
            same = alone is not None and plan.measurements == alone.measurements
            then = line.get("then") if same else after(plan.measurements)
            if then is not None:
                line["then_plan"] = then
    return line


def _strength(truth: Truth, made: Made, outcome: Outcome) -> dict[str, Any]:
    """Return the strength of what was hidden, how separable it is, and what the best fit leaves."""
    found = outcome.found
    errors = found.errors
    clean = _by_the_workflow(truth, outcome)
    if clean is None:
        clean = _as_seen(made, found.records)
    base, best = outcome.found.base.fit, outcome.best.fit

    def left(fit: Any, *more: Array) -> float:
        r = errors.whiten(clean - np.concatenate(fit.deflections_mm))
        q = np.linalg.qr(np.column_stack([fit.jacobian[:, fit.free], *more]))[0]
        return float(np.linalg.norm(r - q @ (q.T @ r)) / 5.0)

    others = {
        name: left(base, s.direction[: errors.count])
        for name, s in outcome.found.signatures.items()
        if name not in truth.effects and s.size > 1e-2
    }
    closest = min(others, key=lambda n: others[n]) if others else ""
    true = _true_errors(truth, outcome)
    colour = errors.colour
    off = clean - np.concatenate(base.deflections_mm)

    def hoped(*more: Array) -> float:
        basis = true.whiten(colour(np.column_stack([base.jacobian[:, base.free], *more])))
        r, q = true.whiten(off), np.linalg.qr(basis)[0]
        return 0.5 * float(np.square(r - q @ (q.T @ r)).sum()) / np.log(10.0)

    rival = np.zeros(errors.count)
    if closest:
        rival = found.signatures[closest].direction[: errors.count]
    rest = true.whiten(clean - np.concatenate(best.deflections_mm))
    q = np.linalg.qr(true.whiten(colour(best.jacobian[:, best.free])))[0]
    return {
        # By how much a knower of the errors would see more than was named.
        "knower_log10_left": 0.5 * float(np.square(rest - q @ (q.T @ rest)).sum()) / np.log(10.0),
        "knower_log10": [hoped(), hoped(rival)],
        "strength": left(base),
        "closest": closest,
        "closest_leaves": others.get(closest, 0.0),
        "best_leaves": left(best),
    }


def _by_the_workflow(truth: Truth, outcome: Outcome) -> Array | None:
    """Return the curves (u,) without errors, by the workflow's own model at the truth.

    So at the pressures that it sees, whatever lags or creeps. None where the library has not what
    is hidden, or that model has no answer.
    """
    if truth.distortion:
        return None
    found = outcome.found
    unknowns, at = _at_the_truth(truth, found.base.fit.unknowns)
    model = Fitter(found.records, found.errors, TableDomes(shipped_table())).model(unknowns)
    return np.concatenate(model.predict(at)) if model.anchor(at) else None


def _as_seen(made: Made, records: Sequence[Record]) -> Array:
    """Return the curves (u,) without errors at the samples and pressures of the records.

    Moved along the curve: right where nothing lags.
    """
    each = []
    for r, curve, clean_mm, true_mbar in zip(
        records, made.campaign.curves, made.clean_mm, made.true_mbar, strict=True
    ):
        own, p = (np.interp(r.curve.time_s, curve.time_s, v) for v in (clean_mm, true_mbar))
        each.append(own + slope_mm_per_mbar(p, own) * (r.pressure_mbar - p))
    return np.concatenate(each)


def _at_the_truth(truth: Truth, unknowns: Unknowns) -> tuple[Unknowns, Array]:
    """Return the unknowns of the truth, and where it is (k,)."""
    for name in sorted(truth.effects):
        unknowns = unknowns if name in unknowns.effects else unknowns.with_effect(name)
    skin = unknowns.space.coordinates(np.asarray(truth.skin.values))
    at = np.concatenate([skin, np.zeros(len(unknowns.axes))])
    for i, axis in enumerate(unknowns.axes, len(skin)):
        if axis.effect in truth.effects:
            at[i] = axis.to_u(truth.effects[axis.effect][axis.parameter.name])
    return unknowns, at


def _lead_of_the_truth(truth: Truth, made: Made, outcome: Outcome) -> float | None:
    """Return by how much log10 evidence the truth, fitted from the truth, leads all else.

    By the errors that the workflow learns. Below 1.3 no search could give the right name; where it
    is more and another one was given, the search missed it. None: the truth has no fit.
    """
    campaign = made.campaign
    records = [coarsened(r, ERRORS.coarse_hz) for r in records_of(campaign)]
    search = Search(
        Fitter(records, errors_of(records), TableDomes(shipped_table())),
        noise_um=campaign.noise_um,
        placement_scatter=campaign.placement_scatter,
    )
    base = search.learned_base()
    unknowns, start = _at_the_truth(truth, base.fit.unknowns)
    fit = search.fitter.fit(unknowns, start)
    if fit is None:
        return None
    others = [
        c for c in outcome.found.candidates if not c.kind and set(c.effects) != set(fit.effects)
    ]
    for one in (*others[:1], replace(base, fit=fit)):
        search.errors = search.errors_with(one.fit)
    true, *rest = search.weighed(base, [replace(base, fit=fit), *others])
    return true.log10_evidence - max([0.0, *(c.log10_evidence for c in rest)])  # 0: nothing missing


def _true_errors(truth: Truth, outcome: Outcome) -> Covariance:
    """Return the errors' covariance, as nobody knows it (spikes, which are left out, apart)."""
    records, life = outcome.found.records, truth.life or Life()
    w = [r.curve.deflection_mm for r in records]
    p = [r.pressure_mbar for r in records]
    slope = [slope_mm_per_mbar(a, b) for a, b in zip(p, w, strict=True)]
    fewer = np.concatenate([r.each(r.coarse**-0.5) for r in records])
    of_pressure = np.concatenate(
        [s * r.each(r.pressure_sd_mbar) for s, r in zip(slope, records, strict=True)]
    )
    variance = (
        (1e-3 * truth.noise_um * fewer) ** 2
        + (1e-3 * life.step_um) ** 2 / 12.0
        + (life.proportional * np.concatenate(w) * fewer) ** 2
        + of_pressure**2
    )
    n = len(variance)
    ends = np.cumsum([len(x) for x in w])
    time_s = np.concatenate([r.curve.time_s for r in records])
    columns = [mesh_columns(records)]  # the curves are another mesh's
    for i, r in enumerate(records):
        own = [
            life.stiffness * p[i] * slope[i],
            np.full(len(w[i]), 1e-3 * life.offset_um),
            life.thickness * p[i] * slope[i],  # about: a thicker skin is a stiffer one
        ]
        t = r.curve.time_s - r.curve.time_s[0]
        for size, band in ((life.breathing_um, BREATHING_HZ), (life.pulse_um, PULSE_HZ)):
            own += list(1e-3 * size * _waves(t, band).T)
        own += list(1e-3 * life.walk_um * _walks(t).T)
        block = np.zeros((n, len(own)))
        block[ends[i] - len(w[i]) : ends[i]] = np.column_stack(own)
        columns.append(block)
    ou = OrnsteinUhlenbeck(1e-3 * life.ou_um, life.ou_s) if life.ou_um else None
    return Covariance(variance, np.hstack(columns), tuple(int(e) for e in ends), ou, time_s)


def _waves(t: Array, band_hz: tuple[float, float]) -> Array:
    """Return columns (n, m) whose covariance is that of a wave of any phase and frequency of a band."""
    count = 2 + int(np.ceil(2.0 * (band_hz[1] - band_hz[0]) * max(float(t[-1]), 1.0)))
    share = (np.arange(count) + 0.5) / count
    angle = 2.0 * np.pi * np.outer(t, band_hz[0] + share * (band_hz[1] - band_hz[0]))
    return np.hstack([np.cos(angle), np.sin(angle)]) / np.sqrt(2.0 * count)


def _walks(t: Array, terms: int = 40) -> Array:
    """Return columns (n, m) whose covariance is that of a walk of 1 per root second from t[0] on."""
    whole_s, odd = max(float(t[-1]), 1e-9), (np.arange(terms) + 0.5) * np.pi
    return np.asarray(np.sqrt(2.0 * whole_s) / odd * np.sin(np.outer(t / whole_s, odd)))


# ---- summary -------------------------------------------------------------------------------------


def right(line: dict[str, Any]) -> bool:
    """Return whether an explanation is the truth, or all of it that these curves can show.

    Where nothing is hidden every name is wrong.

    Of two hidden effects one may be too weak: what the best fit leaves of the clean curves is then
    below the smallest detectable size.
    """
    (named,) = line["effects"]
    if named == line["hidden"]:
        return True
    return set(named) < set(line["hidden"]) and line["best_leaves"] < 1.0


def all_that_is_seen(line: dict[str, Any]) -> bool:
    """Return whether the truth was named, or all of it for which a knower would have 20 : 1."""
    (named,) = line["effects"]
    enough = set(named) < set(line["hidden"]) and line["knower_log10_left"] < 1.3
    return bool(named == line["hidden"] or enough)


def among(line: dict[str, Any]) -> bool:
    """Return whether the truth, or all of it that these curves can show, is among the tied."""
    weak = line["best_leaves"] < 1.0
    return any(
        named == line["hidden"] or (weak and set(named) < set(line["hidden"]))
        for named in line["effects"]
    )


def _leads(line: dict[str, Any]) -> bool:
    """Return whether the truth, if only it is found, is 20 : 1 ahead of all else."""
    return (line.get("truth_leads") or 0.0) >= 1.3


def family_right(line: dict[str, Any]) -> bool:
    """Return whether the kind that was learned is one that the hidden thing is of."""
    return line["verdict"] == "learned" and line["family"] in FAMILIES.get(line["outside"], ())


def covered(line: dict[str, Any], name: str) -> bool:
    """Return whether the interval of a base parameter holds its true value."""
    value = line["skin"][("X1_MPa", "X2_MPa", "nu").index(name)]
    found = line["parameters"][name]
    return bool(found["low"] <= value <= found["high"])


def figures(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures: each with its target, where there is one."""
    full = [x for x in lines if x["part"] in ("none", "single", "double", "outside")]
    life_none = [x for x in lines if x["part"] in NOTHING]
    life_single = [x for x in lines if x["part"] in ONE]
    life_double = [x for x in lines if x["part"] == "life_double"]
    life_outside = [x for x in lines if x["part"] in BEYOND]
    life_named = [x for x in life_none + life_single if x["verdict"] == "named"]
    visible = [x for x in life_single if min(x.get("knower_log10", [0.0])) >= 1.3]
    life_tied = [x for x in life_single if x["verdict"] == "ambiguous"]
    none = [x for x in full if x["part"] == "none"]
    named = [x for x in full if x["verdict"] == "named"]
    single = [x for x in full if x["part"] == "single"]
    clear = [x for x in single if x["strength"] >= 3.0 and x["closest_leaves"] >= 1.0]
    tied = [x for x in lines if x["verdict"] == "ambiguous" and x["hidden"]]
    outside = [x for x in full if x["part"] == "outside"]
    correct = [x for x in named if x["hidden"] and right(x)]
    held = [*correct, *(x for x in none if x["verdict"] == "none")]
    sure = [x for x in held if _x1_deviation(x) < 0.04]
    ramps = [x for x in lines if x["part"] == "ramp"]
    gaps = [x["gap_um"][1] / x["gap_noise_um"] for x in correct]
    told = [x["gap_um"][1] / x["gap_expected_um"] for x in correct if "gap_expected_um" in x]
    return {
        "life_something_named_where_nothing_is": {
            "target": "<= 0.01", **share(x["verdict"] == "named" for x in life_none),
        },
        "life_anything_but_none_where_nothing_is": {
            "target": "<= 0.05", **share(x["verdict"] != "none" for x in life_none),
        },
        "life_names_right": {"target": ">= 0.98", **share(right(x) for x in life_named)},
        "life_named_of_one_hidden": share(x["verdict"] == "named" for x in life_single),
        "life_named_where_a_knower_of_the_errors_has_20_to_1": {
            "target": ">= 0.80", **share(x["verdict"] == "named" and right(x) for x in visible),
        },
        "life_named_where_the_truth_leads_20_to_1": share(
            x["verdict"] == "named" and right(x) for x in life_single if _leads(x)
        ),
        "life_two_hidden_named_where_the_truth_leads_20_to_1": share(
            x["verdict"] == "named" and right(x) for x in life_double if _leads(x)
        ),
        "life_truth_among_tied": {"target": ">= 0.97", **share(among(x) for x in life_tied)},
        "life_plan_settles": {
            "target": ">= 0.80",
            **share(_settled(x, "then_plan") for x in life_tied if "then_plan" in x),
        },
        "life_advice_settles": {
            "target": ">= 0.80", **share(_settled(x) for x in life_tied if "then" in x),
        },
        "life_two_hidden_named_rightly": {
            "target": ">= 0.85",
            **share(x["verdict"] == "named" and right(x) for x in life_double),
        },
        "life_two_hidden_named_as_far_as_a_knower_of_the_errors_has_20_to_1": share(
            x["verdict"] == "named" and all_that_is_seen(x)
            for x in life_double
            if min(x.get("knower_log10", [0.0])) >= 1.3 and "knower_log10_left" in x
        ),
        "life_two_hidden_named_wrongly": {
            "target": "<= 0.02",
            **share(x["verdict"] == "named" and not right(x) for x in life_double),
        },
        "life_outside_given_a_library_name": {
            "target": "<= 0.03", **share(x["verdict"] == "named" for x in life_outside),
        },
        "life_outside_families_right_of_those_given": {
            "target": ">= 0.90",
            **share(family_right(x) for x in life_outside if x["verdict"] == "learned"),
        },
        "life_outside_family_right_where_it_has_one_and_is_seen": share(
            family_right(x)
            for x in life_outside
            if FAMILIES.get(x["outside"]) and x["verdict"] != "none"
        ),
        "life_outside_gap_within_1.3_noise_where_learned": {
            "target": "all",
            **share(
                x["gap_um"][1] <= 1.3 * x["gap_noise_um"]
                for x in life_outside
                if x["verdict"] == "learned"
            ),
        },
        "life_nothing_or_one_hidden_learned": share(
            x["verdict"] == "learned" for x in life_none + life_single
        ),
        "life_outside_seen": share(x["verdict"] != "none" for x in life_outside),
        "life_held_out_gap_over_noise_within_1.2": share(
            x["gap_um"][1] <= 1.2 * x["gap_noise_um"] for x in life_named
        ),
        "false_alarm_on_none": {"target": "<= 0.01", **share(x["verdict"] != "none" for x in none)},
        "names_right": {"target": ">= 0.98", **share(right(x) for x in named)},
        "named_where_separable_and_3_times_detectable": {
            "target": ">= 0.90",
            **share(x["verdict"] == "named" and right(x) for x in clear),
        },
        "outside_is_unknown": {
            "target": ">= 0.90", **share(x["verdict"] == "unknown" for x in outside),
        },
        "outside_is_unknown_where_3_times_detectable": share(
            x["verdict"] == "unknown" for x in outside if x["strength"] >= 3.0
        ),
        "truth_among_tied": {
            "target": ">= 0.97", **share(among(x) for x in tied),
        },
        "advice_settles_tie": {
            "target": ">= 0.80",
            **share(_settled(x) for x in tied if "then" in x),
        },
        "ties_without_advice": share("next" not in x for x in tied),
        "held_out_gap_within_1.2_noise": {"target": "all", **share(g <= 1.2 for g in gaps)},
        "held_out_gap_within_1.2_of_a_perfect_model_fitted_to_the_rest": share(g <= 1.2 for g in told),
        "held_out_gap_over_noise_median": float(np.median(gaps)) if gaps else None,
        **{
            f"interval_holds_{name}": {
                "target": "0.88-0.92", **share(covered(x, name) for x in held),
            }
            for name in ("X1_MPa", "X2_MPa", "nu")
        },
        "X1_within_10_percent_where_sd_below_4_percent": {
            "target": "all",
            **share(abs(x["parameters"]["X1_MPa"]["value"] / x["skin"][0] - 1) < 0.1 for x in sure),
        },
        "single_ramp_named": {"target": "almost never", **share(x["verdict"] == "named" for x in ramps)},
        "seconds_median": float(np.median([x["seconds"] for x in lines])) if lines else None,
        "cpu_seconds_median": float(np.median([x["cpu_seconds"] for x in lines])) if lines else None,
        **{
            f"cpu_seconds_{part}_median_and_95_percent": np.quantile(seconds, [0.5, 0.95]).tolist()
            for part in PARTS
            if (seconds := [x["cpu_seconds"] for x in lines if x["part"] == part])
        },
        "cpu_seconds_highest": max((x["cpu_seconds"] for x in lines), default=None),
    }  # fmt: skip


def by_program(lines: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the workflow and its peers beside each other, on campaigns with errors as in life."""
    asked = [x for x in lines if "peers" in x]
    none = [x for x in asked if x["part"] in NOTHING]
    single = [x for x in asked if x["part"] in ONE]
    outside = [x for x in asked if x["part"] in BEYOND]

    def said(x: dict[str, Any], who: str) -> list[str]:
        if who == "workflow":
            return list(x["effects"][0]) if x["verdict"] == "named" else []
        return list(x["peers"][who])

    table = {
        who: {
            "nothing hidden: something named": share(bool(said(x, who)) for x in none),
            "one hidden: named rightly": share(said(x, who) == x["hidden"] for x in single),
            "one hidden: names that are right": share(
                said(x, who) == x["hidden"] for x in single if said(x, who)
            ),
            "outside: a library name": share(bool(said(x, who)) for x in outside),
        }
        for who in ("workflow", "aic", "bic")
    }
    detected = {"workflow": lambda x: x["verdict"] != "none", "gp": lambda x: x["peers"]["gp"]}
    for who, sees in detected.items():
        table.setdefault(who, {}).update(
            {
                "nothing hidden: anything seen": share(sees(x) for x in none),
                "one hidden: seen": share(sees(x) for x in single),
                "outside: seen": share(sees(x) for x in outside),
            }
        )
    return table


def _settled(line: dict[str, Any], after: str = "then") -> bool:
    """Return whether a tie was resolved to the truth, or to all of it that can be seen.

    After what was advised next, or ("then_plan") the whole plan.
    """
    verdict, effects = line[after]
    return verdict == "named" and among({**line, "effects": effects})


def _x1_deviation(line: dict[str, Any]) -> float:
    found = line["parameters"]["X1_MPa"]
    return float(np.log(found["high"] / found["low"]) / (2 * 1.6449))


def confusion(lines: Sequence[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """Return verdicts by what was hidden; a name given is told as right or as the wrong name."""
    rows: dict[str, Counter[str]] = {}
    for x in lines:
        what = x["part"]
        if what in ("single", "outside", *BEYOND, *ONE):
            what = f"{what}: {x['outside'] or x['hidden'][0]}"
        verdict = x["verdict"]
        if verdict == "learned":
            verdict += f" {x['family']}"
        elif verdict == "named":
            verdict += " right" if right(x) else f" {'+'.join(x['effects'][0])}"
        elif verdict == "ambiguous":
            verdict += ", truth among" if among(x) else ", truth missing"
        rows.setdefault(what, Counter())[verdict] += 1
    return {what: dict(sorted(row.items())) for what, row in sorted(rows.items())}


def summarise(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the saved result."""
    return {
        "command": "python benchmarks/missing_effect.py --part PART --campaigns N --seed S",
        "versions": sorted({x["version"] for x in lines}),
        "campaigns": {"all": len(lines)} | dict(Counter(x["part"] for x in lines)),
        "seeds": sorted({x["seed"] for x in lines}),
        "figures": figures(lines),
        "programs": by_program(lines),
        "confusion": confusion(lines),
    }


def show(result: dict[str, Any]) -> None:
    """Print the summary."""
    print("campaigns: " + ", ".join(f"{k} {v}" for k, v in result["campaigns"].items()))
    for what, row in result["confusion"].items():
        print(f"  {what:30s} " + "; ".join(f"{k}: {v}" for k, v in row.items()))
    for who, row in result["programs"].items():
        for what, value in row.items():
            if value["of"]:
                low, high = 100 * value["low"], 100 * value["high"]
                print(
                    f"  {who:9s} {what:36s} {100 * value['share']:5.1f} % of {value['of']:3d} "
                    f"({low:.1f}–{high:.1f} %)"
                )
    for name, value in result["figures"].items():
        if isinstance(value, dict):
            if value["of"]:
                print(
                    f"  {name:46s} {100 * value['share']:5.1f} % of {value['of']:3d} "
                    f"({100 * value['low']:.1f}–{100 * value['high']:.1f} %)"
                    + (f", target {value['target']}" if "target" in value else "")
                )
        elif value is not None:
            print(f"  {name:46s} {np.round(value, 2)}")


def version_of() -> str:
    """Return a hash of what decides: the workflow, the effects, the finite elements."""
    root = Path(skinlab.__file__).parent
    files = [
        f
        for d in ("discrepancy", "inference", "mechanics")
        for f in sorted((root / d).rglob("*.py"))
    ]
    digest = hashlib.sha256(b"".join(f.read_bytes() for f in files))
    digest.update(Path(__file__).read_bytes().split(b"# ---- summary")[0])
    for name in ("challenge/campaigns.py", "peers.py"):
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()[:12]


def read(file: Path, version: str | None) -> list[dict[str, Any]]:
    """Return the lines of this version; a line that a crash cut short is left out."""
    found = []
    for text in file.read_text().splitlines() if file.exists() else []:
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if version is None or line["version"] == version:
            found.append(line)
    return found


def main() -> None:
    """Run, append, summarise, save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", choices=PARTS, action="append", default=[])
    parser.add_argument("--campaigns", type=int, default=15, help="of each part")
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--no-peers", action="store_true", help="ask the workflow alone: half the time"
    )
    parser.add_argument(
        "--no-plans", action="store_true", help="do not measure what is advised: minutes a tie"
    )
    parser.add_argument(
        "--placement-scatter", type=float, help="what campaigns state of it; 0 is none"
    )
    parser.add_argument("--lines", type=Path, default=LINES)
    parser.add_argument("--save", type=Path, default=SUMMARY, help="where the figures go")
    parser.add_argument("--summary", action="store_true", help="of the lines that there are")
    parser.add_argument("--any-version", action="store_true", help="count lines of other versions")
    arguments = parser.parse_args()
    version = version_of()
    done = {
        (x["part"], x["seed"], x["number"], x.get("placement_scatter"))
        for x in read(arguments.lines, None if arguments.any_version else version)
    }
    arguments.lines.parent.mkdir(exist_ok=True)
    for part in [] if arguments.summary else arguments.part or PARTS:
        numbers = [
            n
            for n in range(arguments.first, arguments.first + arguments.campaigns)
            if (part, arguments.seed, n, arguments.placement_scatter) not in done
        ]
        with ProcessPoolExecutor(arguments.workers) as pool, arguments.lines.open("a") as out:
            asked = {
                "scatter": arguments.placement_scatter,
                "peers": not arguments.no_peers,
                "plans": not arguments.no_plans,
            }
            one = partial(judge, part, arguments.seed, version, **asked)
            work = [pool.submit(one, n) for n in numbers]
            for job in as_completed(work):
                line = job.result()
                out.write(json.dumps(line, ensure_ascii=False) + "\n")
                out.flush()
                print(
                    f"{part} {line['number']}: {line['hidden'] or line['outside']} "
                    f"(strength {line['strength']:.1f}, closest {line['closest']} leaves "
                    f"{line['closest_leaves']:.1f}) -> {line['verdict']} {line['effects']}, "
                    f"{line['seconds']:.0f} s",
                    flush=True,
                )
    lines = read(arguments.lines, None if arguments.any_version else version)
    result = summarise(lines)
    show(result)
    if lines:
        arguments.save.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
