"""Programs steered by height, from their text to the pressure that a height needed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from sim_device.files import SkinSection
from sim_device.skin import make_skin
from skinlab.cli.main import run
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.heights import heights_of
from skinlab.curves.program import Hold, Ramp, Until, parse_program
from skinlab.errors import InputError
from skinlab.recording.session import read_session

SKIN = ["--aperture-mm", "6", "--thickness-mm", "1"]


def test_the_grammar():
    program = parse_program("until:0.4mm@20, hold:2, ramp:0@20")
    assert program.segments == (Until(0.4, 20.0), Hold(2.0), Ramp(0.0, 20.0))
    assert str(program) == "until:0.4mm@20,hold:2,ramp:0@20"
    bounded = parse_program("until:0.4 mm@20,150")
    assert bounded.segments == (Until(0.4, 20.0, 150.0),)
    assert parse_program(str(bounded)) == bounded
    assert bounded.max_pressure_mbar == 150
    assert bounded.phases == ("load",)


@pytest.mark.parametrize(
    "text",
    ["until", "UNTIL", "until:", "until:0.4@20", "until:0.4mm",
     "until:mm@20", "until:0mm@20", "until:9mm@20", "until:-1mm@20",
     "until:0.4mm@0", "until:0.4mm@20,501", "until:0.4mm@20,150,2", "until:0.4um@20",
     "until:0.4mm@5", "until:nanmm@20"],
)  # fmt: skip
def test_what_is_refused(text):
    with pytest.raises(InputError):
        parse_program(text)


def curve(program, end_mbar, *, sd_mm=0.0, gain=0.01):
    """A rise at 20 mbar/s that stops at a pressure, and a hold."""
    rng = np.random.default_rng(1)
    time_s = np.arange(0, end_mbar / 20 + 2, 0.05)
    pressure = np.minimum(20 * time_s, end_mbar)
    segment = (20 * time_s > end_mbar).astype(int)
    deflection = gain * pressure + sd_mm * rng.standard_normal(len(time_s))
    return Curve(
        "c", Setup(6.0, 1.0, parse_program(program)), time_s, pressure, deflection, segment
    )


def test_what_was_reached_takes_the_place_of_the_height():
    one = curve("until:0.4mm@20,hold:2", 40.0)
    assert one.program_as_run.segments == (Ramp(pytest.approx(40.0), 20.0), Hold(2.0))
    assert set(one.phase[one.segment == 0]) == {"load"}
    assert set(one.phase[one.segment == 1]) == {"hold"}


@pytest.mark.parametrize("seed_sd", [0.0, 0.003])
def test_the_pressure_that_a_height_needed(seed_sd):
    (found,) = heights_of(curve("until:0.4mm@20,hold:2", 40.5, sd_mm=seed_sd))
    assert found.reached
    assert found.pressure_mbar == pytest.approx(40.0, abs=max(0.01, 4 * found.pressure_sd_mbar))
    assert found.pressure_sd_mbar < 0.5


def test_a_height_with_which_the_program_ends():
    """The vent behind it is no part of the curve."""
    with_hold = curve("until:0.4mm@20,hold:2", 40.5)
    rise = with_hold.segment == 0
    columns = (with_hold.time_s, with_hold.pressure_mbar, with_hold.deflection_mm)
    setup = Setup(6.0, 1.0, parse_program("until:0.4mm@20"))
    alone = Curve("c", setup, *(c[rise] for c in columns), with_hold.segment[rise])
    (found,) = heights_of(alone)
    assert found.reached
    assert found.pressure_mbar == pytest.approx(40.0, abs=0.01)
    assert alone.program_as_run.segments == (Ramp(pytest.approx(40.0, abs=1.0), 20.0),)
    cut = replace(alone, partial=True)
    assert heights_of(cut) == ()
    assert cut.program_as_run.segments == setup.program.segments


def test_a_height_that_was_not_reached():
    (found,) = heights_of(curve("until:3mm@20,60,hold:2", 60.0))
    assert not found.reached
    assert found.pressure_mbar is None


def test_measured_recorded_and_replayed(tmp_path, capsys):
    """The pressure is that of the skin's own finite elements."""
    out = str(tmp_path / "s.h5")
    port = "sim://?seed=4&speed=10"
    program = "until:0.4mm@20,150,hold:1,ramp:0@20"
    assert (
        run(["measure", "--port", port, *SKIN, "--program", program, "--out", out, "--json"]) == 0
    )
    document = json.loads(capsys.readouterr().out)
    (one,) = document["curves"]
    assert one["heights"][0]["reached"] is True
    assert "ramp_not_as_asked" not in one["flags"]
    skin = make_skin(SkinSection(), {})
    from sim_device.skin import load_of

    skin.prepare(6.0, load_of("ramp:100@20", 20.0))
    skin.start()
    needed = one["heights"][0]
    truth = next(p for p in np.arange(0, 100, 0.05) if skin.deflection_mm(0.0, p) >= 0.4)
    assert abs(needed["pressure_mbar"] - truth) < 4 * needed["pressure_sd_mbar"] + 0.1
    # The hold keeps the pressure at which it stopped
    measured = read_session(tmp_path / "s.h5").curves[0]
    held = measured.pressure_mbar[measured.segment == 1]
    assert np.ptp(held) < 2.0
    assert abs(held.mean() - truth) < 2.0
    assert run(["replay", out, "--speed", "max", "--verify"]) == 0


def test_a_height_out_of_reach_is_flagged(tmp_path, capsys):
    out = str(tmp_path / "s.h5")
    port = "sim://?seed=4&speed=20"
    program = ["--program", "until:3mm@40,80,hold:1"]
    assert run(["measure", "--port", port, *SKIN, *program, "--out", out, "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)["curves"]
    assert "height_not_reached" in one["flags"]
    assert one["heights"] == [
        {"height_mm": 3.0, "reached": False, "pressure_mbar": None, "pressure_sd_mbar": None}
    ]


@pytest.mark.long
def test_memory_is_counted_with(tmp_path, capsys, coarse_skin):
    """A skin that creeps needs less pressure when it is pulled slowly."""
    (tmp_path / "skin.toml").write_text("[effects.viscoelasticity]\ng = 0.5\ntau_s = 0.5\n")
    port = f"sim://?seed=4&speed=20&skin={tmp_path / 'skin.toml'}"
    needed = []
    for rate in (8, 100):
        program = ["--program", f"until:0.5mm@{rate},120,hold:0.5"]
        out = str(tmp_path / f"{rate}.h5")
        assert run(["measure", "--port", port, *SKIN, *program, "--out", out, "--json"]) == 0
        (one,) = json.loads(capsys.readouterr().out)["curves"]
        needed.append(one["heights"][0]["pressure_mbar"])
    assert needed[0] < needed[1] - 3
