from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest

from skinlab.api.identifiers import find_table
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference.problem import Problem
from skinlab.mechanics.fem.suction import Geometry, solve
from skinlab.mechanics.materials.compressibility import kappa_ratio, nu_from_ratio
from skinlab.tables.build import build, describe, rebuilt_differences
from skinlab.tables.grid_spec import GridSpec
from skinlab.tables.lagrange import TensorLagrange, matrix
from skinlab.tables.parallel_build import How
from skinlab.tables.store import read, write

GEOMETRY = Geometry(6.0, 1.0)


def test_lagrange_is_exact_for_cubics_and_of_fourth_order():
    nodes = np.array([0.0, 0.7, 1.1, 2.0, 2.6, 3.0])
    at = np.linspace(-0.2, 3.2, 41)  # a little beyond both ends too
    for power in range(4):
        np.testing.assert_allclose(matrix(nodes, at) @ nodes**power, at**power, atol=1e-12)
    errors = []
    for n in (11, 21, 41):
        nodes = np.linspace(0, 3, n)
        errors.append(np.abs(matrix(nodes, at[5:-5]) @ np.sin(nodes) - np.sin(at[5:-5])).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 3.5).all()


def test_tensor_interpolation_is_exact_for_products_of_cubics():
    axes = (np.linspace(0, 1, 5), np.linspace(1, 3, 7), np.array([0.2, 0.3, 0.35, 0.5]))
    a, b, c = np.meshgrid(*axes, indexing="ij")

    def f(x, y, z):
        return np.stack([x**3 * y**2 * z, (1 - x) * y**3 * z**3], axis=-1)

    points = np.random.default_rng(0).random((50, 3)) * [1, 2, 0.3] + [0, 1, 0.2]
    np.testing.assert_allclose(TensorLagrange(axes, f(a, b, c))(points), f(*points.T), atol=1e-12)


def test_the_shipped_grid_is_the_papers(grid):
    spec = grid.spec
    assert spec.shape == (10, 17, 8)
    ends = {name: (nodes[0], nodes[-1]) for name, nodes in spec.axis}
    assert ends == {"X1_MPa": (0.01, 0.1), "X2_MPa": (0.1, 4.9), "nu": (0.2, 0.48)}
    assert spec.pressure_mbar == tuple(2.0 * i for i in range(51))
    assert (grid.extra["newton_iterations"] > 0).all()
    assert (np.diff(grid.values, axis=-1) > 0).all()


def test_a_skin_that_creases_goes_on_and_says_so(grid, table):
    creased = np.argwhere(grid.holds_to < 90)
    assert len(creased) > 0
    axes = grid.spec.nodes
    at = np.array([[axis[k] for axis, k in zip(axes, node, strict=True)] for node in creased])
    to_the_top = grid.model(GEOMETRY, np.linspace(0, 100, 11))
    assert to_the_top.creases(at).all()
    found = to_the_top.deflection_mm(at)
    # The creased branch, beside what a blunter edge gives.
    blunt = table.model(GEOMETRY, np.linspace(0, 100, 11)).deflection_mm(at)
    np.testing.assert_allclose(found, blunt, rtol=2e-2, atol=1e-6)
    lowest = float(grid.holds_to.min())
    low = grid.model(GEOMETRY, np.linspace(0, 0.99 * lowest, 11))
    assert not low.creases(at).any()


def test_what_the_finite_elements_compute_beside_a_crease_has_an_answer(grid):
    """A corner of this skin's cell creases before 100 mbar; the skin itself does not."""
    skin = {"X1_MPa": 0.045, "X2_MPa": 0.3, "kappa_MPa": 0.045 * kappa_ratio(0.38, "paper")}
    direct = solve(GEOMETRY, skin, 100.0)
    assert not direct.stopped
    pressure = np.linspace(0, 100, 11)
    found = grid.model(GEOMETRY, pressure).deflection_mm(np.array([[0.045, 0.3, 0.38]]))[0]
    np.testing.assert_allclose(found, direct(pressure), atol=3e-3)  # cubic Lagrange


def test_random_entries_rebuild_to_the_same_numbers(grid):
    assert rebuilt_differences(grid, samples=4, seed=20261121) == []


def test_a_changed_number_is_found(grid):
    spoiled = grid.values.copy()
    spoiled += 1e-5
    assert rebuilt_differences(dataclasses.replace(grid, values=spoiled), 1, 0)


