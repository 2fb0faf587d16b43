"""What moves in each curve in its own way, and is too large to be an error: a heartbeat, a drift.

Repeats do not have it in common, so that no function of suction, height or time since the start
takes it up: it is found where the errors are learned, and what is learned is its size and how fast
it goes. Its course in a new curve is not known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.adequacy import steps
from skinlab.discrepancy.campaign_errors import Linearised, size_um
from skinlab.discrepancy.candidates import Candidate, Found
from skinlab.discrepancy.discipline import Trial, by_part
from skinlab.discrepancy.records import by_condition
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import ERRORS, NAMES
from skinlab.discrepancy.unknowns import Known
from skinlab.inference.error_choice import ErrorChoice, Node
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.learned_motion import LearnedMotion

Array = NDArray[np.float64]


def find_motion(search: Search, found: Found) -> tuple[Candidate, tuple[Trial, ...]] | None:
    """Return what the errors show that is too large to be one, with its trials.

    None where nothing is, or where the model as it is has it already.
    """
    shown = _shown(search, found)
    if not shown or _effect_of(shown).name in found.base.effects:
        return None
    linear, node = search.linear(found.base.fit), _node(search.errors.looks[-1], shown)
    squares = _squares_um2(linear, node, shown)
    candidate = _candidate(found.base, found, node, shown, _root(squares))
    return candidate, tuple(_trials(search, linear, node, squares))


def has_motion(search: Search, found: Found) -> bool:
    """Return whether what is too large for an error is what the model as it is says that moves.

    That has a phase of its own in each curve, so that the errors take it up, as they did when it
    was learned. One of more than twice the size is another one.
    """
    shown, look, own = _shown(search, found), search.errors.looks[-1], found.base.fit.unknowns
    most = ERRORS.largest_um
    large = {shown, *(n for n in most if look.median(partial(size_um, name=n)) > most[n])}
    if not shown or any(_effect_of(name).name not in own.effects for name in large):
        return False
    known = [k for k in own.known if k.effect == _effect_of(shown).name]
    said_um = float(np.sqrt(0.5 * sum(k.sd**2 for k in known)))
    squares = _squares_um2(search.linear(found.base.fit), _node(look, shown), shown)
    # Where it was learned from these curves, nothing is said of its size.
    return not said_um or _root(squares) <= NAMES.same_motion * said_um


def _shown(search: Search, found: Found) -> str:
    """Return which part of the errors is too large to be one, "" where none is.

    Nor where the model as it is leaves more than that: pure error and the best explanation have to
    agree, for what a wrong model leaves may look like a motion.
    """
    errors, base = search.errors, found.base
    noise = found.errors.count
    repeated = any(len(members) > 1 for members in by_condition(found.records))
    if not repeated or base.fit.chi2 - noise > NAMES.learned_left * noise:
        return ""
    looks = (errors.pure, errors.looks[-1])
    sizes = {
        n: [look.median(partial(size_um, name=n)) for look in looks] for n in ERRORS.largest_um
    }
    agree, largest_um = ERRORS.wave_agree, ERRORS.largest_um
    if any(last > max(agree * pure, largest_um[n]) for n, (pure, last) in sizes.items()):
        return ""  # it is in what the explanation leaves, not in what repeats differ by
    ratios = {name: min(size) / ERRORS.largest_um[name] for name, size in sizes.items()}
    name = max(ratios, key=lambda n: ratios[n])
    linear = search.linear(base.fit)
    # What wanders smoothly is no error of any size: those of skins and sensors are rough.
    doubtful = base.left.by_errors < ERRORS.adequate
    smooth = doubtful and np.linalg.norm(list(ratios.values())) > NAMES.smooth_motion
    if not smooth and ratios[name] <= 1.0:
        return next((n for n in NAMES.wave_um if _stands_out(looks, linear, n)), "")
    return name


def _effect_of(name: str) -> LearnedMotion:
    """Return the effect that says what a part of the errors is, where that is no error."""
    one = get_effect("learned_motion" if name in NAMES.wave_um else "learned_wander")
    assert isinstance(one, LearnedMotion)
    return one


def _root(squares: Array) -> float:
    """Return the root of mean squares' mean."""
    return float(np.sqrt(max(squares.mean(), 0.0)))


