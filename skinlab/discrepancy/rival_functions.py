"""Names against smooth unknown functions: the last trial that a name has to stand."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from skinlab.discrepancy.candidates import LOG10, Candidate, are_several
from skinlab.discrepancy.discipline import Trial
from skinlab.discrepancy.families import (
    Promise,
    ask_family,
    at_its_scale,
    fit_family,
    functions,
    is_of_the_solid,
    seen_in,
    shapes_of,
)
from skinlab.discrepancy.fit import Fit, Limit
from skinlab.discrepancy.odds import odds_words
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import ERRORS, NAMES, SEARCH
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.learned import LearnedEffect, Seen

Array = NDArray[np.float64]


class RivalFunctions:
    """The smooth functions that an explanation is tried against, of one campaign.

    Of the families that cost no finite elements, linearised about the explanation and about the
    model as it is; their odds are alike, and beside the explanation those of two effects. One that
    promises so much is fitted: shares that relax are not linear where they are large, and may
    promise 10¹⁸ times what they keep.
    """

    def __init__(self, search: Search, base: Candidate) -> None:
        """Keep the search, and the model as it is."""
        self._search, self._base = search, base
        self._seen = seen_in(search.fitter.records, base.fit)
        # By name what one has come to in place of an explanation: for the next one that is tried.
        self._in_place: dict[str, float | None] = {}

    def against(self, best: Candidate) -> Trial:
        """Return whether none is likelier in an explanation's place, or needed beside it.

        One that an effect of it is a form of has to be 20 times likelier: where the data allow the
        form, that is given. Needed is one with which all is 20 times likelier. What changes the
        curves by less than matters in practice is not: a path that is known to a tenth of a
        millibar leaves as much.
        """
        several = are_several(best, self._base.effects)
        their, them = ("their", "them") if several else ("its", "it")
        look = _Look(self._search, self._base, best, self._seen)
        forms = {get_effect(name).form_of for name in best.effects}
        likelier = np.array([NAMES.tie if one.family in forms else 0.0 for one in look.families])
        for i in self._to_fit(look, best, likelier):
            one = look.families[i]
            if one.name not in self._in_place:
                self._in_place[one.name] = self._fitted(one, self._base.fit, best.fit)
            came_to = self._in_place[one.name]
            if came_to is not None and (gain := came_to - look.against[0]) >= likelier[i]:
                return _failed(one, f"in {their} place is", gain)
        for i in np.argsort(-look.leads[:, 1]):
            if look.leads[i, 1] < NAMES.tie or look.change_um(i) < NAMES.practical_um:
                continue
            one = look.families[i]
            came_to = self._fitted(one, best.fit, best.fit)
            if came_to is not None and (gain := came_to - look.against[1]) >= NAMES.tie:
                return _failed(one, f"beside {them} makes the curves", gain)
        return Trial(
            "families",
            True,
            f"no smooth unknown function takes {their} place, or is needed beside {them}",
        )

    def _to_fit(self, look: _Look, best: Candidate, likelier: Array) -> NDArray[np.intp]:
        """Return which families are fitted in an explanation's place, the likeliest first."""
        leads = look.leads[:, 0] - likelier
        order = np.argsort(-leads)
        wanted = leads >= 0.0
        wanted |= np.array([one.name in self._in_place for one in look.families], dtype=bool)
        if len(best.effects) > len(self._base.effects) + 1:
            # A pair follows much that it is not, and the model as it is has gone far for it: a
            # function whose fit begins there may keep many times what it promises.
            first = order[: SEARCH.families]
            wanted[first] |= look.promises[first, 0] > 0.0
        return np.asarray(order[wanted[order]])

    def _fitted(self, one: LearnedEffect, beside: Fit, best: Fit) -> float | None:
        """Return log10 evidence, over the model as it is, of a family fitted beside a fit.

        That of the model as it is, or of the explanation. A function that comes not near the
        explanation's cost is no rival: its fit ends early. None of one that breaks down.
        """
        return ask_family(one, partial(self._fitted_log10, one, beside, best))

    def _fitted_log10(self, one: LearnedEffect, beside: Fit, best: Fit) -> float:
        search = self._search
        promise = Promise.of(search, beside, one, self._seen)
        assert promise is not None
        limit = Limit.at(best.cost + SEARCH.far)
        found = fit_family(search, beside, promise, self._seen, limit)
        if found is None:
            return -np.inf
        plain = float(search.errors.log_evidences([search.linear(self._base.fit)])[0])
        return (at_its_scale(search, found, one, self._seen)[1] - plain) / LOG10


class _Look:
    """What families promise, linearised about the model as it is and about an explanation.

    `promises` (families, 2) are log10 evidences over the model as it is, in place of the
    explanation and beside it; `against` (2) is what they have to come to, to be as likely as it.
    """

    def __init__(self, search: Search, base: Candidate, best: Candidate, seen: Seen) -> None:
        self._errors, fits = search.errors, (base.fit, best.fit)
        offered = [one for one in functions() if one.name not in best.effects]
        self._ones = [search.linear(fit) for fit in fits]
        self.families: list[LearnedEffect] = []
        for one in offered:
            if ask_family(one, partial(is_of_the_solid, search, base.fit, one, seen)) is not False:
                continue
            each = [ask_family(one, partial(shapes_of, search, fit, one, seen)) for fit in fits]
            if all(shapes is not None for shapes in each):
                self.families.append(one)
                for linear, shapes in zip(self._ones[:2], each, strict=True):
                    assert shapes is not None
                    more, m = linear.beside(shapes), shapes.shape[1]
                    self._ones += [more.scaled(scale, m) for scale in SEARCH.scales]
        evidences = self._errors.log_evidences(self._ones, ERRORS.rough_nodes)
        _, name, *each_scale = (evidences - evidences[0]).tolist()
        n = len(SEARCH.scales)
        self._by_scale = np.reshape(each_scale, (len(self.families), len(fits), n))
        self.promises = (logsumexp(self._by_scale, axis=2) - np.log(n)) / LOG10
        alone = -float(np.log10(max(len(offered), 2)))
        beside = alone + float(np.log10(SEARCH.pairs_odds))  # two things, as two effects are
        ahead = name / LOG10 + search.log10_odds(best.fit)
        self.against = np.array([ahead - alone, name / LOG10 - beside])
        self.leads = self.promises - self.against

    def change_um(self, i: int) -> float:
        """Return by how much the curves change (root mean square) with a family beside it.

        Weighed by the errors, as gaps are: what a placement may have done as well is no difference.
        """
        n = len(SEARCH.scales)
        likeliest = int(np.argmax(self._by_scale[i, 1]))
        errors, one = self._errors.looks[-1].mode, self._ones[1]
        before, after = (
            each.explained_mm(errors) for each in (one, self._ones[2 + (2 * i + 1) * n + likeliest])
        )
        z = errors.whiten(after - before)
        return errors.noise_um * float(np.sqrt(np.mean(z**2)))


def _failed(one: LearnedEffect, what: str, log10_ahead: float) -> Trial:
    kind = one.family.replace("_", " ")
    how = f"{odds_words(log10_ahead)} likelier"
    return Trial("families", False, f"a smooth unknown function ({kind}) {what} {how}")
