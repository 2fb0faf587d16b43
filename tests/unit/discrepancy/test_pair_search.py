"""What else might be as good as a pair that leads."""

from __future__ import annotations

from types import SimpleNamespace

from skinlab.discrepancy.pair_search import PairSearch
from skinlab.discrepancy.settings import SEARCH


def candidate(*effects, adequate=True, log10_evidence=0.0):
    fit = SimpleNamespace(effects=effects, cost=100.0)
    return SimpleNamespace(
        effects=effects, fit=fit, adequate=adequate, log10_evidence=log10_evidence
    )


def test_others_are_put_in_place_of_either_half_of_a_pair_that_leads():
    """Beside a half that explains alone, by the pair's errors, and not what is known already."""
    asked = []
    gains = {"slip": 4.2, "fat": 30.0, "layer": SEARCH.seen_curved, "drift": 50.0}
    pair = candidate("creep", "opening", log10_evidence=9.0)

    def screen(fit, names, errors):
        asked.append((fit.effects, tuple(names), errors))
        return {n: SimpleNamespace(effect=n, gain=gains[n]) for n in names}, {}

    search = SimpleNamespace(
        own=(),
        library=["creep", "opening", *gains],
        look_of=lambda fit: SimpleNamespace(mode=("errors of", fit.effects)),
    )
    known = [
        pair,
        candidate("creep"),
        candidate("opening", adequate=False),
        candidate("slip"),
        candidate("creep", "drift"),
    ]
    pairs = PairSearch(search, SimpleNamespace(screen=screen))
    tried = pairs._in_place_of(pair, known)
    assert asked == [(("creep",), ("slip", "fat", "layer"), ("errors of", pair.effects))]
    assert [(fit.effects, seen.effect) for fit, seen in tried] == [
        (("creep",), "fat"),
        (("creep",), "slip"),
    ]
