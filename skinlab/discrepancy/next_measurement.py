"""What to measure next, and the shortest plan that would settle it: sequential discrimination.

Each explanation that is still possible predicts what a measurement would give, as far as the
campaign at hand tells its unknowns (linearised). From every one of them outcomes are drawn; each
outcome is weighed by all, and so becomes a verdict. What counts is how probable a right name is,
and how many minutes of a patient it costs. Sources: Box and Hill 1967 (Technometrics 9:57);
Hunter and Reiner 1965 (ibid. 7:307).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.planned_curve import (
    PlannedCurve,
    PlannedErrors,
    expected,
    menu,
    planned_record,
    rig_lag_s,
)
from skinlab.discrepancy.problem_map import ProblemMap
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.settings import PLANS
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]

Names = tuple[str, ...]


@dataclass(frozen=True)
class Planned:
    """One program through one opening, the probe put on anew each of so many times."""

    aperture_mm: float
    program: str
    placements: int
    minutes: float


@dataclass(frozen=True)
class Plan:
    """Measurements, and the verdicts that they may be expected to lead to.

    `named` is the probability, of each explanation, that it is true and gets the name; `wrong` that
    another one does, `tied` that none does. `fair` is that of the right name if all that are tied
    were as likely: what merely confirms the one that leads settles nothing.
    """

    measurements: tuple[Planned, ...]
    named: tuple[tuple[Names, float], ...]
    wrong: float
    tied: float
    fair: float = 1.0

    @property
    def minutes(self) -> float:
        """Time of the patient."""
        return sum(m.minutes for m in self.measurements)

    @property
    def settled(self) -> float:
        """Probability of the right name."""
        return sum(p for _, p in self.named)

    @property
    def sure(self) -> float:
        """The same, whichever of the tied is true."""
        return min(self.settled, self.fair)


@dataclass(frozen=True)
class NextMeasurement:
    """A measurement, which explanations it separates, and by how much evidence it may be hoped.

    `alone` is what it is expected to lead to by itself; `plan` the shortest plan with it that would
    settle it, or the best that there is.
    """

    aperture_mm: float
    program: str
    separates: tuple[Names, ...]
    expected_log10_evidence: float
    alone: Plan | None = None
    plan: Plan | None = None

    @property
    def placements(self) -> int:
        """How often the probe is put on for it."""
        return 1 if self.alone is None else self.alone.measurements[0].placements


@dataclass(frozen=True, eq=False)
class _Look:
    """A measurement as the explanations see it, in inner products weighed by its errors."""

    planned: Planned
    dose_mbar_s: float  # suction times time, of all placements
    # (settings, columns, columns): of what each explanation expects, and how that may give way
    gram: Array
    fresh: bool  # whether the campaign has no such condition

    @property
    def kind(self) -> tuple[float, str]:
        return self.planned.aperture_mm, self.planned.program


@dataclass(frozen=True, eq=False)
class _Odds:
    """The explanations that are weighed, and outcomes drawn from each."""

    names: Sequence[Names]
    log10_evidence: Array
    tied: int  # so many, the first ones; the others are behind, and may come back
    widths: Sequence[int]  # unknowns of each explanation
    tie: float
    normal: Array  # (draws, columns of all) of which outcomes are made

    @property
    def probability(self) -> Array:
        """Of each explanation, now."""
        odds = 10.0 ** (self.log10_evidence - self.log10_evidence.max())
        return np.asarray(odds / odds.sum())

    def plan(self, looks: Sequence[_Look]) -> Plan:
        """Return what these measurements together are expected to lead to."""
        tie = self.tie if any(look.fresh for look in looks) else max(self.tie, PLANS.lone_tie)
        grams = np.sum([look.gram for look in looks], axis=0)
        right, wrong = np.mean([self._decided(gram, tie) for gram in grams], axis=0)
        p = self.probability
        named = tuple((n, float(s)) for n, s in zip(self.names, p * right, strict=True))
        settled, failed = float(p @ right), float(p @ wrong)
        measurements = tuple(look.planned for look in looks)
        fair = float(right[: self.tied].mean())
        return Plan(measurements, named, failed, max(0.0, 1.0 - settled - failed), fair)

    def _decided(self, gram: Array, tie: float) -> Array:
        """Return how often each explanation's outcomes give it the name, and another one (2, n)."""
        n = len(self.names)
        values, vectors = np.linalg.eigh(gram)
        kept = values > 1e-9 * max(float(values[-1]), 1.0)
        at = vectors[:, kept] * np.sqrt(values[kept])  # each column's coordinates (columns, d)
        d = at.shape[1]
        ends = np.cumsum([n, *self.widths])
        ways = [at[a:b].T for a, b in pairwise(ends.tolist())]  # (d, k)
        roots = np.linalg.cholesky(np.array([np.eye(d) + w @ w.T for w in ways]))
        whiten = np.linalg.inv(roots).transpose(0, 2, 1)
        log_det = 2.0 * np.log(np.einsum("ndd->nd", roots)).sum(axis=1)
        found = np.empty((2, n))
        for i in range(n):
            drawn = at[i] + self.normal[:, :d] @ roots[i].T
            z = (drawn - at[:n, None]) @ whiten  # by each explanation (n, draws, d)
            each = -0.5 * (np.einsum("nod,nod->on", z, z) + log_det)
            total = self.log10_evidence + each / math.log(10.0)
            order = np.sort(total, axis=1)
            decided = order[:, -1] - order[:, -2] >= tie
            right = decided & (total.argmax(axis=1) == i)
            found[:, i] = right.mean(), (decided & ~right).mean()
        return found

    def expected_log10(self, look: _Look) -> float:
        """Return the log10 evidence between the two of the tied that it separates least.

        Half the squared length of the difference of their curves, what either's unknowns may still
        give way by counted as an error.
        """
        ends = np.cumsum([len(self.names), *self.widths])
        least = math.inf
        for i, j in combinations(range(self.tied), 2):
            rows = [*range(ends[i], ends[i + 1]), *range(ends[j], ends[j + 1])]
            chi2 = 0.0
            for gram in look.gram:
                apart = np.zeros(len(gram))
                apart[i], apart[j] = 1.0, -1.0
                across = gram[rows] @ apart
                inner = np.eye(len(rows)) + gram[np.ix_(rows, rows)]
                chi2 += float(apart @ gram @ apart - across @ np.linalg.solve(inner, across))
            least = min(least, 0.5 * chi2 / len(look.gram) / math.log(10.0))
        return least


