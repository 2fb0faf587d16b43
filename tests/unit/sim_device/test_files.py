from __future__ import annotations

import re
from pathlib import Path

import pytest

from sim_device.build import build_device
from sim_device.cohort import CohortFile
from sim_device.files import SensorSection, SkinFile, SkinSection, load_skin_file, load_toml
from sim_device.skin import make_skin

WHOLE = """
[skin]
X1_MPa = 0.025
X2_MPa = 2.95
nu = 0.28
kappa = "paper"
thickness_mm = 1
[effects.viscoelasticity]
g = 0.3
tau_s = 1
[sensor]
rate_hz = 100
noise_um = 0
"""


def test_a_whole_file(tmp_path):
    path = tmp_path / "SKIN.toml"
    path.write_text(WHOLE)
    assert load_skin_file(path) == SkinFile(
        SkinSection(), {"viscoelasticity": {"g": 0.3, "tau_s": 1.0}}, SensorSection(100, 0)
    )


def test_the_defaults(tmp_path):
    path = tmp_path / "SKIN.toml"
    path.write_text("")
    assert load_skin_file(path) == SkinFile()
    assert SkinFile().skin == SkinSection(0.025, 2.95, 0.28, "paper", 1.0)
    assert SkinFile().sensor == SensorSection(20, 3, 1, 0.2, 0.1)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("[skin]\nX3_MPa = 1", "X3_MPa"),
        ("[skins]", "skins"),
        ("[skin]\nnu = 0.5", "skin.nu"),
        ("[skin]\nnu = '0.3'", "skin.nu"),
        ("[skin]\nX1_MPa = 0", "skin.X1_MPa"),
        ("[skin]\nX1_MPa = nan", "X1_MPa"),
        ("[skin]\nthickness_mm = inf", "thickness_mm"),
        ("[skin]\nkappa = 'other'", "skin.kappa"),
        ("[skin.parameters]\nX1_MPa = 0.2\nbanana = 9", "skin: parameters.X1_MPa is of no law"),
        ("[skin]\nlaw = 'fung'\nX1_MPa = 0.025", "skin.X1_MPa: not read where skin.law is"),
        ("[skin]\nthickness_mm = true", "skin.thickness_mm"),
        ("[sensor]\nrate_hz = 0", "sensor.rate_hz"),
        ("[sensor]\nnoise_um = -1", "sensor.noise_um"),
        ("[effects.viscoelasticity]\ng = 'much'", r"effects\.viscoelasticity\.g must be a number"),
        ("[effects.viscoelasticity]\ng = true", r"effects\.viscoelasticity\.g must be a number"),
        ("[effects.viscoelasticity]\ng = nan", "effects.viscoelasticity.g"),
        ("[effects]\ng = 1", "effects"),
        ("[skin", "end of document"),
        ("[skin]\nnu = 0.3\nnu = 0.3", "line 3|overwrite"),
    ],
)
def test_bad_files(tmp_path, text, match):
    path = tmp_path / "SKIN.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=match) as caught:
        load_skin_file(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ValueError, match="No such file"):
        load_skin_file(tmp_path / "none.toml")
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match=r"binary\.toml"):
        load_skin_file(path)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"speed": 0.5}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"aperture_mm": 5}, "aperture_mm"),
        ({"seed": -1}, "seed"),
    ],
)
def test_what_no_probe_can_be(change, match):
    with pytest.raises(ValueError, match=match):
        build_device(None, **({"seed": 0, "speed": 1, "aperture_mm": 6} | change))


def test_the_page_on_the_simulator_lists_all_fields_with_their_defaults(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "simulator.md").read_text("utf-8")
    plain, other = re.findall(r"```toml\n(\[skin\].*?)```", page, re.DOTALL)
    path = tmp_path / "SKIN.toml"
    path.write_text(plain)
    found = load_skin_file(path)
    assert (found.skin, found.sensor) == (SkinSection(), SensorSection())
    fields = {*SkinSection.__struct_fields__, *SensorSection.__struct_fields__}
    assert fields - {"law", "parameters"} <= set(re.findall(r"^(\w+) =", plain, re.MULTILINE))
    path.write_text(other)
    make_skin(load_skin_file(path).skin, {})


def test_a_cohort_is_of_the_papers_law(tmp_path):
    path = tmp_path / "COHORT.toml"
    path.write_text("[skin]\nlaw = 'mooney_rivlin'\n")
    with pytest.raises(ValueError, match=r"COHORT.toml: skin.law: a cohort has the paper's"):
        load_toml(path, CohortFile)
