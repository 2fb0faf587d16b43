"""The simulated skin: told the program, the time and each start."""

import subprocess
import sys

import numpy as np
import pytest

from drivers.events import KeepAlive, Load, Sample, Segment, SegmentKind
from sim_device.files import SensorSection, SkinSection
from sim_device.skin import MESH, make_skin, planned
from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry

LAW = SkinSection()
RAMP = Segment(SegmentKind.RAMP, target_mbar=60, rate_mbar_per_s=80)
HOLD = Segment(SegmentKind.HOLD, duration_s=2)
DOWN = Segment(SegmentKind.RAMP, target_mbar=0, rate_mbar_per_s=80)
LOAD = Load((RAMP, HOLD, DOWN), 20, 60, 10)
SLOW = {"viscoelasticity": {"g": 0.3, "tau_s": 1.0}}


def readings(skin, times, pressures):
    skin.start()
    return np.array(
        [skin.deflection_mm(float(t), float(p)) for t, p in zip(times, pressures, strict=True)]
    )


def test_the_plan_is_what_the_device_does(make_bench):
    bench = make_bench()
    bench.run(LOAD)
    path = planned(LOAD)
    seen = []
    for _ in range(round(path.time_s[-1] / 0.001)):
        bench.device.process(0.001)
        bench.tell(KeepAlive())
        seen.append(bench.device.pressure_mbar)
    times = 0.001 * np.arange(1, len(seen) + 1)
    np.testing.assert_allclose(path(times), seen, atol=0.26)


def test_it_is_the_forward_model_on_its_own_mesh():
    skin = make_skin(LAW, SLOW)
    skin.prepare(6.0, LOAD)
    path = planned(LOAD)
    times = np.linspace(0, path.time_s[-1], 40)
    expected = response(
        Skin((LAW.X1_MPa, LAW.X2_MPa, LAW.nu)), SLOW, Geometry(6.0, 1.0), path, times,
        discretisation=MESH,
    )  # fmt: skip
    found = readings(skin, times, path(times))
    np.testing.assert_allclose(found, expected.deflection_mm, atol=2e-5)
    again = readings(skin, times, path(times))
    np.testing.assert_array_equal(found, again)


def test_a_deviation_from_the_plan_is_answered_at_once():
    """A vent in the hold: against the same skin stepped along what really happened."""
    skin = make_skin(LAW, SLOW)
    skin.prepare(6.0, LOAD)
    real = PressurePath((0.0, 0.75, 1.75, 1.75, 1.8), (0.0, 60.0, 60.0, 30.0, 30.0))
    times = np.array([0.5, 1.0, 1.7, 1.8])
    found = readings(skin, times, real(times))
    expected = response(
        Skin((LAW.X1_MPa, LAW.X2_MPa, LAW.nu)), SLOW, Geometry(6.0, 1.0), real, times,
        discretisation=MESH,
    ).deflection_mm  # fmt: skip
    np.testing.assert_allclose(found, expected, atol=0.008)  # mm, of a change of 0.2
    assert found[-1] < found[-2] - 0.1


def test_the_first_loading_is_the_stiffest():
    skin = make_skin(LAW, {"preconditioning": {"softening": 0.2}})
    skin.prepare(6.0, LOAD)
    first, second, third = (readings(skin, [0.0, 1.0], [0.0, 60.0]) for _ in range(3))
    stiffer = make_skin(LAW, {})
    stiffer.prepare(6.0, LOAD)
    np.testing.assert_array_equal(first, readings(stiffer, [0.0, 1.0], [0.0, 60.0]))
    # a skin 0.8 times as stiff moves at 48 mbar as this one does at 60
    assert second[1] == pytest.approx(stiffer.deflection_mm(2.0, 60.0 / 0.8), rel=1e-4)
    np.testing.assert_array_equal(second, third)


def test_sensor_effects_are_in_the_readings():
    plain = make_skin(LAW, {})
    wrong = make_skin(
        LAW,
        {
            "pressure_lag": {"lag_s": 0.1},
            "deflection_gain": {"gain": 1.1},
            "deflection_offset": {"offset_um": 20.0},
            "baseline_drift": {"drift_um_per_s": 5.0},
        },
    )
    path = planned(LOAD)
    for skin in (plain, wrong):
        skin.prepare(6.0, LOAD)
    times = np.arange(0.0, 2.0, 0.05)
    found = readings(wrong, times, path(times))
    late = readings(plain, times - 0.1, path(times - 0.1))
    np.testing.assert_allclose(found, 1.1 * late + 0.02 + 0.005 * times, atol=1e-6)


def test_nothing_is_under_a_probe_without_a_program():
    assert make_skin(LAW, {}).deflection_mm(0.0, 50.0) == 0.0


def test_what_does_not_hold_refuses_the_program():
    soft = SkinSection(X1_MPa=0.002, X2_MPa=0.0, nu=0.2)
    with pytest.raises(ValueError, match=r"holds to .* mbar only, and the program goes to 60"):
        make_skin(soft, {}).prepare(6.0, LOAD)


@pytest.mark.parametrize(
    ("effects", "match"),
    [
        ({"itching": {"much": 1.0}}, r"effects\.itching is not known; expected one of: "),
        (
            {"tape_slip": {"slip": 0.1}},
            "effects.tape_slip.slip is not known; .* one of: slip_mm",
        ),
        ({"viscoelasticity": {"g": 0.1}}, "effects.viscoelasticity.tau_s is missing"),
        ({"natural_tension": {"stretch": 0.5}}, "effects.natural_tension.stretch is 0.5: expected"),
        ({"surface_layer": {"thickness_um": 200.0, "X1_MPa": 1.0}}, "inside a skin of 0.15 mm"),
    ],
)
def test_what_cannot_be_is_refused_by_name(effects, match):
    thin = SkinSection(thickness_mm=0.15)
    with pytest.raises(ValueError, match=match):
        make_skin(thin, effects)


def test_a_hold_creeps_over_the_wire(make_bench):
    """Bytes in, bytes out: the readings of a hold rise, and those of the unloading lag behind."""
    sensor = SensorSection(noise_um=0, pressure_noise_mbar=0, pressure_resolution_mbar=0)
    bench = make_bench(skin=make_skin(LAW, SLOW), sensor=sensor)
    samples = [e for e in (*bench.run(LOAD), *bench.wait(4)) if isinstance(e, Sample)]
    hold = [s.deflection_mm for s in samples if s.segment == 1 and s.device_time_s > 0.9]
    assert hold == sorted(hold)
    assert hold[-1] > 1.02 * hold[0]
    up, down = (
        {s.pressure_mbar: s.deflection_mm for s in samples if s.segment == k} for k in (0, 2)
    )
    for pressure in (20.0, 40.0):
        rising, falling = (
            np.interp(pressure, sorted(run), [run[p] for p in sorted(run)]) for run in (up, down)
        )
        assert falling > 1.02 * rising


def test_a_process_refuses_a_file_that_names_no_effect(tmp_path):
    path = tmp_path / "SKIN.toml"
    path.write_text("[effects.itching]\nmuch = 1.0\n")
    done = subprocess.run(
        [sys.executable, "-m", "sim_device", "--pty", "--skin", str(path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    assert done.stdout == ""
    assert done.stderr.startswith(f"sim_device: {path}: effects.itching is not known")
    assert done.stderr.count("\n") == 1