def advise(
    fitter: Fitter,
    tied: Sequence[Fit],
    log10_evidence: Sequence[float],
    errors: Sequence[PlannedErrors],
    rng: np.random.Generator,
    behind: Sequence[Fit] = (),
) -> NextMeasurement | None:
    """Return the measurement that best tells explanations apart, None if none does.

    The plan goes on from there where it may not be enough. `log10_evidence` is that of each,
    the odds before the data counted; first of those that are tied, then of those `behind` that may
    come back. `errors` are settings as likely as each other.
    """
    every = [*tied, *behind]
    names = [f.effects for f in every]
    widths = [len(f.u) for f in every]
    normal = rng.standard_normal((PLANS.outcomes, len(every) + sum(widths)))
    odds = _Odds(names, np.array(log10_evidence), len(tied), widths, PLANS.tie, normal)
    looks = _looks(fitter, every, errors)
    if not looks:
        return None
    now = odds.plan([replace(looks[0], gram=np.zeros_like(looks[0].gram))]).sure
    first, alone = _most_telling([(look, odds.plan([look])) for look in looks])
    plan = _going_on(odds, looks, first, alone)
    expected = odds.expected_log10(first)
    if plan.sure - now < PLANS.least_gain and expected < PLANS.useless:
        return None
    return NextMeasurement(
        first.planned.aperture_mm,
        first.planned.program,
        tuple(fit.effects for fit in tied),
        expected,
        alone,
        plan,
    )


def _most_telling(singles: Sequence[tuple[_Look, Plan]]) -> tuple[_Look, Plan]:
    """Return the quickest measurement that is expected to settle it alone.

    Where none is, the quickest of those that come about as near as any.
    """
    most = max(plan.sure for _, plan in singles)
    enough = PLANS.settled if most >= PLANS.settled else most - PLANS.as_sure
    return min((s for s in singles if s[1].sure >= enough), key=lambda s: s[1].minutes)


