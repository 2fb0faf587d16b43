"""What putting the probe on anew does to a curve: along slopes, and where these bend.

Placements are random effects along straight lines (`error_models/placement.py`). A skin that is a
tenth thinner at one place moves its curve by no straight line: what is left over, some micrometres,
would look like something that the model misses. It is computed at what repeats say of each
placement, and taken off: the first-order conditional method of nonlinear mixed-effects models
(Lindstrom and Bates 1990, Biometrics 46:673).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.records import Record, by_condition
from skinlab.discrepancy.table_domes import TableDomes, remembered
from skinlab.inference.covariance import Covariance
from skinlab.inference.error_choice import ErrorChoice, Node
from skinlab.inference.error_combination import Combination
from skinlab.inference.likelihood import LinearModel
from skinlab.inference.noise import slope_mm_per_mbar, smooth_mm
from skinlab.mechanics.effects.model import problem_of
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]
_Way = Callable[[Record], Array]  # from a record to the suction (n,) that its dome has come to

_CHANGE = 1.025  # of a thickness, to either side
_REACH = 1.8  # of the highest suction: a soft place is where the model is at more of it
_LATE_S = np.geomspace(0.02, 2.0, 9)  # by which a dome may come late
_RUBBED = np.geomspace(0.01, 0.3, 9)  # by which share of the suction it may stick,
_NEARER = (0.8, 1.25, 7)  # then nearer to the best of these
_FELT_GAIN = 0.7  # of what a function of the suction leaves: less is neither
_SHARES = np.linspace(0.05, 1.0, 120) ** 2  # of the highest suction


def softer_mm(records: Sequence[Record]) -> Array:
    """Return dw/d(log softness) (u,), mm, halfway between each curve and the mean of its repeats.

    With slopes halfway along the way to another stiffness what is left is of third order. Of the
    mean alone, or of each curve alone, half of the bend would be left. A dome that comes late, or
    sticks on the way back, is a function of the suction that it has come to: there p dw/dp is
    taken, not at its own time's.
    """
    found = [np.empty(0)] * len(records)
    felt_mbar = _felt_mbar(tuple(records))
    for members in by_condition(records):
        curves = [records[i].curve.deflection_mm for i in members]
        pressures = [felt_mbar[i] for i in members]
        common = slope_mm_per_mbar(np.concatenate(pressures), np.concatenate(curves))
        ends = np.cumsum([len(w) for w in curves])[:-1]
        for i, p, w, mean in zip(members, pressures, curves, np.split(common, ends), strict=True):
            found[i] = p * 0.5 * (mean + slope_mm_per_mbar(p, w))
    return np.concatenate(found)


def with_stiffness_of(fit: Fit, look: ErrorChoice) -> ErrorChoice:
    """Return errors where placements do what a stiffness does to this fit's curves.

    The fit's slopes are whitened by `look.mode`. While explanations are compared placements do
    p dw/dp of the measured curves, which all have in common. What relaxes has no such slope: what
    it is off by would tell the skin's own stiffness from that of the placements, and intervals
    would not count with these.
    """
    own_mm = look.mode.colour(fit.jacobian[:, fit.unknowns.space.scale])
    return _with_own(look, own_mm, "placement")


def with_thickness_of(
    fit: Fit, look: ErrorChoice, records: Sequence[Record], domes: TableDomes
) -> ErrorChoice:
    """Return errors where another thickness of a placement does what it does to this fit's skin.

    While explanations are compared it does what it does to the model as it is. Of a skin that is an
    eighth thicker than stated that was off by a tenth, 3 µm where places differ by 3 %: the truth
    was no answer.
    """
    return _with_own(look, thickness_slopes(records, fit, domes), "placement_thickness")


def _with_own(look: ErrorChoice, own_mm: Array, name: str) -> ErrorChoice:
    """Return errors with another slope (u,) of a kind's first parameter, in each placement."""
    known: dict[int, Array] = {}

    def with_own(errors: Covariance, combination: Combination) -> Covariance:
        part = next((p for p in combination.parts if p.name == "placement"), None)
        if (
            part is None
            or "placement_count" not in part.stated  # of a curve alone a zero at most
            or name not in combination.columns
        ):
            return errors
        if id(errors.shapes_mm) not in known:
            count, begin = round(part.stated["placement_count"]), combination.columns[name].start
            first = combination.columns[part.name].start
            zero = errors.shapes_mm[:, first + count : first + 2 * count]
            shapes = errors.shapes_mm.copy()
            shapes[:, begin : begin + count] = own_mm[:, None] * (zero != 0.0)
            known[id(errors.shapes_mm)] = shapes
        return replace(errors, shapes_mm=known[id(errors.shapes_mm)])

    nodes = [replace(n, covariance=with_own(n.covariance, n.combination)) for n in look.nodes]
    return replace(look, nodes=tuple(nodes), mode=with_own(look.mode, look.best))


