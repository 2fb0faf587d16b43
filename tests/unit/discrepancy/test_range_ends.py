"""The evidence of the model as it is, where its fit ends at an end of a range."""

from __future__ import annotations

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
from skinlab.discrepancy.range_ends import at_an_end, log_integral
from skinlab.discrepancy.records import records_of
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.mechanics.effects.model import solve_skin
from skinlab.mechanics.fem.skin import Skin, SkinProblem
from skinlab.mechanics.fem.suction import Geometry


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
    for rate in (0.0, 3.0, -200.0):
        whole = abs(at[-1] - at[0]) if rate == 0.0 else None
        log = log_integral(at, rate * at)
        if whole is None:
            whole = abs(np.exp(rate * at[0]) - np.exp(rate * at[-1])) / abs(rate)
        assert log == pytest.approx(np.log(whole), abs=1e-6)


def test_it_is_what_many_more_points_say(table, monkeypatch):
    search = search_of(table, 0.495, 0.01)
    fit = search.learned_base().fit
    assert at_an_end(fit) == 2
    few = search._of_the_range(fit)
    search._held.clear()
    monkeypatch.setattr(range_ends, "_FROM_THE_END", np.linspace(0.0, 1.0, 120) ** 2)
    assert few == pytest.approx(search._of_the_range(fit), abs=0.1)
    assert abs(few) > 0.3  # and not what the Gaussian there says


def test_inside_of_the_range_nothing_is_integrated(table):
    search = search_of(table, 0.3, 0.0002)
    fit = search.learned_base().fit
    assert at_an_end(fit) is None
    assert search._of_the_range(fit) == 0.0
