"""Placements whose skin is softer or thinner, as the table has it, and what slopes make of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy import search as search_module
from skinlab.discrepancy.adequacy import Residual
from skinlab.discrepancy.fit import Fitter
from skinlab.discrepancy.misfit import errors_of, slopes_mm_per_mbar
from skinlab.discrepancy.placement_curves import (
    softer_mm,
    thickness_slopes,
    with_stiffness_of,
    with_thickness_of,
)
from skinlab.discrepancy.posterior import sample
from skinlab.discrepancy.records import records_of
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.mechanics.effects.model import Skin, felt_path
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Geometry

SKIN = Skin((0.035, 1.2, 0.32))
THICKNESS_MM = 1.1


def places(table, deviations, *, noise_um=0.0, apertures_mm=(8.0,)):
    """Return a campaign of places, each (log stiffness, log thickness) off, at these openings."""
    program = parse_program("ramp:100@20,ramp:0@20")
    t = np.arange(0.0, program.duration_s, 0.05)
    p = PressurePath.of_program(program)(t)
    rng = np.random.default_rng(5)
    curves = []
    for i, (stiffer, thicker) in enumerate(deviations):
        at = Geometry(apertures_mm[i % len(apertures_mm)], THICKNESS_MM * np.exp(thicker))
        dome = TableDomes(table)([SkinProblem(at, SKIN)], [150.0])
        w = dome(p[None] * np.exp(-stiffer))[0] + 1e-3 * noise_um * rng.normal(size=len(t))
        repeat = i // len(apertures_mm) + 1
        setup = Setup(at.aperture_mm, THICKNESS_MM, program, 1, repeat)
        curves.append(Curve(f"c{i}", setup, t, p, w))
    return Campaign("places", None, 0.0, tuple(curves))


def test_a_place_of_its_own_stiffness_lies_along_slopes_halfway(table):
    sizes = (-0.2, 0.2)
    records = records_of(places(table, [(s, 0.0) for s in sizes]))
    (plain,) = records_of(places(table, [(0.0, 0.0)]))

    def left_um(softer):
        moved = plain.curve.deflection_mm - np.array(sizes)[:, None] * softer
        measured = [r.curve.deflection_mm for r in records]
        return 1e3 * np.abs(measured - moved).max(axis=1)

    bent = left_um(plain.pressure_mbar * np.split(slopes_mm_per_mbar(records), 2))
    straight = left_um(np.split(softer_mm(records), 2))
    assert bent.min() > 4.0
    assert straight.max() < 0.15 * bent.min()


def test_a_softer_place_of_a_late_dome_is_late_as_well(table):
    """Not what p dw/dp says, of the suction of its own time: that was off by up to a fifth."""
    (plain,) = records_of(places(table, [(0.0, 0.0)]))
    t, p = plain.curve.time_s, plain.pressure_mbar
    lag_s = 0.3
    felt = np.exp(-t / lag_s) * np.concatenate(
        [[0.0], np.cumsum(np.diff(np.exp(t / lag_s)) * 0.5 * (p[1:] + p[:-1]))]
    )  # of the first order
    dome = TableDomes(table)([SkinProblem(plain.geometry, SKIN)], [150.0])

    def late(softness):
        w = dome(felt[None] * np.exp(softness))[0]
        curve = Curve("late", plain.curve.setup, t, plain.curve.pressure_mbar, w)
        return replace(plain, curve=curve)

    exact = (late(0.01).curve.deflection_mm - late(-0.01).curve.deflection_mm) / 0.02
    found = softer_mm([late(0.0)])
    naive = p * slopes_mm_per_mbar([late(0.0)])
    assert np.abs(found - exact).max() < 0.25 * np.abs(naive - exact).max()
    # A dome in time is left as it was.
    assert softer_mm([plain]) == pytest.approx(p * slopes_mm_per_mbar([plain]))


def test_a_softer_place_of_a_dome_that_sticks_is_on_its_way_as_well(table):
    """Also of a small dome under another opening, whose own noise hides that it sticks."""
    stuck = {"friction_loop": {"share": 0.11}}
    campaign = places(table, [(0.0, 0.0)] * 2, apertures_mm=(8.0, 2.0))
    rng = np.random.default_rng(2)

    def stick(plain, softness, noise_um=0.0):
        p = felt_path(stuck, plain.path)(plain.curve.time_s)
        dome = TableDomes(table)([SkinProblem(plain.geometry, SKIN)], [150.0])
        w = dome(p[None] * np.exp(softness))[0] + 1e-3 * noise_um * rng.normal(size=len(p))
        return replace(plain, curve=replace(plain.curve, deflection_mm=w))

    records = records_of(campaign)
    softer, harder = ([stick(r, s).curve.deflection_mm for r in records] for s in (0.01, -0.01))
    found = np.split(softer_mm([stick(r, 0.0, noise_um=3.0) for r in records]), 2)
    naive = np.split(slopes_mm_per_mbar([stick(r, 0.0, 3.0) for r in records]), 2)
    for record, up, down, own, slope in zip(records, softer, harder, found, naive, strict=True):
        exact = (up - down) / 0.02
        off = np.abs(record.pressure_mbar * slope - exact).max()
        assert np.abs(own - exact).max() < 0.2 * off


@pytest.mark.parametrize("scale", [pytest.param(0.05, marks=pytest.mark.long), 1.0])
def test_places_of_other_stiffness_and_thickness_are_no_missing_effect(table, scale):
    """What they do beyond slopes is taken off where it is more than two meshes differ."""
    deviations = scale * np.random.default_rng(8).normal(0.0, [0.12, 0.05], (9, 2))
    made = places(table, deviations, noise_um=2.0, apertures_mm=(8.0, 6.0, 2.0))
    records = records_of(made)
    fitter = Fitter(records, errors_of(records), TableDomes(table), finite_elements=False)
    search = Search(fitter)
    base = search.learned_base()
    assert base.left.p_value > 1e-2
    bends = [np.max(np.abs(r.bend_mm)) for r in search.fitter.records]
    assert (1e3 * max(bends) > 3.0) == (scale == 1.0)
    for one, before in zip(search.fitter.records, records, strict=True):  # the data stay
        assert np.isin(one.curve.deflection_mm, before.curve.deflection_mm).all()


@pytest.fixture(scope="module")
def nine(table):
    """Return a search that has learned the errors of nine places."""
    deviations = np.random.default_rng(8).normal(0.0, [0.06, 0.0], (9, 2))
    records = records_of(places(table, deviations, noise_um=2.0, apertures_mm=(8.0, 6.0, 2.0)))
    fitter = Fitter(records, errors_of(records), TableDomes(table), finite_elements=False)
    search = Search(fitter)
    return search, search.learned_base().fit


def test_errors_as_an_explanation_sees_them_have_the_thickness_of_its_own_skin(table, nine):
    """The model as it is may be of a skin with another slope, by a quarter."""
    search, base = nine
    records, domes = search.fitter.records, TableDomes(table)
    unknowns = base.unknowns.with_effect("deflection_offset")
    u = np.append(base.u + np.array([0.4, -1.5, 0.0]), 0.0)
    model = search.fitter.model(unknowns)
    slopes, deflections_mm = search.fitter.jacobian(model, u), tuple(model.predict(u))
    other = replace(base, unknowns=unknowns, u=u, jacobian=slopes, deflections_mm=deflections_mm)
    before, own = (thickness_slopes(records, fit, domes) for fit in (base, other))
    assert np.abs(own - before).max() > 0.1 * np.abs(before).max()
    look = search.errors_with(other).looks[-1]
    columns = look.mode.columns_mm[:, look.best.columns["placement_thickness"]].sum(axis=1)
    there = np.abs(own) > 1e-6
    share = columns[there] / own[there]
    np.testing.assert_allclose(share, share[0], rtol=1e-9)


def test_a_thicker_place_of_a_dome_that_sticks_is_on_its_way_as_well(table, nine):
    """By the suction of the time, two places of a friction were named "5 % too thick" besides."""
    _, base = nine
    plain, domes = records_of(places(table, [(0.0, 0.0)]))[0], TableDomes(table)
    skin = base.unknowns.skin(base.u)
    felt = felt_path({"friction_loop": {"share": 0.2}}, plain.path)(plain.curve.time_s)

    def stick(factor):
        at = replace(plain.geometry, thickness_mm=factor * THICKNESS_MM)
        return domes([SkinProblem(at, skin)], [150.0])(felt[None])[0]

    exact = (stick(1.01) - stick(0.99)) / np.log(1.01 / 0.99)
    record = replace(plain, curve=replace(plain.curve, deflection_mm=stick(1.0)))
    found = thickness_slopes([record], replace(base, deflections_mm=[stick(1.0)]), domes)
    assert np.abs(found - exact).max() < 0.01 * np.abs(exact).max()


def test_a_thickness_of_places_may_do_what_it_does_to_the_skin_of_an_explanation(table, nine):
    """Also of one that says that all of them are thicker."""
    search, base = nine
    records, look = search.fitter.records, search.errors.pure
    unknowns = base.unknowns.with_effect("thickness_error")
    u = np.append(base.u, unknowns.axes[0].to_u(1.2))
    fit = replace(base, unknowns=unknowns, u=u)
    own = with_thickness_of(fit, look, records, TableDomes(table))
    assert [n.log_prior for n in own.nodes] == [n.log_prior for n in look.nodes]
    columns = look.best.columns["placement_thickness"]
    before, after = (one.mode.shapes_mm[:, columns] for one in (look, own))
    assert own.mode.sizes is look.mode.sizes
    ends = np.cumsum([len(r.curve) for r in records])
    for i, record in enumerate(records):
        here = slice(ends[i] - len(record.curve), ends[i])
        at = record.geometry
        thick = [replace(at, thickness_mm=at.thickness_mm * f) for f in (1.19, 1.2, 1.21)]
        each = TableDomes(table)([SkinProblem(g, unknowns.skin(u)) for g in thick], [120.0] * 3)
        less, middle, more = each(record.pressure_mbar[None])
        slope = (more - less) / np.log(1.21 / 1.19) / middle * fit.deflections_mm[i]
        later = record.pressure_mbar > 5.0
        assert after[here, i][later] == pytest.approx(slope[later], rel=0.02)
        assert np.abs(after[here, i] - before[here, i]).max() > 1e-3
        assert not np.delete(after[here], i, axis=1).any()


@pytest.mark.parametrize(
    ("told", "own", "chi2", "found"),
    [(0.2, 0.9, 1.0, 0.2), (1e-8, 0.2, 1.0, 0.2), (1e-2, 1e-8, 1.0, 1e-2), (1e-8, 0.2, 2.0, 1e-8)],
)
def test_in_doubt_either_skin_may_say_what_a_thickness_does(
    monkeypatch, nine, told, own, chi2, found
):
    """What leaves far more than noise is not asked again."""
    search, base = nine
    fit = replace(base, chi2=chi2 * search.fitter.errors.count)

    def judge(records, settings, fit, errors):
        p = told if settings[0][0] is search.errors.pure.nodes[0].covariance else own
        return Residual(p, (), p)

    monkeypatch.setattr(search_module, "judge", judge)
    assert search.left_of(fit, search.errors.pure).p_value == found


def test_a_stiffness_is_known_no_better_than_places_let_it(nine):
    """What relaxes is moved by a stiffness in another way than p dw/dp of its curves says.

    Of n places, each off by s (log), the skin's own is known to s/√n: what the columns are off by
    would tell one from the others, to half of that.
    """
    search, fit = nine
    look = search.errors.looks[-1]
    fit = fit.with_errors(search.fitter.errors, look.mode)
    slopes = look.mode.colour(fit.jacobian)
    relaxed = np.concatenate([0.8 + 0.3 * r.curve.time_s / 10.0 for r in search.fitter.records])
    slopes[:, 0] *= relaxed
    fit = replace(fit, jacobian=look.mode.whiten(slopes))
    least = look.nodes[0].values["placement_scatter"] / 3.0
    assert fit.deviations[0] < 0.6 * least
    own = with_stiffness_of(fit, look)
    assert fit.with_errors(look.mode, own.mode).deviations[0] > 0.9 * least
    (shapes,) = {n.covariance.shapes_mm.tobytes() for n in own.nodes if n.combination is own.best}
    assert shapes == own.mode.shapes_mm.tobytes()


def test_intervals_are_over_all_that_the_errors_may_be(table):
    """Two places do not tell how far places differ: draws are from all that this may be.

    The law of total variance, in the linear picture: the mean of the variances and the variance of
    the means.
    """
    deviations = [(0.03, 0.0), (0.03, 0.0), (-0.03, 0.0), (-0.03, 0.0)]
    records = records_of(places(table, deviations, noise_um=2.0, apertures_mm=(8.0, 2.0)))
    fitter = Fitter(records, errors_of(records), TableDomes(table), finite_elements=False)
    search = Search(fitter)
    base = search.learned_base().fit
    look = search.errors.looks[-1]
    final = search.fitter.with_errors(search.fitter.records, look.mode)
    fit = final.refined(base.with_errors(search.fitter.errors, look.mode))
    slopes_mm = look.mode.colour(fit.jacobian)
    flat = fit.unknowns.information(np.zeros((0, 3)), fit.u)
    left_mm = final.measured - np.concatenate(fit.deflections_mm)
    means, variances, log_weights = [], [], []
    for node in look.nodes:
        white, left = node.covariance.whiten(slopes_mm), node.covariance.whiten(left_mm)
        information = white.T @ white + flat
        moved = np.linalg.solve(information, white.T @ left)
        means.append(moved[0])
        variances.append(np.linalg.inv(information)[0, 0])
        log_density = left @ left - moved @ white.T @ left + np.linalg.slogdet(information)[1]
        log_weights.append(node.log_prior - 0.5 * (log_density + node.covariance.log_determinant))
    weight = np.exp(np.array(log_weights) - max(log_weights))
    weight /= weight.sum()
    middle = weight @ means
    expected = np.sqrt(weight @ variances + weight @ np.square(np.array(means) - middle))
    found = sample(final, fit, look, np.random.default_rng(1)).deviations[0]
    assert found == pytest.approx(expected, rel=0.05)
    assert fit.deviations[0] < 0.93 * expected  # by the likeliest setting alone