def _stands_out(looks: Sequence[ErrorChoice], linear: Linearised, name: str) -> bool:
    """Return whether a wave is surely there and, whichever curve is left out, larger than any."""
    if not all(look.probability(name) >= ERRORS.wave_sure for look in looks):
        return False
    squares = _squares_um2(linear, _node(looks[-1], name), name)
    return bool((_without_one(squares) > NAMES.wave_um[name] ** 2).all())


def _node(look: ErrorChoice, name: str) -> Node:
    """Return the likeliest setting that has this part."""
    return next(n for n in look.nodes if name in n.sizes_um)


def _without_one(squares: Array) -> Array:
    """Return the mean squares (curves,) of all curves but one."""
    return np.asarray((squares.sum() - squares) / max(len(squares) - 1, 1))


def _candidate(base: Candidate, found: Found, node: Node, name: str, moved_um: float) -> Candidate:
    """Return the model as it is with a motion of which no curve tells the next one's course."""
    one, values = _effect_of(name), node.values
    longest_s = max(float(np.ptp(r.curve.time_s)) for r in found.records)
    wave = name in NAMES.wave_um
    hz = values[f"{name}_hz"] if wave else 0.5 / longest_s
    k = np.arange(1, one.harmonics + 1)
    power = 1.0 / (1.0 + np.square(2.0 * np.pi * k * hz * (0.0 if wave else values["ou_s"])))
    sizes_um = moved_um * np.sqrt(power / power.sum())
    known = [
        Known(one.name, f"{letter}{i}_um", 0.0, float(size))
        for letter in "sc"
        for i, size in zip(k, sizes_um, strict=True)
    ]
    known.append(Known(one.name, one.range_name, float(hz), 0.0))
    before, m = base.fit.unknowns, len(one.names)
    unknowns = replace(before, effects=(*before.effects, one.name), known=(*before.known, *known))
    fit = replace(
        base.fit,
        unknowns=unknowns,
        u=np.concatenate([base.fit.u, np.zeros(m)]),
        jacobian=np.hstack([base.fit.jacobian, np.zeros((len(base.fit.jacobian), m))]),
    )
    return replace(base, fit=fit)


def _trials(search: Search, linear: Linearised, node: Node, squares: Array) -> Iterator[Trial]:
    """Tell whether it is there whichever curve is left out, and leaves no steps."""
    yield Trial(
        "size", True,
        f"it moves the readings by {np.sqrt(squares.mean()):.1f} µm, more than errors do or more "
        "smoothly",
    )  # fmt: skip
    again = bool((_without_one(squares) > ERRORS.wave_rest * squares.mean()).all())
    yield Trial(
        "again", again,
        "it is there again with any one curve left out"
        if again else "it is not there whichever curve is left out",
    )  # fmt: skip
    left = steps(search.fitter.records, node.covariance, linear.residual_mm, node.unrounded)
    passed = not left.sudden
    yield Trial(
        "steps", passed,
        "it leaves no sudden steps"
        if passed else "there are sudden steps in it, as of tape that lets go",
    )  # fmt: skip


def _squares_um2(linear: Linearised, node: Node, name: str) -> Array:
    """Return the mean squares of the motion in each curve, µm²."""
    did = by_part(node, linear.shares(node.covariance))
    if name in did:
        parts = node.covariance.split(did[name])
        return np.array([1e6 * float(np.mean(part**2)) for part in parts])
    left = linear.residual_mm - sum(did.values())
    # Of neighbours: noise of single samples has no part in it.
    return np.array([1e6 * float(np.mean(x[1:] * x[:-1])) for x in node.covariance.split(left)])
