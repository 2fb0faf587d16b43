"""The evidence of an explanation whose fit ends at an end of a range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_device.skin import MESH
from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy import range_ends
from skinlab.discrepancy.fit import Fitter
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.race import Race
from skinlab.discrepancy.range_ends import along_range, at_an_end, log_integral
from skinlab.discrepancy.records import records_of
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.mechanics.effects.model import solve_skin
from skinlab.mechanics.fem.skin import Skin, SkinProblem
from skinlab.mechanics.fem.suction import Geometry
from skinlab.workers import Pool


def search_of(table, nu: float, noise_mm: float) -> Search:
    """One curve of a skin, of another mesh than the table's."""
    program = parse_program("ramp:100@20")
    t = np.linspace(0.0, 5.0, 60)
    path = PressurePath.of_program(program)
    problem = SkinProblem(Geometry(6.0, 1.0), Skin((0.03, 1.0, nu), "paper"))
    w = solve_skin(problem, path, MESH).at(t, path(t))
    w = w + np.random.default_rng(1).normal(0.0, noise_mm, len(t))
    curve = Curve("c", Setup(6.0, 1.0, program), t, 20.0 * t, w)
    records = records_of(Campaign("", 1e3 * noise_mm, 0.0, (curve,), 0.0))
    return Search(Fitter(records, errors_of(records), TableDomes(table)), noise_um=1e3 * noise_mm)


@pytest.mark.parametrize("nodes", [2, 7, 40])
def test_an_integral_of_an_exponential_is_exact_by_any_points(nodes):
    at = np.linspace(0.499, 0.0, nodes) ** 1.3
    assert log_integral(at, np.zeros(nodes)) == pytest.approx(np.log(at[0]), abs=1e-6)
    for rate in (3.0, -200.0):
        whole = abs(np.exp(rate * at[0]) - np.exp(rate * at[-1])) / abs(rate)
        assert log_integral(at, rate * at) == pytest.approx(np.log(whole), abs=1e-6)


def gained(search, fit):
    along = along_range(search.fitter, fit)
    return search._gained(fit, along)


@pytest.mark.parametrize(
    ("nu", "noise_mm", "effect"),
    [(0.495, 0.01, ""), (0.495, 0.01, "sensor_curve"), (0.3, 0.0015, "")],
    ids=["at the end", "an effect at the end", "four deviations off it"],
)
def test_it_is_what_many_more_points_say(table, monkeypatch, nu, noise_mm, effect):
    search = search_of(table, nu, noise_mm)
    fit = search.learned_base().fit
    if effect:
        unknowns = fit.unknowns.with_effect(effect)
        fit = search.fitter.fit(unknowns, unknowns.start(fit.u))
    assert at_an_end(fit) == 2
    few = gained(search, fit)
    monkeypatch.setattr(range_ends, "_FROM_THE_END", np.linspace(0.0, 1.0, 120) ** 2)
    assert few == pytest.approx(gained(search, fit), abs=0.03)
    assert abs(few) > 0.1  # and not what the Gaussian says: curves bend with ν


def test_inside_of_the_range_nothing_is_integrated(table):
    search = search_of(table, 0.3, 0.0002)
    fit = search.learned_base().fit
    assert at_an_end(fit) is None
    assert along_range(search.fitter, fit) is None


def test_where_there_is_no_model_the_integral_ends_and_keeps_what_is_about_the_fit(table):
    search = search_of(table, 0.3, 0.0015)
    fit, fitter = search.learned_base().fit, search.fitter
    whole = along_range(fitter, fit)

    class Creased(Fitter):
        def at(self, model, u):
            return super().at(model, u) if u[2] < 0.45 else None

    creased = Creased(fitter.records, fitter.errors, fitter.domes)
    found = along_range(creased, fit)
    assert found.at.max() < 0.45 < whole.at.max()
    np.testing.assert_array_equal(found.at, whole.at[whole.at < 0.45])
    assert abs(search._gained(fit, found) - search._gained(fit, whole)) < 0.1


def test_both_sides_are_integrated_or_neither(table):
    """What leads is judged as the model as it is: neither gains by what the other lacks."""
    search = search_of(table, 0.495, 0.01)
    base = search.learned_base()
    race = Race(Pool(1, search.fitter), base, lambda fit: search.candidate(fit, base))
    same = replace(base, log10_evidence=1.0)
    far = replace(base, log10_evidence=-40.0)
    near, behind = search._along_ranges(race, [same, far])
    assert near.log10_evidence == pytest.approx(1.0, abs=1e-9)
    assert behind.log10_evidence == pytest.approx(-40.0 - gained(search, base.fit), abs=1e-9)
