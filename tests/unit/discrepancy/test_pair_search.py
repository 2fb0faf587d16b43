"""What else might be as good as a pair that leads."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from skinlab.discrepancy.fit import NO_LIMIT
from skinlab.discrepancy.pair_search import PairSearch
from skinlab.discrepancy.race import Race
from skinlab.discrepancy.screen import NOT_HELD
from skinlab.discrepancy.settings import FITS, SEARCH
from skinlab.discrepancy.starts import middle_of
from skinlab.discrepancy.unknowns import Unknowns


def candidate(*effects, adequate=True, log10_evidence=0.0, p_value=0.5, cost=100.0):
    fit = SimpleNamespace(effects=effects, cost=cost)
    return SimpleNamespace(
        effects=effects,
        fit=fit,
        adequate=adequate,
        log10_evidence=log10_evidence,
        left=SimpleNamespace(p_value=p_value),
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


def test_a_rival_of_a_pair_that_leads_may_have_neither_of_its_members():
    """A layer with a slip led, and the layer explained alone; it was a tension and a preload."""
    gains = {"preload": 204.0, "layer": 191.0, "slip": 169.0, "lag": 127.0, "opening": 109.0}
    pair = candidate("layer", "slip", log10_evidence=29.0, cost=1047.0)
    tension = candidate("tension", adequate=False, log10_evidence=11.0, cost=1260.0)
    # What ended at an end of a range is asked from the middle of it as well.
    elsewhere = SimpleNamespace(effects=("tension",), cost=1300.0)

    def screen(fit, names, errors=None):
        own = {"lag": 187.0} if fit is elsewhere else gains
        return {n: SimpleNamespace(effect=n, gain=own.get(n, 0.0)) for n in names}, {}

    fitted = []
    race = SimpleNamespace(
        screen=screen,
        held=lambda fit: [elsewhere] if fit is tension.fit else [],
        fits=lambda tasks, limit: fitted.extend(tasks) or [candidate("tension", "preload")],
    )
    search = SimpleNamespace(
        own=(),
        library=["tension", *gains],
        looks=[],
        look_of=lambda fit: SimpleNamespace(mode=None),
        progress=lambda _: 0,
    )
    known = [pair, tension, candidate("tension", "opening", adequate=False)]
    found = PairSearch(search, race).rivals(known)
    assert [(fit, seen.effect) for fit, seen in fitted] == [
        (tension.fit, "preload"),
        (tension.fit, "layer"),
        (tension.fit, "slip"),
        (elsewhere, "lag"),
    ]
    assert [c.effects for c in found] == [*(c.effects for c in known), ("tension", "preload")]


def test_the_halves_of_a_pair_are_asked_alone_once_and_those_of_the_next_that_leads():
    """A stiffening was given up, since a gain explained; it led beside a preload afterwards."""
    begun = []

    def alone(name):
        return SimpleNamespace(effects=(name,), among=lambda unknowns, u: (name, u))

    def pair(*effects, log10_evidence):
        found = candidate(*effects, log10_evidence=log10_evidence)
        found.fit.unknowns, found.fit.u = None, effects
        return found

    def fitted(function, tasks):
        begun.extend((unknowns.effects[0], start[1]) for unknowns, start, _ in tasks)
        return [candidate(unknowns.effects[0], log10_evidence=1.0) for unknowns, *_ in tasks]

    search = SimpleNamespace(
        own=(), unknowns=SimpleNamespace(with_effect=alone), progress=lambda _: 0
    )
    pairs = PairSearch(search, SimpleNamespace(fitted=fitted))
    first = [pair("gain", "bend", log10_evidence=9.0)]
    assert [c.effects for c in pairs.members(first)] == [("gain",), ("bend",)]
    assert pairs.members(first) == []
    then = [*first, pair("preload", "stiffening", log10_evidence=12.0)]
    assert [c.effects for c in pairs.members(then)] == [("preload",), ("stiffening",)]
    assert begun[2:] == [(n, ("preload", "stiffening")) for n in ("preload", "stiffening")]
    assert pairs.members([candidate("preload", log10_evidence=20.0), *then]) == []


@pytest.mark.parametrize("explains", [True, False])
def test_a_pair_that_is_begun_again_ends_early_where_something_explains(explains):
    """Half of the time of a friction with a lag went to pairs that were far behind it."""
    lag = candidate("lag", adequate=False, cost=2000.0)
    behind = candidate("lag", "creep", adequate=False, cost=2100.0)  # worse than the lag alone
    leads = candidate("lag", "friction", adequate=explains, cost=1000.0)
    fitted = []
    race = SimpleNamespace(
        base=candidate(cost=5000.0),
        limit=lambda known: Race.limit(race, known),
        screen=lambda fit, names: ({n: n for n in names}, {}),
        fits=lambda tasks, limit: fitted.append((tasks, limit)) or [],
    )
    search = SimpleNamespace(own=(), progress=lambda _: 0)
    PairSearch(search, race)._nested([lag], [behind, leads])
    [(tasks, limit)] = fitted
    assert tasks == [(lag.fit, "creep")]
    assert (limit.first < lag.fit.cost) is explains


@pytest.mark.parametrize(("p_value", "further"), [(0.0015, True), (0.06, False)])
def test_pairs_are_gone_on_with_where_what_explains_is_in_doubt(p_value, further):
    """A tension and a layer left what chance does in one of 700; a layer below was not tried."""
    tension = candidate("tension", adequate=False, p_value=0.0, cost=2945.0)
    layer = candidate("layer", adequate=False, p_value=0.0, cost=4295.0)
    pair = candidate("tension", "layer", p_value=p_value, cost=2720.0)
    gains = {"layer": {"fat": 300.0}, "tension": {"lag": 35.0}}

    def screen(fit, names, errors=None):
        (own,) = fit.effects
        return {n: SimpleNamespace(effect=n, gain=gains[own].get(n, 0.0)) for n in names}, {}

    tried = []

    def run(tasks, known):
        tried.extend((*fit.effects, seen.effect) for fit, seen in tasks)
        return [pair] if not known else []

    race = SimpleNamespace(
        screen=screen,
        base=SimpleNamespace(fit=SimpleNamespace(cost=39_000.0)),
        held=lambda fit: [],
        run=run,
        fitted=lambda function, fits: tried.extend(f.effects for f in fits) or [],
    )
    search = SimpleNamespace(
        own=(), library=["tension", "layer", "fat", "lag"], looks=[], progress=lambda _: 0
    )
    pairs = PairSearch(search, race)
    known = [tension, layer, pair]
    found = [*pairs._gone_on(known), *pairs._further([tension, layer], known)]
    assert found == []
    gone_on = [("tension", "layer"), ("tension", "lag"), ("layer", "fat")]
    assert tried == (gone_on if further else [])


@pytest.mark.parametrize("doubt", [True, False])
def test_what_cannot_be_screened_beside_a_half_is_fitted_from_another_law(doubt):
    """A creep alone ended at a skin so soft that a stiffening, which was hidden, had no model."""
    creep = candidate("viscoelasticity", adequate=False, p_value=0.0, cost=3800.0)
    bent = candidate("viscoelasticity", "sensor_curve", p_value=0.0, cost=3070.0)
    unknowns = Unknowns(("viscoelasticity",))
    creep.fit.unknowns, creep.fit.u = unknowns, np.array([-4.6, 5.3, 0.42, 1.0, 1.2])
    explains = candidate("viscoelasticity", "strain_stiffening", p_value=0.3, cost=2100.0)
    lagging = candidate("viscoelasticity", "pressure_lag", p_value=0.0 if doubt else 0.3, cost=3060)
    tasks = []
    # A stiffening has no model there; an effect that somebody installed breaks down.
    why = {"strain_stiffening": NOT_HELD, "theirs": "plugin x broke down: ValueError: no"}
    gains = {"pressure_lag": 30.0, "baseline_drift": 0.0}

    def screen(fit, names, errors=None):
        seen = {n: SimpleNamespace(effect=n, gain=gains[n]) for n in names if n in gains}
        return seen, {n: why[n] for n in names if n in why}

    race = SimpleNamespace(
        screen=screen,
        base=SimpleNamespace(fit=SimpleNamespace(cost=39_000.0)),
        held=lambda fit: [],
        run=lambda asked, known: [lagging for _ in asked],
        fitted=lambda function, asked: tasks.extend(asked) or [explains for _ in asked],
    )
    library = [
        "viscoelasticity", "sensor_curve", "pressure_lag", "strain_stiffening", "baseline_drift",
        "theirs",
    ]  # fmt: skip
    search = SimpleNamespace(own=(), library=library, looks=[], progress=lambda _: 0)
    found = PairSearch(search, race)._further([creep], [creep, bent])
    assert found == ([lagging, explains] if doubt else [lagging])
    if not doubt:
        assert tasks == []
        return
    [(both, start, limit)] = tasks
    assert both.effects == ("viscoelasticity", "strain_stiffening")
    assert limit == NO_LIMIT
    assert start[:3] == pytest.approx(middle_of(unknowns))
    assert start[3:] == pytest.approx([1.0, 1.2, FITS.levels[0]])
