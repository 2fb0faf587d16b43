"""Closed forms, plates and membranes; and the order in which the mesh converges."""

import numpy as np
import pytest
from known_answers import (
    clamped_plate,
    compressible_tube,
    disc,
    hencky,
    mooney_membrane,
    neo_hookean,
    sphere_pressure,
    thick_shell,
    tube_pressure,
)

from skinlab.mechanics.fem.element import (
    ELEMENTS,
    QUAD8_FULL,
    QUAD9_FULL,
    QUAD9_LINEAR_DILATATION,
)
from skinlab.mechanics.materials import get_law


@pytest.mark.parametrize(
    ("sphere", "closed_form"), [(True, sphere_pressure), (False, tube_pressure)]
)
@pytest.mark.parametrize("moved", [0.05, 0.5])
def test_thick_neo_hookean_shells(sphere, closed_form, moved):
    shell = thick_shell(1.0, 2.0, QUAD9_LINEAR_DILATATION, 6, 9 if sphere else 1, sphere=sphere)
    found = shell.deflection(closed_form(1.0, 2.0, moved, 1.0), neo_hookean(1.0, 0.499999))
    assert found == pytest.approx(moved, rel=1e-4)


TUBE = {"X1_MPa": 0.5, "X2_MPa": 0.3, "kappa_MPa": 2.0}


@pytest.fixture(scope="module")
def exact():
    return compressible_tube(1.0, 2.0, 0.3, get_law("extended_neo_hookean"), TUBE)


@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
def test_displacements_converge_with_third_order_and_gradients_with_second(element, exact):
    assert exact(1.0)[0] > 1.29  # finite strain: a third wider inside
    counts = np.array([2, 4, 8, 16])
    displacement, gradient = [], []
    for n in counts:
        problem = thick_shell(1.0, 2.0, element, int(n), int(n), sphere=False)
        assembly = problem.assembly
        path = problem.path(0.3, TUBE, correction=1e-12)
        u = assembly.full(path.displacements[-1])
        # at the element's own points, but for gradients not where they are superconvergent
        corners = assembly.mesh.elements[:, :4]
        f = assembly.deformation_gradients(u)
        hoop_radius = assembly.mesh.nodes[corners, 0]
        at = np.polynomial.legendre.leggauss(element.points_1d)[0]
        left, right = hoop_radius.min(axis=1), hoop_radius.max(axis=1)
        radius = 0.5 * (left + right)[:, None] + 0.5 * (right - left)[:, None] * at
        radius = np.repeat(radius, element.points_1d, axis=1)
        weight = assembly.volumes
        u_error = (f[4] - exact(radius)[0] / radius) * radius
        displacement.append(np.sqrt((weight * u_error**2).sum()))
        gradient.append(np.sqrt((weight * (f[0] - exact(radius)[1]) ** 2).sum()))
    orders = [np.polyfit(np.log(counts), np.log(e), 1)[0] for e in (displacement, gradient)]
    assert -orders[0] > 2.8
    # the two-point rule samples the gradient where it is superconvergent
    assert -orders[1] > (2.8 if element.points_1d == 2 else 1.9)


def test_clamped_plate():
    mu, nu = 1.0, 0.3
    ratios = []
    for thickness in (0.4, 0.2, 0.1, 0.05):
        pressure = 1e-5 * thickness**3
        found = disc(1.0, thickness, QUAD8_FULL).deflection(pressure, neo_hookean(mu, nu))
        ratios.append(found / clamped_plate(1.0, thickness, pressure, mu, nu))
    off = 1 - np.array(ratios)
    assert (np.diff(off) < 0).all()
    assert off[-1] < 0.006
    # what Mindlin's plate leaves out goes like h/R or faster
    assert np.polyfit(np.log([0.4, 0.2, 0.1, 0.05]), np.log(off), 1)[0] > 1.0


def test_henckys_membrane():
    mu, nu = 1.0, 0.3
    ratios = []
    pressure_over_h = 5.6e-4
    for thickness in (0.004, 0.002, 0.001):
        pressure = pressure_over_h * thickness
        membrane = disc(1.0, thickness, QUAD8_FULL, through=1, along=60)
        found = membrane.deflection(pressure, neo_hookean(mu, nu))
        ratios.append(found / hencky(1.0, thickness, pressure, mu, nu))
    assert hencky(1.0, 1.0, 2 * mu * (1 + nu), mu, nu) == pytest.approx(0.6534, abs=5e-4)
    assert found / thickness > 30
    assert (np.diff(ratios) > 0).all()
    assert ratios[-1] == pytest.approx(1.0, abs=0.004)


@pytest.mark.long
@pytest.mark.parametrize("psi", [5.0, 20.0])
def test_pressurised_rubber_disc(psi):
    """Hughes and Carnoy's disc; as it gets thinner, Adkins and Rivlin's membrane."""
    unit = 0.00689476  # MPa
    radius = 190.5
    rubber = {"C10_MPa": 80 * unit, "C01_MPa": 20 * unit, "kappa_MPa": 1e5 * unit}
    ratios = []
    for thickness in (12.7, 12.7 / 4, 12.7 / 16):
        pressure = psi * unit * thickness / 12.7
        problem = disc(
            radius, thickness, QUAD9_LINEAR_DILATATION, "mooney_rivlin", held="pinned", through=1
        )
        membrane = mooney_membrane(radius, thickness, pressure, 80 * unit, 20 * unit)
        ratios.append(problem.deflection(pressure, rubber) / membrane)
    off = np.array(ratios) - 1
    assert membrane / radius > 0.3  # finite strain
    assert 0 < off[-1] < 0.01
    assert (off[1:] < 0.5 * off[:-1]).all()


def test_plain_elements_lock_and_the_mixed_one_does_not():
    pressure = sphere_pressure(1.0, 2.0, 0.05, 1.0)

    def error(element, nu):
        shell = thick_shell(1.0, 2.0, element, 2, 3, sphere=True)
        return abs(shell.deflection(pressure, neo_hookean(1.0, nu)) / 0.05 - 1)

    assert error(QUAD9_LINEAR_DILATATION, 0.499999) < 3e-3
    assert error(QUAD9_FULL, 0.4999) > 10 * error(QUAD9_LINEAR_DILATATION, 0.4999)
