# ruff: noqa: E501  (rows of figures)
"""The missing-effect workflow on simulated campaigns whose truth is hidden from it.

    python benchmarks/missing_effect.py --part none [--campaigns 15] [--seed 1] [--workers 2]
    python benchmarks/missing_effect.py --summary

The curves are those of the simulated probe's skin: 9-node elements on a mesh of its own, random
skins, thicknesses and noise. Parts: `none` hides nothing, `single` each of the library's effects in
turn, `double` two of them, `outside` something that the library does not have, `ramp` an effect
(or, each fourth time, nothing) in one ramp of the 6 mm opening, `life_none` and `life_single` nothing
or one effect in curves with errors as they are measured (noise that lasts, steps, breathing, spikes,
placements that differ in stiffness, thickness and zero; one to three placements an opening). Every campaign is one line of
`results/missing_effect.jsonl`, appended as it is done, so that a run goes on where the last one
stopped; lines of other versions of the workflow do not count. Each run ends with the confusion
matrix and the figures, with 90 % intervals (Clopper and Pearson), saved in
`results/missing_effect.json`.

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
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

import skinlab
from sim_device.skin import MESH
from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.records import records_of
from skinlab.discrepancy.workflow import explain
from skinlab.mechanics.effects.model import Effects, Skin, forget, response
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.store import shipped_table

Array = NDArray[np.float64]
Distortion = Callable[[Array, Array, Array, np.random.Generator], Array]

RESULTS = Path(__file__).parent / "results"
LINES = RESULTS / "missing_effect.jsonl"
SUMMARY = RESULTS / "missing_effect.json"
PARTS = ("none", "single", "double", "outside", "ramp", "life_none", "life_single")

RATE_HZ = 20.0
FULL = (
    (6.0, "ramp:100@20,ramp:0@20", 1, 1),
    (6.0, "ramp:100@20,ramp:0@20", 1, 2),
    (6.0, "ramp:100@80,ramp:0@80", 1, 1),
    (6.0, "ramp:100@80,hold:8,ramp:0@80,hold:4", 1, 1),
    (2.0, "ramp:300@60,ramp:0@60", 1, 1),
    (8.0, "ramp:100@20,ramp:0@20", 1, 1),
)
# Errors as in life: two or three placements of each opening.
LIFE = (
    (6.0, "ramp:100@80,hold:8,ramp:0@80,hold:4", 1),
    (2.0, "ramp:300@60,ramp:0@60", 1),
    (8.0, "ramp:100@20,ramp:0@20", 1),
)
# Of those effects alone that such campaigns can show at all.
LIFE_EFFECTS = (
    "viscoelasticity", "natural_tension", "hypodermis", "contact_preload", "thickness_error",
    "strain_stiffening",
)  # fmt: skip
SECOND_CYCLE = (6.0, "ramp:100@20,ramp:0@20", 2, 1)
RAMP = ((6.0, "ramp:100@20", 1, 1),)

# Sizes to hide, from weak to strong: lowest and highest of each parameter, drawn log-uniformly in
# its distance from no effect; "±": either sign.
SIZES: dict[str, dict[str, tuple[float, float, float, str]]] = {
    "viscoelasticity": {"g": (0.0, 0.02, 0.45, "+"), "tau_s": (0.0, 0.1, 9.0, "+")},
    "natural_tension": {"stretch": (1.0, 0.003, 0.06, "+")},
    "hypodermis": {"thickness_mm": (0.0, 1.5, 8.0, "+"), "X1_kPa": (0.0, 0.05, 4.0, "+")},
    "contact_preload": {"p0_mbar": (0.0, 0.5, 15.0, "+")},
    "tape_slip": {"slip_mm": (0.0, 0.02, 0.4, "+")},
    "thickness_error": {"ratio": (1.0, 0.02, 0.35, "±")},
    "surface_layer": {"thickness_um": (0.0, 8.0, 40.0, "+"), "X1_MPa": (0.0, 0.2, 4.0, "+")},
    "strain_stiffening": {"X3_MPa": (0.0, 5.0, 300.0, "+")},
    "preconditioning": {"softening": (0.0, 0.01, 0.3, "+")},
    "pressure_lag": {"lag_s": (0.0, 0.005, 0.2, "±")},
    "deflection_offset": {"offset_um": (0.0, 1.0, 60.0, "±")},
    "deflection_gain": {"gain": (1.0, 0.01, 0.15, "±")},
    "baseline_drift": {"drift_um_per_s": (0.0, 0.1, 5.0, "±")},
}


@dataclass(frozen=True)
class Truth:
    """What a campaign was made from."""

    skin: Skin
    effects: Effects
    distortion: str  # the name of something outside the library, or ""
    distortion_size: float
    thickness_mm: float
    noise_um: float
    pressure_noise_mbar: float
    stated: bool
    life: Life | None = None


@dataclass(frozen=True)
class Life:
    """Errors as in life: sizes of what is drawn anew for each curve or placement."""

    ou_um: float
    ou_s: float
    step_um: float
    stiffness: float  # standard deviations, of each placement
    thickness: float
    offset_um: float
    breathing_um: float
    pulse_um: float
    spikes: float  # share of samples
    rate_hz: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Life:
        """Return one kind alone, or all of them."""
        none = cls(0.0, 0.3, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0)
        whole = cls(
            float(rng.uniform(2.0, 3.0)), float(rng.choice([0.1, 0.3, 1.0])),
            float(rng.choice([1.0, 10.0])), float(rng.choice([0.01, 0.03, 0.06])),
            float(rng.choice([0.01, 0.03, 0.05])), float(rng.uniform(3.0, 10.0)),
            float(rng.uniform(2.0, 5.0)), float(rng.uniform(1.0, 3.0)), 0.01,
            float(rng.choice([10.0, 20.0, 50.0])),
        )  # fmt: skip
        kind = str(
            rng.choice(
                ["ou", "step", "stiffness", "thickness", "offset", "periodic", "spikes", "all"]
            )
        )
        of = {
            "ou": ("ou_um", "ou_s"), "step": ("step_um",), "stiffness": ("stiffness",),
            "thickness": ("thickness",), "offset": ("offset_um",),
            "periodic": ("breathing_um", "pulse_um"), "spikes": ("spikes",),
        }  # fmt: skip
        if kind == "all":
            return whole
        return replace(
            none, rate_hz=whole.rate_hz, **{name: getattr(whole, name) for name in of[kind]}
        )

    def errors_um(self, t: Array, rng: np.random.Generator) -> Array:
        """Return what lasts, repeats or jumps in one curve (n,), µm."""
        decay = np.exp(-np.diff(t) / self.ou_s)
        slow = [rng.normal()]
        for d in decay:
            slow.append(d * slow[-1] + np.sqrt(1.0 - d**2) * rng.normal())
        found = self.ou_um * np.array(slow) + self.offset_um * rng.normal()
        for size, band in ((self.breathing_um, (0.2, 0.4)), (self.pulse_um, (1.0, 1.5))):
            angle = 2.0 * np.pi * (rng.uniform(*band) * t + rng.uniform())
            found = found + size * np.sin(angle)
        hit = rng.random(len(t)) < self.spikes
        return np.asarray(found + hit * rng.uniform(30.0, 100.0, len(t)) * rng.choice([-1, 1]))


@dataclass(frozen=True, eq=False)
class Made:
    """A campaign, and its curves before noise."""

    campaign: Campaign
    clean_mm: list[Array]


# ---- what the library does not have: (time, pressure, deflection, rng) -> deflection, at size 1


def heartbeat(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Add 20 µm at about one a second."""
    return w + 0.020 * np.sin(2 * np.pi * 1.2 * t + rng.uniform(0, 2 * np.pi))


