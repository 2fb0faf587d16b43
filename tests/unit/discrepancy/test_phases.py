"""A motion in step with the curves is none where their phases may be alike by chance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_effects import RAMPS, TRUE, fitter_of, measured

from skinlab.discrepancy.campaign_errors import Linearised
from skinlab.discrepancy.phases import IN_STEP, begun_in_step, chance_of_phases, out_of_step
from skinlab.discrepancy.settings import NAMES
from skinlab.discrepancy.unknowns import Unknowns


def moving(amplitude_um, hz, phases):
    """Return a campaign of six curves that move at one frequency, each with its phase."""
    clean = measured({}, (*RAMPS, *RAMPS))
    moved = [1e-3 * amplitude_um * np.sin(2 * np.pi * hz * c.time_s + phase)
             for c, phase in zip(clean.curves, phases, strict=True)]  # fmt: skip
    curves = (
        replace(c, deflection_mm=c.deflection_mm + w)
        for c, w in zip(clean.curves, moved, strict=True)
    )
    return replace(clean, curves=tuple(curves))


@pytest.mark.parametrize(("curves", "off"), [(2, 0.6), (3, 0.9), (6, 0.9), (9, 1.2)])
def test_chance_is_that_of_phases_that_are_drawn(curves, off):
    rng = np.random.default_rng(curves)
    sizes = rng.uniform(1.0, 8.0, curves)
    w = np.minimum(sizes, NAMES.phase_known)
    cosines = np.full(curves, np.cos(off))
    drawn = np.cos(rng.uniform(0.0, 2.0 * np.pi, (200_000, curves))) @ w
    often = float(np.mean(np.abs(drawn) >= w @ cosines))
    assert chance_of_phases(cosines, sizes) == pytest.approx(often, rel=0.15)


def test_chance_is_none_where_all_are_alike_and_all_where_none_is():
    one, large = np.ones(9), np.full(9, 20.0)
    assert chance_of_phases(one, large) < 1e-9
    assert chance_of_phases(-one, large) == 1.0  # its sign is that of the motion
    assert chance_of_phases(np.zeros(3), np.zeros(3)) == 1.0
    assert 0.0 < chance_of_phases(np.array([1.0, 0.3, -0.2]), np.array([9.0, 0.0, 1.0])) <= 1.0
    one_curve = chance_of_phases(np.cos([0.05]), large[:1])
    assert one_curve == pytest.approx(0.05 * 2.0 / np.pi, rel=0.2)


@pytest.mark.parametrize(
    ("hz", "phases", "said"),
    [
        (0.3, np.zeros(6), ""),
        (0.3, np.linspace(-1.6, 1.6, 6), "may be breathing"),
        (1.2, np.linspace(-1.6, 1.6, 6), "may be a pulse"),
        (3.3, np.linspace(-1.6, 1.6, 6), ""),  # nothing that lives
    ],
)
def test_a_breath_whose_phases_are_about_alike_is_not_in_step(table, hz, phases, said):
    """Nine of 4 µm were named, 1,900 : 1: 2.5 µm at 0.30 Hz."""
    fitter = fitter_of(moving(6.0, hz, phases), table)
    look = SimpleNamespace(nodes=[], mode=fitter.errors)
    unknowns = Unknowns((IN_STEP,))
    begun = {"amplitude_um": 4.0, "frequency_hz": hz}
    axes = [axis.to_u(begun[axis.parameter.name]) for axis in unknowns.axes]
    fit = fitter.fit(unknowns, np.array([*TRUE, *axes]))
    linear = Linearised.of(fit, fitter.errors, fitter.measured)
    why = out_of_step(fit, linear, look, fitter.records)
    assert said in why
    assert bool(why) == bool(said)


@pytest.mark.parametrize("in_step", [True, False])
def test_a_motion_in_step_that_errors_took_up_is_begun_at_its_own_frequency(table, in_step):
    """A regulator that hunts at 1.2 Hz was a pulse, and nothing was missing."""
    phases = np.zeros(6) if in_step else np.linspace(-3.0, 2.0, 6)
    fitter = fitter_of(moving(8.0, 1.21, phases), table)
    base = fitter.fit(Unknowns(()), TRUE)
    errors = fitter.errors
    node = SimpleNamespace(
        sizes_um={"pulse": 6.0},
        values={"pulse_hz": 1.23},
        covariance=replace(errors, shapes_mm=np.ones((errors.count, 1)), sizes=None),
        combination=SimpleNamespace(columns={"pulse": slice(0, 1)}),
    )
    look = SimpleNamespace(nodes=[node], mode=errors)
    linear = Linearised.of(base, errors, fitter.measured)
    found = list(begun_in_step(base, linear, look, fitter.records))
    assert len(found) == in_step
    for one in found:
        assert one["frequency_hz"] == pytest.approx(1.21, abs=0.011)
        assert one["amplitude_um"] == pytest.approx(8.0, abs=1.0)