@lru_cache(maxsize=4)
def _felt_mbar(records: tuple[Record, ...]) -> list[Array]:
    """Return of each record the suctions (n,) of which it is a function, most nearly.

    With the time of the first order, or the share of dry friction, that leaves least between ways
    up and down of a condition; of all conditions, where its own noise hides that. Both are in
    proportion to the suction, as what a stiffness does is: of a loop p dw/dp at the suction itself
    was off by 170 µm at its top, where a placement is softer by 0.36 (log).
    """
    ways: list[_Way] = [partial(_late_mbar, by_s=s) for s in _LATE_S]
    ways += [partial(_rubbed_mbar, share=s) for s in _RUBBED]
    conditions = by_condition(records)
    left = np.array([[_left(records, c, way) for way in (_as_it_is, *ways)] for c in conditions])
    found = [r.pressure_mbar for r in records]
    common = _least(left.sum(axis=0))
    for members, own in zip(conditions, left, strict=True):
        best = _least(own) or common
        if not best:
            continue
        way = ways[best - 1]
        if best > len(_LATE_S):  # the top of a loop needs its share to a tenth
            near = _RUBBED[best - 1 - len(_LATE_S)] * np.geomspace(*_NEARER)
            again: list[_Way] = [partial(_rubbed_mbar, share=share) for share in near]
            way = again[int(np.argmin([_left(records, members, one) for one in again]))]
        for i in members:
            found[i] = way(records[i])
    return found


def _as_it_is(record: Record) -> Array:
    return record.pressure_mbar


def _left(records: Sequence[Record], members: Sequence[int], way: _Way) -> float:
    """Return what functions of a suction leave of some records' deflections, mm²."""
    each = ((way(records[i]), records[i].curve.deflection_mm) for i in members)
    return sum(float(np.square(w - smooth_mm(p, w)).sum()) for p, w in each)


def _least(left: Array) -> int:
    """Return which way leaves least, 0 where it is not much less than of the suction as it is."""
    best = int(np.argmin(left))
    return best if left[best] <= _FELT_GAIN * left[0] else 0


def _late_mbar(record: Record, by_s: float) -> Array:
    """Return the suction (n,) after a lag of the first order.

    Of the readings: a record's path, which the effect `regulator_lag` takes, is 1 to 2 mbar off
    them where the channel is believed, and a lag was no longer told from a creep with it.
    """
    time_s, pressure_mbar = record.curve.time_s, record.pressure_mbar
    dt = np.diff(time_s)
    decay = np.exp(-dt / by_s)
    behind = by_s * np.diff(pressure_mbar) / np.maximum(dt, 1e-9)
    gained = pressure_mbar[1:] - behind - (pressure_mbar[:-1] - behind) * decay
    return remembered(decay, np.append(pressure_mbar[:1], gained))


def _rubbed_mbar(record: Record, share: float) -> Array:
    """Return the suction (n,) after a play in proportion to it; on the way up it is itself."""
    most, at, found = (1.0 + share) / (1.0 - share), record.pressure_mbar[0], []
    for p in record.pressure_mbar.tolist():
        at = max(p, min(at, most * p))
        found.append(at)
    return np.array(found)


def thickness_slopes(records: Sequence[Record], fit: Fit, domes: TableDomes) -> Array:
    """Return dw/d(log thickness) (u,), mm, of the plain skin at a fit, where the table speaks.

    Of a dome that comes late, or sticks, it is that of the suction that it has come to.
    """
    relative: dict[Geometry, tuple[Array, Array]] = {}
    found = []
    each = zip(records, _felt_mbar(tuple(records)), fit.deflections_mm, strict=True)
    for record, felt_mbar, deflection_mm in each:
        at = record.geometry
        if at not in relative:
            top = _top_mbar(records, at)
            relative[at] = top * _SHARES, _thickness_share(fit, domes, _as_explained(fit, at), top)
        # The model's deflection: the measured one's noise would explain the noise.
        found.append(np.interp(felt_mbar, *relative[at]) * deflection_mm)
    return np.concatenate(found)


