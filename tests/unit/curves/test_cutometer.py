"""The Cutometer's numbers on curves whose numbers are known in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.curves.campaign import read_campaign
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.cutometer import CHANGE_WITH_BORDER, FORMULAS, find_pulses, step_numbers
from skinlab.curves.program import parse_program
from skinlab.errors import InputError

REST, ON, OFF = 0.5, 2.0, 1.5  # s
RISE = 0.02  # of the pressure, s
ELASTIC, CREEP, TAU, BACK = 0.4, 0.2, 0.6, 0.35  # mm, mm, s, mm
SETUP = Setup(6.0, 1.0)


def pressure(t, pulses=1, top=300.0):
    p = np.zeros_like(t)
    for k in range(pulses):
        begin = REST + k * (ON + OFF)
        p += np.interp(t, [begin, begin + RISE, begin + ON, begin + ON + RISE], [0, top, top, 0])
    return p


def on_law(s):
    """Deflection s seconds into the suction: an elastic jump with the pressure, and creep."""
    return ELASTIC * np.minimum(s / RISE, 1.0) + CREEP * (1.0 - np.exp(-s / TAU))


def off_law(s):
    """Deflection s seconds after its end: a jump back by BACK, and the rest dies away."""
    peak = on_law(ON)
    return peak - BACK * np.minimum(s / RISE, 1.0) - (peak - BACK) * 0.5 * (1 - np.exp(-s / TAU))


def deflection(t, pulses=1, tiring=0.03):
    """Each further pulse is higher by `tiring`."""
    w = np.zeros_like(t)
    for k in range(pulses):
        s = t - (REST + k * (ON + OFF))
        w = np.where((s > 0) & (s <= ON), on_law(s) + k * tiring, w)
        w = np.where(s > ON, off_law(s - ON) + k * tiring, w)
    return w


def step(rate_hz=1000.0, pulses=1, setup=SETUP, noise_mm=0.0, seed=0, zero_mm=0.0, until=None):
    n = round((REST + pulses * (ON + OFF)) * rate_hz)
    t = np.arange(n + 1) / rate_hz
    if until is not None:
        t = t[t <= until]
    noise = noise_mm * np.random.default_rng(seed).normal(size=t.size)
    return Curve("step", setup, t, pressure(t, pulses), deflection(t, pulses) + noise + zero_mm)


LATE = 0.02 * RISE  # the pressure passes 2 % of its step this long after it leaves zero


def values(result):
    return {name: number.value for name, number in result.numbers.items()}


class TestClosedForm:
    def test_one_pulse(self):
        result = step_numbers(step())
        found = values(result)
        w_start, w_stop = 0.0, on_law(ON)  # the last samples before the pressure moves
        w_back, w_end = off_law(LATE + 0.1), off_law(OFF)
        expected = {
            "Ue": on_law(LATE + 0.1) - w_start,
            "Uv": w_stop - on_law(LATE + 0.1),
            "Uf": w_stop - w_start,
            "Ur": w_stop - w_back,
            "Ua": w_stop - w_end,
            "R0": w_stop - w_start,
            "R1": w_end - w_start,
            "R2": (w_stop - w_end) / (w_stop - w_start),
            "R5": (w_stop - w_back) / (on_law(LATE + 0.1) - w_start),
            "R6": (w_stop - on_law(LATE + 0.1)) / (on_law(LATE + 0.1) - w_start),
            "R7": (w_stop - w_back) / (w_stop - w_start),
            "R8": w_stop - w_end,
        }
        for name, value in expected.items():
            assert found[name] == pytest.approx(value, abs=2e-4), name
        assert found["R3"] is found["R4"] is found["R9"] is None
        assert result.flags == ()

    def test_they_belong_together(self):
        r = values(step_numbers(step(pulses=3)))
        assert r["Ue"] + r["Uv"] == pytest.approx(r["Uf"])
        assert r["R0"] == r["Uf"]
        assert r["R8"] == r["Ua"]
        assert r["R1"] == pytest.approx(r["Uf"] - r["Ua"])
        assert r["R2"] == pytest.approx(r["Ua"] / r["Uf"])
        assert r["R5"] == pytest.approx(r["Ur"] / r["Ue"])
        assert r["R6"] == pytest.approx(r["Uv"] / r["Ue"])
        assert r["R7"] == pytest.approx(r["Ur"] / r["Uf"])
        assert r["R9"] == pytest.approx(r["R3"] - r["R0"])

    def test_several_pulses_tire(self):
        result = step_numbers(step(pulses=5))
        found = values(result)
        assert len(result.pulses) == 5
        assert found["R9"] == pytest.approx(4 * 0.03, abs=1e-6)
        assert found["R3"] == pytest.approx(found["R0"] + 0.12, abs=1e-6)
        # The last off-time ends with the record, the first with the next suction.
        assert found["R4"] == pytest.approx(found["R1"] + 0.12, abs=2e-3)

    def test_a_perfectly_elastic_skin(self):
        t = np.arange(0.0, 4.0, 0.002)
        p = pressure(t)
        r = values(step_numbers(Curve("c", SETUP, t, p, 1e-3 * p)))
        for name in ("R2", "R5", "R7"):
            assert r[name] == pytest.approx(1.0, abs=1e-9)
        for name in ("Uv", "R1", "R6"):
            assert r[name] == pytest.approx(0.0, abs=1e-9)

    def test_where_the_channels_zero_lies_changes_nothing(self):
        for name, value in values(step_numbers(step(zero_mm=0.123))).items():
            expected = values(step_numbers(step()))[name]
            assert value == (None if expected is None else pytest.approx(expected))

    @pytest.mark.parametrize("rate_hz", [20.0, 50.0, 100.0, 1000.0])
    def test_the_rate_matters_little(self, rate_hz):
        coarse, fine = values(step_numbers(step(rate_hz))), values(step_numbers(step()))
        for name in ("Uf", "Ua", "R2", "Ue"):
            assert coarse[name] == pytest.approx(fine[name], rel=0.1)

    def test_every_number_says_its_formula(self):
        result = step_numbers(step())
        assert list(result.numbers) == list(FORMULAS)
        assert result.numbers["Ue"].formula == "w(start + 0.1 s) - w(before start)"
        assert result.numbers["R6"].formula == "Uv / Ue"
        assert {n.unit for n in result.numbers.values()} == {"mm", "1"}


class TestBend:
    def bent(self, at, rate_hz=200.0, noise_mm=0.0):
        """Straight up to 0.4 mm, then slow creep; the pressure is at its step before that."""
        t = np.arange(0.0, 4.0, 1 / rate_hz)
        s = t - REST
        up = np.where(s < at, 0.4 * np.clip(s / at, 0.0, 1.0), 0.4 + 0.05 * (s - at))
        noise = noise_mm * np.random.default_rng(1).normal(size=t.size)
        w = np.where(s <= ON, up, 0.1) + noise
        return Curve("c", SETUP, t, pressure(t), w)

    @pytest.mark.parametrize("at", [0.11, 0.15, 0.19])
    @pytest.mark.parametrize("noise_mm", [0.0, 2e-3])
    def test_is_found_where_it_is(self, at, noise_mm):
        result = step_numbers(self.bent(at, noise_mm=noise_mm))
        assert result.bend_s == pytest.approx(at, abs=0.011)
        assert result.at_bend["Ue"].value == pytest.approx(0.4, abs=0.02)
        assert f"w(start + {result.bend_s:.3g} s)" in result.at_bend["Ue"].formula
        # At 0.1 s the skin is still on its way: the rule counts elastic deflection as viscous.
        assert result.numbers["Ue"].value == pytest.approx(0.4 * 0.1 / at, abs=0.02)

    def test_only_what_changes_with_it_is_told_twice(self):
        assert set(step_numbers(self.bent(0.15)).at_bend) == set(CHANGE_WITH_BORDER)

    def test_too_few_samples_give_none_with_a_reason(self):
        result = step_numbers(step(rate_hz=10.0))
        assert result.bend_s is None
        assert "needs 20 samples a second" in result.bend_reason
        assert result.at_bend == {}
        assert "coarse_sampling" in result.flags

    def test_a_curve_that_only_gets_steeper_has_none(self):
        t = np.arange(0.0, 4.0, 0.005)
        w = np.where(t <= REST + ON, 0.1 * np.clip(t - REST, 0.0, None) ** 2, 0.0)
        result = step_numbers(Curve("c", SETUP, t, pressure(t), w))
        assert result.bend_s is None
        assert "does not bend" in result.bend_reason


class TestNoise:
    def test_is_estimated_from_the_curve(self):
        found = [step_numbers(step(100.0, noise_mm=3e-3, seed=k)).noise_mm for k in range(20)]
        assert np.mean(found) == pytest.approx(3e-3, rel=0.1)

    def test_the_standard_deviations_are_those_of_repeats(self):
        results = [step_numbers(step(100.0, noise_mm=3e-3, seed=k)) for k in range(120)]
        for name in ("Ue", "Uf", "Ua", "R2", "R5", "R7"):
            scatter = np.std([r.numbers[name].value for r in results], ddof=1)
            stated = np.mean([r.numbers[name].sd for r in results])
            assert scatter == pytest.approx(stated, rel=0.3), name  # 120: known to 6 %

    def test_a_noisy_pressure_changes_little(self):
        curve = step(100.0)
        noisy = curve.pressure_mbar + np.random.default_rng(2).normal(0.0, 1.0, len(curve))
        found = values(step_numbers(replace(curve, pressure_mbar=noisy)))
        assert found["Uf"] == pytest.approx(values(step_numbers(curve))["Uf"], rel=0.02)


class TestPulses:
    def test_times_are_those_of_the_pressure(self):
        first, second = find_pulses(step(pulses=2))
        assert first.start_s == pytest.approx(REST + LATE, abs=1e-6)
        assert first.stop_s == pytest.approx(REST + ON + LATE, abs=1e-6)
        assert second.start_s == pytest.approx(REST + ON + OFF + LATE, abs=1e-6)
        assert first.end_s == second.before_start_s == pytest.approx(REST + ON + OFF)
        assert (first.before_start_s, first.before_stop_s) == pytest.approx((REST, REST + ON))
        assert first.rise_s == pytest.approx(0.96 * RISE)
        assert first.fall_s == pytest.approx(0.96 * RISE)
        assert first.pressure_mbar == 300.0

    def test_a_record_that_ends_under_suction_has_no_recovery(self):
        result = step_numbers(step(until=REST + 1.5))
        assert result.pulses[0].fall_s is None
        assert result.numbers["Uf"].value > 0
        for name in ("Ur", "Ua", "R1", "R2", "R5", "R7", "R8"):
            assert result.numbers[name].value is None
            assert "ends before the suction does" in result.numbers[name].reason

    def test_a_slow_pump_is_flagged(self):
        t = np.arange(0.0, 4.0, 0.01)
        p = np.interp(t, [REST, REST + 0.3, REST + ON, REST + ON + 0.05], [0, 300, 300, 0])
        result = step_numbers(Curve("c", SETUP, t, p, 1e-3 * p))
        assert "slow_rise" in result.flags

    @pytest.mark.parametrize(
        ("times", "levels", "says"),
        [
            ([0.5, 5.5, 10.5], [0, 100, 0], "rises over .* s; expected a step"),
            ([0.5, 0.52, 2.5, 4.5], [0, 100, 100, 0], "falls over 1.9 s; expected a step"),
            ([0.5, 2.5, 2.52, 4.0], [0, 100, 0, 0], "rises over .* s; expected"),
            ([0, 0.5, 10], [0, 0, 0], "stays below 0 mbar"),
            ([0, 1, 1.02, 3], [100, 100, 0, 0], "first sample is under 100 mbar already"),
            ([0.5, 0.52, 0.6, 0.62, 3], [0, 100, 100, 0, 0], "expected at least 5 and 0.2 s"),
            ([0.5, 0.52, 2, 2.02, 4, 4.02], [0, 100, 100, 70, 70, 0], "held to 10%"),
            ([0.5, 0.52, 2, 2.02, 4], [0, 100, 100, 30, 30], "does not return to rest"),
            (
                [0.5, 0.52, 2, 2.02, 4, 4.02, 6, 6.02],
                [0, 100, 100, 30, 30, 100, 100, 0],
                "falls over",
            ),
        ],
    )
    def test_what_is_no_step_is_refused(self, times, levels, says):
        t = np.arange(0.0, times[-1] + 1.0, 0.01)
        curve = Curve("c", SETUP, t, np.interp(t, times, levels), 0.01 * t)
        with pytest.raises(InputError, match=says):
            step_numbers(curve)

    @pytest.mark.parametrize(
        ("program", "says"),
        [
            ("mode1:300,2,1.5,3", "3 loadings, the pressure channel 1 pulses"),
            ("mode1:450,2,1.5", "goes to 450 mbar, the pressure channel to 300 mbar"),
        ],
    )
    def test_a_program_that_disagrees_is_refused(self, program, says):
        with pytest.raises(InputError, match=says):
            step_numbers(step(setup=replace(SETUP, program=parse_program(program))))

    def test_a_program_that_agrees_is_fine(self):
        setup = replace(SETUP, program=parse_program("mode1:300,2,1.5,2"))
        assert len(step_numbers(step(pulses=2, setup=setup)).pulses) == 2

    @pytest.mark.parametrize("seed", range(30))
    def test_rubbish_is_refused_or_numbered_but_never_fails_otherwise(self, seed):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(5, 60))
        t = np.cumsum(rng.uniform(0.001, 0.3, n))
        p = rng.choice([0.0, 100.0, -1.0, 50.0], n) + rng.normal(0, rng.choice([0, 1]), n)
        w = rng.choice([0.0, 1.0]) * rng.normal(size=n)
        try:
            result = step_numbers(Curve("rubbish", SETUP, t, p, w))
        except InputError:
            return
        assert all((n.value is None) != (n.reason is None) for n in result.numbers.values())


class TestCommand:
    def write(self, path, curve):
        with path.open("w", encoding="utf-8") as file:
            write_curve(file, curve)
        return path

    def call(self, capsys, *arguments):
        status = run(["cutometer", *map(str, arguments)])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    def test_a_csv_needs_no_geometry(self, capsys, tmp_path):
        path = self.write(tmp_path / "step.csv", step(100.0))
        status, out, err = self.call(capsys, path)
        assert (status, err) == (0, "")
        assert "R2" in out
        assert "Ua / Uf" in out
        status, out, _ = self.call(capsys, path, "--json")
        (entry,) = json.loads(out)["curves"]
        page = (Path(__file__).parents[3] / "docs/cutometer.md").read_text(encoding="utf-8")
        named = {*entry, *entry["pulses"][0], *entry["inflection"]} - {"error"}
        assert not [key for key in named if f"`{key}`" not in page]
        assert entry["aperture_mm"] is None
        assert entry["numbers"]["R9"] == {
            "value": None,
            "sd": None,
            "unit": "mm",
            "formula": "R3 - R0 = w(before stop, last pulse) - w(before stop)",
            "reason": "needs several pulses; this curve has one",
        }

    def test_the_good_ones_are_done_first(self, capsys, tmp_path):
        good = self.write(tmp_path / "good.csv", step(100.0, pulses=2))
        t = np.arange(0.0, 5.0, 0.05)
        ramp = self.write(tmp_path / "ramp.csv", Curve("r", SETUP, t, 20 * t, 0.1 * t))
        status, out, err = self.call(capsys, ramp, good, tmp_path / "no.csv", "--json")
        assert status == 3
        document = json.loads(out)
        assert document["schema"] == "skinlab.cutometer/1"
        assert [e["error"] is None for e in document["curves"]] == [False, True, False]
        assert "expected a step" in err
        assert "no.csv: no such file" in err

    def test_campaigns_say_their_geometry(self, capsys, tmp_path):
        self.write(tmp_path / "a.csv", step(100.0))
        (tmp_path / "campaign.toml").write_text(
            '[campaign]\nnoise_um = 5.0\n[[curve]]\nfile = "a.csv"\naperture_mm = 2.0\n'
            'thickness_mm = 1.2\nprogram = "mode1:300,2,1.5"\n'
        )
        assert len(read_campaign(tmp_path / "campaign.toml").curves) == 1
        status, out, _ = self.call(capsys, tmp_path / "campaign.toml", "--json")
        assert status == 0
        (entry,) = json.loads(out)["curves"]
        assert (entry["aperture_mm"], entry["thickness_mm"]) == (2.0, 1.2)
        assert entry["noise_um"] == 5.0

    def test_a_program_can_be_stated(self, capsys, tmp_path):
        path = self.write(tmp_path / "step.csv", step(100.0))
        assert self.call(capsys, path, "--program", "mode1:300,2,1.5")[0] == 0
        status, _, err = self.call(capsys, path, "--program", "mode1:300,2,1.5,5")
        assert status == 3
        assert "5 loadings" in err

    @pytest.mark.parametrize(
        ("arguments", "status"),
        [([], 2), (["x.csv", "--program", "lunch"], 3), (["x.csv", "--aperture-mm", "5"], 3)],
    )
    def test_bad_input(self, capsys, arguments, status):
        got, out, _ = self.call(capsys, *arguments)
        assert got == status
        assert out == ""