def small_spec() -> GridSpec:
    return GridSpec(
        axis=(
            ("X1_MPa", (0.03, 0.06)),
            ("X2_MPa", (0.7, 1.6)),
            ("nu", (0.28, 0.4)),
        ),
        pressure_mbar=(0.0, 5.0, 10.0, 15.0, 20.0),
    )


def test_what_was_built_is_what_is_read(tmp_path):
    calls = []
    one = build(small_spec(), How(progress=lambda *at: calls.append(at)))
    assert calls[-1] == (8, 8)
    path = tmp_path / "grid.h5"
    write(path, one)
    assert read(path).content_hash == one.content_hash


def test_that_no_interval_knows_how_far_the_grid_is_off_is_told(tmp_path, grid, table, capsys):
    """`database build` makes this one where no spec is named: 5 µm off at its soft end."""
    skin, p = {"X1_MPa": 0.0122, "X2_MPa": 1.14}, np.linspace(0.0, 100.0, 26)
    kappa = 0.0122 * float(kappa_ratio(0.205, "paper"))
    direct = solve(GEOMETRY, {**skin, "kappa_MPa": kappa}, 100.0)(p)
    off_um = [
        1e3
        * np.abs(one.model(GEOMETRY, p).deflection_mm(np.array([[0.0122, 1.14, 0.205]])) - direct)
        for one in (grid, table)
    ]
    assert off_um[0].max() > 2.0
    assert off_um[1].max() < 0.5
    path = tmp_path / "grid.h5"
    write(path, grid)
    find_table(path)
    assert "grid.h5: how far it is off between the nodes was not" in capsys.readouterr().err
    assert "is in no interval" in describe(grid)


def test_a_damaged_file_is_told(tmp_path, grid):
    path = tmp_path / "grid.h5"
    write(path, grid)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"truncated|damaged|not readable"):
        read(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="HDF5"):
        read(path)
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file["deflection_mm"][3, 3, 3, 3] += 1e-9
    with pytest.raises(InputError, match="does not agree with its hash"):
        read(path)


def test_the_misfit_equals_the_sum_over_all_points(grid):
    rng = np.random.default_rng(1)
    pressure = np.sort(rng.uniform(-1.5, 101.5, 77))
    model = grid.model(GEOMETRY, pressure)
    low, high = model.space.bounds
    candidates = low + (high - low) * rng.random((200, 3))
    measured = model.deflection_mm(candidates[:1])[0] + rng.normal(0, 0.003, 77)
    direct = ((model.deflection_mm(candidates) - measured) ** 2).sum(axis=1)
    direct = np.where(np.isfinite(direct), direct, np.inf)  # where an entry does not hold
    assert np.isfinite(direct).mean() > 0.8
    misfit = model.misfit(measured)
    np.testing.assert_allclose(misfit(candidates), direct, rtol=1e-10)
    residuals = Problem(model.space, misfit, 77).residuals(candidates[3])
    assert residuals @ residuals == pytest.approx(direct[3], rel=1e-10)


def test_a_similar_geometry_scales(grid):
    pressure = np.linspace(0, 100, 11)
    at = np.array([[0.03, 1.0, 0.32]])
    six = grid.model(GEOMETRY, pressure).deflection_mm(at)
    two = grid.model(Geometry(2.0, 1.0 / 3.0), pressure).deflection_mm(at)
    np.testing.assert_allclose(two, six / 3, rtol=1e-12, atol=1e-15)


def test_another_geometry_is_refused(grid):
    with pytest.raises(NotTrustworthyError, match="thickness/radius"):
        grid.model(Geometry(6.0, 1.1), np.linspace(0, 100, 11))


def test_both_conventions_give_the_same_curve_at_the_same_kappa(grid):
    pressure = np.linspace(0, 100, 11)
    paper = grid.model(GEOMETRY, pressure, "paper")
    consistent = grid.model(GEOMETRY, pressure, "consistent")
    nu = nu_from_ratio(kappa_ratio(0.32, "paper"), "consistent")
    np.testing.assert_allclose(
        consistent.deflection_mm(np.array([[0.033, 1.1, nu]])),
        paper.deflection_mm(np.array([[0.033, 1.1, 0.32]])),
        rtol=1e-12,
    )
    assert consistent.space.low[2] == pytest.approx(nu_from_ratio(4.0, "consistent"))


def test_readings_a_little_out_of_range_are_still_modelled(grid):
    at = np.array([-2.1, -2.0, 0.0, 100.0, 102.0, 102.1])
    assert grid.spec.covered(at).tolist() == [False, True, True, True, True, False]