def tape_jumps(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the skin jump by up to 60 µm at two moments of a curve, for good."""
    for when in rng.uniform(0.15, 0.85, 2):
        w = w + rng.uniform(0.02, 0.06) * (t > when * t[-1])
    return w


def rate_independent_loop(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Bulge the way back by 15 % of the dome, at any rate the same."""
    x = p / max(float(p.max()), 1e-9)
    back = t > t[int(np.argmax(p))]
    return w + np.where(back, 0.15 * float(w.max()) * 4 * x * (1 - x), 0.0)


def saturation(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Clip a dome at 70 % of its height."""
    return np.minimum(w, 0.7 * float(w.max()))


def wander(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the zero wander by 25 µm over some seconds."""
    period = rng.uniform(4.0, 9.0)
    phase = rng.uniform(0, 2 * np.pi)
    return w + 0.025 * (np.sin(2 * np.pi * t / period + phase) - np.sin(phase))


def play(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the dome follow the suction with a play of 12 mbar."""
    effective, at = np.empty_like(p), 0.0
    for i, asked in enumerate(p):
        at = min(max(at, asked - 6.0), asked + 6.0)
        effective[i] = at
    rising = np.arange(len(p)) <= int(np.argmax(p))
    known_p, known_w = p[rising], w[rising]
    return np.asarray(np.interp(effective, known_p, known_w))


def ringing(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let a filter of 0.7 s ring in the deflection channel, without delaying its mean."""
    bend = np.gradient(np.gradient(w, t), t)
    return w + 0.25 * bend / max(1.0, float(np.abs(bend).max()) / 0.25)


OUTSIDE: dict[str, Distortion] = {
    f.__name__: f
    for f in (heartbeat, tape_jumps, rate_independent_loop, saturation, wander, play, ringing)
}


# ---- making a campaign ---------------------------------------------------------------------------


def draw(part: str, seed: int, number: int, attempt: int) -> tuple[Truth, Any]:
    """Return the truth and the plan of curves of campaign `number`."""
    rng = np.random.default_rng([seed, PARTS.index(part), number, attempt])
    names = tuple(SIZES)
    hidden: list[str] = []
    distortion = ""
    if part == "single":
        hidden = [names[number % len(names)]]
    elif part == "life_single":
        hidden = [LIFE_EFFECTS[number % len(LIFE_EFFECTS)]]
    elif part == "double":
        hidden = sorted(rng.choice(names, 2, replace=False).tolist())
    elif part == "ramp" and number % 4:
        hidden = [str(rng.choice([n for n in names if n != "preconditioning"]))]
    elif part == "outside":
        distortion = list(OUTSIDE)[number % len(OUTSIDE)]
    effects = {name: {k: _size(rng, *v) for k, v in SIZES[name].items()} for name in hidden}
    x1 = float(np.exp(rng.uniform(np.log(0.015), np.log(0.07))))
    x2 = float(np.exp(rng.uniform(np.log(0.5), np.log(4.0))))
    skin = Skin((x1, x2, float(rng.uniform(0.22, 0.42))))
    plan = list(RAMP if part == "ramp" else FULL)
    second = rng.random() < 0.3 or "preconditioning" in hidden
    life = None
    if part.startswith("life"):
        times = 3 if part == "life_single" else int(rng.choice([1, 2, 3]))
        plan = [(*entry, 1 + i) for i in range(times) for entry in LIFE]
        life, second = Life.drawn(rng), False
    if second and part != "ramp":
        plan.append(SECOND_CYCLE)
    truth = Truth(
        skin,
        effects,
        distortion,
        float(np.exp(rng.uniform(np.log(0.15), 0.0))) if distortion else 0.0,
        round(float(rng.uniform(0.9, 1.5)), 2),
        round(float(rng.uniform(2.0, 5.0)), 1),
        round(float(rng.uniform(0.1, 0.3)), 2),
        bool(rng.random() < 0.5),
        life,
    )
    return truth, plan


def _size(rng: np.random.Generator, zero: float, low: float, high: float, sign: str) -> float:
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return zero + size * (float(rng.choice([-1.0, 1.0])) if sign == "±" else 1.0)


def curve_of(
    truth: Truth, entry: tuple[float, str, int, int], rng: np.random.Generator
) -> tuple[Curve, Array] | None:
    """Return the measured curve and the same without noise; None where the skin does not hold."""
    aperture, text, cycle, repeat = entry
    program = parse_program(text)
    life = truth.life
    rate = RATE_HZ if life is None else life.rate_hz
    t = np.arange(int(program.duration_s * rate + 1e-9) + 1) / rate
    path = PressurePath.of_program(program)
    thickness, skin = truth.thickness_mm, truth.skin
    if life is not None:  # a placement of its own
        thickness *= float(np.exp(life.thickness * rng.normal()))
        stiffer = float(np.exp(life.stiffness * rng.normal()))
        x1, x2, nu = skin.values
        skin = Skin((x1 * stiffer, x2 * stiffer, nu))
    geometry = Geometry(aperture, thickness)
    found = response(skin, truth.effects, geometry, path, t, cycle=cycle, discretisation=MESH)
    w = found.deflection_mm
    if not np.isfinite(w).all():
        return None
    if truth.distortion:
        changed = OUTSIDE[truth.distortion](t, path(t), w, rng)
        w = w + truth.distortion_size * (changed - w)
    read_w = w + rng.normal(0.0, 1e-3 * truth.noise_um, len(t))
    step_mm = 1e-3
    if life is not None:
        read_w = read_w + 1e-3 * life.errors_um(t, rng)
        step_mm = 1e-3 * life.step_um
    read_w = step_mm * np.round(read_w / step_mm)
    read_p = np.round(path(t) + rng.normal(0.0, truth.pressure_noise_mbar, len(t)), 1)
    name = f"d{aperture:g}_{text.replace(':', '').replace(',', '_')}_c{cycle}_{repeat}.csv"
    setup = Setup(aperture, truth.thickness_mm, program, cycle, repeat)
    return Curve(name, setup, t, read_p, read_w), w


def make(part: str, seed: int, number: int) -> tuple[Truth, Made]:
    """Return campaign `number`; skins that crease on the way are drawn again."""
    for attempt in range(100):
        truth, plan = draw(part, seed, number, attempt)
        rng = np.random.default_rng([seed, PARTS.index(part), number, attempt, 1])
        found = []
        for entry in plan:
            one = curve_of(truth, entry, rng)
            if one is None:
                break
            found.append(one)
        if len(found) == len(plan):
            return truth, _made(truth, found)
    raise RuntimeError("no skin holds")


def _made(truth: Truth, found: Sequence[tuple[Curve, Array]]) -> Made:
    campaign = Campaign(
        "hidden",
        truth.noise_um if truth.stated else None,
        truth.pressure_noise_mbar if truth.stated else None,
        tuple(curve for curve, _ in found),
    )
    return Made(campaign, [clean for _, clean in found])


# ---- judging one campaign ------------------------------------------------------------------------


def judge(part: str, seed: int, version: str, number: int) -> dict[str, Any]:
    """Return the line of one campaign."""
    forget()
    truth, made = make(part, seed, number)
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
        "estimated_noise_um": records_of(made.campaign)[0].noise_um,
        "base_p": outcome.found.base.left.p_value,
        "life": None if truth.life is None else vars(truth.life),
        "repeats": max(entry.setup.repeat for entry in made.campaign.curves),
        "gap_um": [outcome.gap_before.rms_um, outcome.gap_after.rms_um],
        "gap_noise_um": outcome.gap_after.noise_um,
        "gap_expected_um": outcome.gap_after.expected_um,
        "candidates": [
            [sorted(c.effects), c.log10_evidence, c.left.p_value, c.fit.settled]
            for c in outcome.found.candidates[:6]
        ],
    }  # fmt: skip
    line |= _strength(truth, made, outcome)
    line["parameters"] = outcome.parameters(outcome.best)
    if verdict.name == "ambiguous" and outcome.next_measurement is not None:
        following = outcome.next_measurement
        entry = (following.aperture_mm, following.program, 1, 1)
        rng = np.random.default_rng([seed, PARTS.index(part), number, 2])
        more = curve_of(truth, entry, rng)
        line["next"] = [following.aperture_mm, following.program]
        line["expected_log10_evidence"] = following.expected_log10_evidence
        if more is not None:
            again = replace(made.campaign, curves=(*made.campaign.curves, more[0]))
            second = explain(again, shipped_table()).verdict
            line["then"] = [second.name, [sorted(c.effects) for c in second.explanations]]
    return line


def _strength(truth: Truth, made: Made, outcome: Outcome) -> dict[str, Any]:
    """Return the strength of what was hidden, how separable it is, and what the best fit leaves."""
    found = outcome.found
    errors = found.errors
    # As the workflow saw them: averaged to its rate, without the outliers.
    clean = np.concatenate(
        [
            np.interp(r.curve.time_s, curve.time_s, clean)
            for r, curve, clean in zip(
                found.records, made.campaign.curves, made.clean_mm, strict=True
            )
        ]
    )
    base, best = outcome.found.base.fit, outcome.best.fit

    def left(fit: Any, *more: Array) -> float:
        r = errors.whiten(clean - np.concatenate(fit.deflections_mm))
        q = np.linalg.qr(np.column_stack([fit.jacobian[:, fit.free], *more]))[0]
        return float(np.linalg.norm(r - q @ (q.T @ r)) / 5.0)

    others = {
        name: left(base, s.direction)
        for name, s in outcome.found.signatures.items()
        if name not in truth.effects and s.size > 1e-2
    }
    closest = min(others, key=lambda n: others[n]) if others else ""
    return {
        "strength": left(base),
        "closest": closest,
        "closest_leaves": others.get(closest, 0.0),
        "best_leaves": left(best),
    }


# ---- summary -------------------------------------------------------------------------------------


def share(hits: Iterable[bool]) -> dict[str, Any]:
    """Return a share with its 90 % interval (Clopper and Pearson)."""
    found = list(hits)
    k, n = sum(found), len(found)
    low = float(beta.ppf(0.05, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.95, k + 1, n - k)) if k < n else 1.0
    return {"share": k / n if n else None, "of": n, "low": low, "high": high}


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


def among(line: dict[str, Any]) -> bool:
    """Return whether the truth, or all of it that these curves can show, is among the tied."""
    weak = line["best_leaves"] < 1.0
    return any(
        named == line["hidden"] or (weak and set(named) < set(line["hidden"]))
        for named in line["effects"]
    )


def covered(line: dict[str, Any], name: str) -> bool:
    """Return whether the interval of a base parameter holds its true value."""
    value = line["skin"][("X1_MPa", "X2_MPa", "nu").index(name)]
    found = line["parameters"][name]
    return bool(found["low"] <= value <= found["high"])


def figures(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures: each with its target, where there is one."""
    full = [x for x in lines if x["part"] in ("none", "single", "double", "outside")]
    life_none = [x for x in lines if x["part"] == "life_none"]
    life_single = [x for x in lines if x["part"] == "life_single"]
    life_named = [x for x in life_none + life_single if x["verdict"] == "named"]
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
        "cpu_seconds_highest": max((x["cpu_seconds"] for x in lines), default=None),
    }  # fmt: skip


def _settled(line: dict[str, Any]) -> bool:
    """Return whether a tie was resolved to the truth, or to all of it that can be seen."""
    verdict, effects = line["then"]
    return verdict == "named" and among({**line, "effects": effects})


def _x1_deviation(line: dict[str, Any]) -> float:
    found = line["parameters"]["X1_MPa"]
    return float(np.log(found["high"] / found["low"]) / (2 * 1.6449))


def confusion(lines: Sequence[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """Return verdicts by what was hidden; a name given is told as right or as the wrong name."""
    rows: dict[str, Counter[str]] = {}
    for x in lines:
        what = x["part"]
        if what in ("single", "outside", "life_single"):
            what = f"{what}: {x['outside'] or x['hidden'][0]}"
        verdict = x["verdict"]
        if verdict == "named":
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
        "confusion": confusion(lines),
    }


def show(result: dict[str, Any]) -> None:
    """Print the summary."""
    print("campaigns: " + ", ".join(f"{k} {v}" for k, v in result["campaigns"].items()))
    for what, row in result["confusion"].items():
        print(f"  {what:30s} " + "; ".join(f"{k}: {v}" for k, v in row.items()))
    for name, value in result["figures"].items():
        if isinstance(value, dict):
            if value["of"]:
                print(
                    f"  {name:46s} {100 * value['share']:5.1f} % of {value['of']:3d} "
                    f"({100 * value['low']:.1f}–{100 * value['high']:.1f} %)"
                    + (f", target {value['target']}" if "target" in value else "")
                )
        elif value is not None:
            print(f"  {name:46s} {value:.2f}")


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
    parser.add_argument("--lines", type=Path, default=LINES)
    parser.add_argument("--summary", action="store_true", help="of the lines that there are")
    parser.add_argument("--any-version", action="store_true", help="count lines of other versions")
    arguments = parser.parse_args()
    version = version_of()
    done = {
        (x["part"], x["seed"], x["number"])
        for x in read(arguments.lines, None if arguments.any_version else version)
    }
    arguments.lines.parent.mkdir(exist_ok=True)
    for part in [] if arguments.summary else arguments.part or PARTS:
        numbers = [
            n
            for n in range(arguments.first, arguments.first + arguments.campaigns)
            if (part, arguments.seed, n) not in done
        ]
        with ProcessPoolExecutor(arguments.workers) as pool, arguments.lines.open("a") as out:
            work = [pool.submit(partial(judge, part, arguments.seed, version, n)) for n in numbers]
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
        SUMMARY.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
