"""Fits of explanations side by side: what explains the curves ends the others early."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from skinlab.discrepancy.candidates import Candidate
from skinlab.discrepancy.fit import NO_LIMIT, Fit, Fitter, Limit
from skinlab.discrepancy.screen import Signature
from skinlab.discrepancy.search_workers import (
    fit_one,
    held_off_the_wall,
    signature_by,
    signature_of,
)
from skinlab.discrepancy.settings import SEARCH
from skinlab.inference.covariance import Covariance
from skinlab.workers import Pool


@dataclass(frozen=True, eq=False)
class Race:
    """All fits are against the same base, and become candidates by what `judged` says of them."""

    pool: Pool
    base: Candidate
    judged: Callable[[Fit], Candidate]

    def screen(
        self, fit: Fit, names: Sequence[str], errors: Covariance | None = None
    ) -> tuple[dict[str, Signature], dict[str, str]]:
        """Return the effects' signatures, by these errors if given, and why others have none."""
        each = (
            self.pool.map(signature_of, [(fit, name) for name in names])
            if errors is None
            else self.pool.map(signature_by, [(fit, name, errors) for name in names])
        )
        found = list(zip(names, each, strict=True))
        return (
            {name: s for name, s in found if isinstance(s, Signature)},
            {name: why for name, why in found if isinstance(why, str)},
        )

    def fitted(
        self, function: Callable[[Fitter, Any], Fit | None], tasks: Sequence[Any]
    ) -> list[Candidate]:
        """Return what a function of `search_workers` finds for tasks; nothing where it has none."""
        return [self.judged(fit) for fit in self.pool.map(function, tasks) if fit is not None]

    def held(self, fit: Fit) -> list[Fit]:
        """Return the fit held off the end of a range that it is near, where it is near one."""
        return [f for f in self.pool.map(held_off_the_wall, [fit]) if f is not None]

    def fits(
        self, tasks: Sequence[tuple[Fit, Signature]], limit: Limit = NO_LIMIT
    ) -> list[Candidate]:
        """Return fits with one more effect each."""
        return self.fitted(fit_one, [(*task, limit) for task in tasks])

    def run(
        self, tasks: Sequence[tuple[Fit, Signature]], known: Sequence[Candidate] = ()
    ) -> list[Candidate]:
        """Return fits that end early where those before explain, and they will not.

        So do all where what is `known` explains. First come those that the table answers, then
        those with few unknowns: they take a tenth of the time of others, and may end these.
        """

        def costs(task: tuple[Fit, Signature]) -> tuple[bool, int]:
            fit, seen = task
            return fit.corrected or seen.corrected, len(fit.unknowns.axes) + len(seen.beside)

        found: list[Candidate] = []
        ranked = sorted(tasks, key=costs)
        cheap = sum(not costs(task)[0] for task in ranked)
        # What the likeliest of the costly ones explains ends the next ones early.
        starts = [*range(0, cheap, SEARCH.abreast), cheap]
        starts += range(cheap + 1, len(ranked), SEARCH.abreast)
        for begin, end in pairwise([*starts, len(ranked)]):
            found += self.fits(ranked[begin:end], self.limit([*known, *found]))
        return found

    def limit(self, known: Iterable[Candidate]) -> Limit:
        """Return the costs above which a fit is out of the race, because others explain."""
        serving = [c.fit.cost for c in known if c.adequate]
        if not serving:
            return NO_LIMIT
        gained = max(0.0, self.base.fit.cost - min(serving))
        first = min(serving) + SEARCH.far + SEARCH.far_share * gained
        return Limit(first, min(first, min(serving) + SEARCH.far_later))