def _going_on(odds: _Odds, looks: Sequence[_Look], first: _Look, alone: Plan) -> Plan:
    """Return the shortest plan with this measurement that is expected to settle it.

    Else the one that comes nearest.
    """
    best, plans = alone, [([first], alone)]
    for _ in range(PLANS.most_measurements):
        best = max((best, *(plan for _, plan in plans)), key=lambda plan: plan.sure)
        enough = [plan for _, plan in plans if plan.sure >= PLANS.settled]
        if enough:
            return min(enough, key=lambda plan: plan.minutes)
        leaders = sorted(plans, key=lambda p: -p[1].sure)[: PLANS.beam]
        plans = []
        for chosen, _ in leaders:
            for look in looks:
                if look.kind in {one.kind for one in chosen}:
                    continue
                both = [*chosen, look]
                if _bearable(both):
                    plans.append((both, odds.plan(both)))
        if not plans:
            break
    return best


def _bearable(looks: Sequence[_Look]) -> bool:
    """Return whether one visit has the time, and one site bears the dose."""
    return (
        len(looks) <= PLANS.most_measurements
        and sum(look.planned.minutes for look in looks) <= PLANS.most_minutes
        and sum(look.dose_mbar_s for look in looks) <= PLANS.most_dose_mbar_s
    )


def _looks(fitter: Fitter, tied: Sequence[Fit], errors: Sequence[PlannedErrors]) -> list[_Look]:
    """Return the menu as the explanations see it; what one of them does not bear is left out."""
    have = {(r.geometry.aperture_mm, str(r.curve.setup.program or "")) for r in fitter.records}
    apertures = {r.geometry.aperture_mm for r in fitter.records}
    creases = {r.geometry: r.creases_mbar for r in fitter.records}
    errors_there = {r.geometry: r.table_errors for r in fitter.records}
    late_s = rig_lag_s(fitter.records)
    relaxes = any(_relaxes(fitter, f) for f in tied)
    found = []
    for aperture in PLANS.tops_mbar:
        geometry = Geometry(aperture, fitter.records[0].geometry.thickness_mm)
        each = [
            fitter.domes.creases_mbar(SkinProblem(geometry, f.unknowns.skin(f.u))) for f in tied
        ]
        holds_to = creases.get(geometry, each[0])
        if not (programs := menu(aperture, min(holds_to, *each), relaxes=relaxes)):
            continue
        off = errors_there.get(geometry)
        if off is None:
            skin = tied[0].unknowns.skin(tied[0].u)
            off = fitter.domes.seen_errors(SkinProblem(geometry, skin))
        records = [planned_record(fitter, geometry, one, holds_to, late_s, off) for one in programs]
        seen = [expected(fitter, fit, records) for fit in tied]
        held = [one for one in seen if one is not None]
        if len(held) < len(tied):
            continue
        for i, (program, record) in enumerate(zip(programs, records, strict=True)):
            curves = [curves[i] for curves, _ in held]
            planned = PlannedCurve.of(fitter, record, tied[0], curves)
            curves = [c + planned.mesh_expected_mm(f) for f, c in zip(tied, curves, strict=True)]
            ways = [planned.ways_mm(f, ws[i]) for f, (_, ws) in zip(tied, held, strict=True)]
            columns = np.column_stack([*(c - curves[0] for c in curves), *ways])
            dose_mbar_s = float(trapezoid(record.pressure_mbar, record.curve.time_s))
            most = min(PLANS.most_placements, int(PLANS.most_dose_mbar_s / dose_mbar_s))
            for placements in range(1, most + 1):
                tiled = np.tile(columns, (placements, 1))
                whole = [planned.errors(one, placements).whiten(tiled) for one in errors]
                minutes = _minutes(record, placements, opened=aperture not in apertures)
                fresh = (aperture, str(record.curve.setup.program)) not in have
                one = Planned(aperture, program, placements, minutes)
                gram = np.array([x.T @ x for x in whole])
                found.append(_Look(one, placements * dose_mbar_s, gram, fresh))
    return found


def _relaxes(fitter: Fitter, fit: Fit) -> bool:
    """Return whether the skin of an explanation goes on moving under the same suction."""
    problems = ProblemMap(fitter.records, fit.unknowns).at(fit.u)
    return problems is not None and any(p.prony for p in problems.problems.values())


def _minutes(record: Record, placements: int, *, opened: bool) -> float:
    """Return what a measurement takes of a patient's time."""
    program = record.curve.setup.program
    assert program is not None
    each = program.duration_s / 60.0 + PLANS.placement_min
    return round(placements * each + (PLANS.opening_min if opened else 0.0), 1)