def bends_mm(
    records: Sequence[Record],
    fit: Fit,
    domes: TableDomes,
    pure: LinearModel,
    node: Node,
    before_mm: Array,
    thickness_mm: Array,
) -> list[Array]:
    """Return what each record's placement does (n,) beyond its slopes, mm.

    `pure` is what repeats tell, whatever the model, with the errors of `node`, which were learned
    with thickness slopes `before_mm` (u,); `thickness_mm` (u,) are those of this fit.
    """
    found = [np.zeros(len(r.curve)) for r in records]
    repeated = [members for members in by_condition(records) if len(members) > 1]
    if not repeated:
        return found
    softer, thicker = _deviations(records, pure, node, before_mm, thickness_mm)
    felt_mbar = _felt_mbar(tuple(records))
    for members in repeated:
        # What all places of a condition have in common no repeat tells from the skin.
        softer[members] -= softer[members].mean()
        thicker[members] -= thicker[members].mean()
        at = records[members[0]].geometry
        top = _top_mbar(records, at)
        at, p = _as_explained(fit, at), top * _SHARES
        skin = fit.unknowns.skin(fit.u)
        each = [
            SkinProblem(replace(at, thickness_mm=at.thickness_mm * float(np.exp(thicker[i]))), skin)
            for i in members
        ]
        places = domes([SkinProblem(at, skin), *each], [_REACH * top] * (1 + len(each)))
        factor = np.exp([0.0, *(softer[i] for i in members)])
        plain, *own = places(p[None] * factor[:, None])
        slopes = [np.gradient(w, p) for w in own]
        mean = np.mean(slopes, axis=0)
        share = _thickness_share(fit, domes, at, top)
        for i, w, slope in zip(members, own, slopes, strict=True):
            straight = softer[i] * p * 0.5 * (mean + slope) + thicker[i] * share * plain
            left = np.nan_to_num((w - plain - straight) / plain)
            found[i] = np.interp(felt_mbar[i], p, left) * fit.deflections_mm[i]
    return found


def _as_explained(fit: Fit, stated: Geometry) -> Geometry:
    """Return the opening and the thickness as a fit has them."""
    return problem_of(fit.unknowns.skin(fit.u), fit.unknowns.values(fit.u), stated).geometry


def _top_mbar(records: Sequence[Record], at: Geometry) -> float:
    return max(r.path.top_mbar for r in records if r.geometry == at)


def _thickness_share(fit: Fit, domes: TableDomes, at: Geometry, top_mbar: float) -> Array:
    """Return d(log w)/d(log thickness) at `_SHARES` of a suction."""
    skin = fit.unknowns.skin(fit.u)
    each = [
        SkinProblem(replace(at, thickness_mm=at.thickness_mm * factor), skin)
        for factor in (1.0 / _CHANGE, _CHANGE)
    ]
    thinner, thicker = domes(each, [top_mbar] * 2)(top_mbar * _SHARES[None])
    return np.asarray(np.nan_to_num(np.log(thicker / thinner) / np.log(_CHANGE**2)))


def _deviations(
    records: Sequence[Record], pure: LinearModel, node: Node, before_mm: Array, thickness_mm: Array
) -> tuple[Array, Array]:
    """Return by how much each record's place is softer and thicker: logarithms (records,)."""
    placement = np.repeat([r.placement for r in records], [len(r.curve) for r in records])
    numbers = np.unique(placement)
    one = (placement[:, None] == numbers).astype(float)
    softer = softer_mm(records)[:, None] * one
    thicker = thickness_mm[:, None] * one
    columns, where = node.covariance.columns_mm.copy(), node.combination.columns
    of_thickness = where.get("placement_thickness", slice(0))
    if "placement_thickness" in where:
        sizes = _multiples(columns[:, of_thickness], before_mm[:, None] * one)
        columns[:, of_thickness] = thicker * sizes
    did = pure.shares(replace(node.covariance, shapes_mm=columns, sizes=None))
    row = np.searchsorted(numbers, [r.placement for r in records])
    none = np.zeros(len(row))
    # Stiffnesses are the first columns of a placement
    of_stiffness = did[:, where.get("placement", slice(0))][:, : len(numbers)]
    return (
        _multiples(of_stiffness, softer)[row] if "placement" in where else none,
        _multiples(did[:, of_thickness], thicker)[row] if "placement_thickness" in where else none,
    )


def _multiples(columns: Array, units: Array) -> Array:
    """Return of which multiples (m,) of other columns these (u, m) are."""
    return np.asarray((columns * units).sum(axis=0) / np.maximum((units**2).sum(axis=0), 1e-30))
