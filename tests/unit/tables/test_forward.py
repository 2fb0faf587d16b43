"""Curves for users: a crease at the tape's edge ends none of them."""

from pathlib import Path

import numpy as np
import pytest

from skinlab.curves.curve import Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.mechanics.fem.skin import Skin
from skinlab.tables.forward import simulate

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
SOFT = Skin((0.01, 0.1, 0.2))
REFERENCE = Path(__file__).parents[2] / "data" / "fe_reference"


@pytest.mark.parametrize("direct", [False, True])
def test_beyond_a_crease_a_blunter_edge_goes_on_as_another_program_does(direct):
    curve, warning = simulate(SOFT, SETUP, direct=direct)
    assert curve.pressure_mbar[-1] == pytest.approx(100.0)
    assert warning.startswith("crease: ")
    other = REFERENCE / "fe_X1-0.0100_X2-0.100_nu-0.2000_paper_h1.00_R3.00.csv"
    p, w = np.loadtxt(other, delimiter=",", skiprows=1).T
    good_to_mm = 1e-3 * float(warning.split("about ")[1].split()[0])
    off = np.interp(p, curve.pressure_mbar, curve.deflection_mm) - w
    assert np.abs(off).max() < good_to_mm


@pytest.mark.parametrize(("thickness_um", "x1_mpa"), [(20.0, 0.1), (10.0, 0.05), (22.0, 0.02)])
def test_a_soft_layer_that_creases_ends_no_curve(thickness_um, x1_mpa):
    layer = {"surface_layer": {"thickness_um": thickness_um, "X1_MPa": x1_mpa}}
    layered, warning = simulate(Skin((0.03, 1.0, 0.32)), SETUP, effects=layer)
    bare, nothing = simulate(Skin((0.03, 1.0, 0.32)), SETUP)
    assert nothing is None
    assert warning.startswith("crease: ")
    assert layered.pressure_mbar[-1] == pytest.approx(100.0)
    assert (np.diff(layered.deflection_mm) > 0).all()
    # So soft and thin a layer moves the dome by a few per cent at most.
    loaded = bare.pressure_mbar > 10
    ratio = layered.deflection_mm[loaded] / bare.deflection_mm[loaded]
    assert ((ratio > 0.93) & (ratio < 1.07)).all()


@pytest.mark.parametrize("direct", [False, True])
def test_more_samples_than_memory_holds_are_refused(direct):
    with pytest.raises(InputError, match=r"50000000 samples in the program's 5 s; .* 60000 a"):
        simulate(SOFT, SETUP, 1e7, direct=direct)


def test_up_to_the_crease_the_curve_is_that_of_the_mesh_of_record():
    up_to = Setup(6.0, 1.0, parse_program("ramp:20@20"))
    whole, _ = simulate(SOFT, SETUP, direct=True)
    part, warning = simulate(SOFT, up_to, direct=True)
    assert warning is None
    np.testing.assert_allclose(
        whole.deflection_mm[: len(part)], part.deflection_mm, rtol=0, atol=1e-5
    )
