"""`skinlab discrepancy` and what its model is good for, on a campaign that reads 25 µm too much."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.fit import Fitter
from skinlab.errors import InputError
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.model_file import read_model
from skinlab.report.missing_effect import write_report

SKIN = Skin((0.04, 1.5, 0.32))


@pytest.fixture(autouse=True)
def by_the_table_alone(monkeypatch):
    """What the finite elements add is not the point here, and takes most of the time."""

    def alone(*given, **options):
        return Fitter(*given, **{**options, "finite_elements": False})

    monkeypatch.setattr("skinlab.discrepancy.workflow.Fitter", alone)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "campaign"
    return write_campaign(folder, {"deflection_offset": {"offset_um": 25.0}})


@pytest.fixture
def campaign(tmp_path, monkeypatch, written):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return shutil.copytree(written, tmp_path / "campaign")


def write_campaign(folder, effects, curves=((6.0, "ramp:100@20,ramp:0@20"), (2.0, "ramp:200@40"))):
    folder.mkdir()
    rng = np.random.default_rng(3)
    lines = ["[campaign]", "noise_um = 3.0", "pressure_noise_mbar = 0.0"]
    lines += ["placement_scatter = 0.0"]  # else two placements might each have such a zero
    for i, (aperture, text) in enumerate(curves):
        program = parse_program(text)
        time = np.arange(int(program.duration_s * 20 + 1e-9) + 1) / 20
        path = PressurePath.of_program(program)
        w = response(SKIN, effects, Geometry(aperture, 1.0), path, time).deflection_mm
        curve = Curve(
            "c", Setup(aperture, 1.0, program), time, path(time), w + rng.normal(0, 3e-3, len(w))
        )
        with (folder / f"{i}.csv").open("w") as stream:
            write_curve(stream, curve)
        lines += ["[[curve]]", f'file = "{i}.csv"', f"aperture_mm = {aperture}"]
        lines += ["thickness_mm = 1.0", f'program = "{text}"']
    (folder / "campaign.toml").write_text("\n".join(lines))
    return folder


@pytest.mark.long
def test_the_effect_is_named_adopted_used_and_kept(campaign, tmp_path, capsys, monkeypatch):
    model, report = tmp_path / "model.toml", tmp_path / "report"
    arguments = ["discrepancy", str(campaign), "--workers", "1", "--json"]
    assert run([*arguments, "--adopt", str(model), "--report", str(report)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "skinlab.discrepancy/1"
    assert document["verdict"] == "named"
    assert document["effects"] == [["deflection_offset"]]
    assert document["adopted_model"] == str(model)
    for path in (model, *report.iterdir(), *(tmp_path / "cache").rglob("discrepancy/*")):
        assert path.stat().st_mode & 0o077 == 0, path
    gap = document["gap"]
    assert gap["after_um"] < 1.2 * gap["noise_um"] < 0.5 * gap["before_um"]
    assert set(gap["held_out"]) == {"0.csv", "1.csv"}
    found = document["candidates"][0]["parameters"]["deflection_offset.offset_um"]
    sd = (found["high"] - found["low"]) / 3.29
    assert abs(found["value"] - 25.0) < 3 * sd < 3.0
    after = document["parameters"]["after"]["X1_MPa"]
    assert after["value"] == pytest.approx(0.04, rel=0.15)
    assert {p["file"] for p in document["where"]} <= {"0.csv", "1.csv"}

    page = (report / "missing-effect.html").read_text()
    assert "deflection_offset" in page
    assert "data:image/png;base64," in page
    assert "http://" not in page.replace("http://www.w3.org", "")

    adopted = read_model(model)
    assert adopted.provenance.verdict == "named"
    assert "campaign.toml" in adopted.provenance.data
    assert adopted.values["deflection_offset"]["offset_um"] == pytest.approx(25.0, abs=3.0)

    toml = str(campaign / "campaign.toml")
    assert run(["identify", toml, "--model", str(model), "--joint", "--json"]) == 0
    identified = json.loads(capsys.readouterr().out)
    assert identified["model"]["effects"] == ["deflection_offset"]
    assert identified["model"]["hash"] == adopted.hash
    joint = identified["joint"]
    assert joint["order"] == ["X1_MPa", "X2_MPa", "nu", "deflection_offset.offset_um"]
    assert np.array(joint["correlation"]).shape == (4, 4)
    assert "misfit_above_noise" not in joint["flags"]
    # What was learned from these curves does not count again; of others it is known.
    assert "learned_from_these" in joint["flags"]
    prior = adopted.prior("deflection_offset.offset_um")
    assert prior.sd == pytest.approx(2.5, abs=0.3)  # of no other site it is known better
    sure = tmp_path / "sure.toml"
    sure.write_text(model.read_text().replace(f"sd = {prior.sd!r}", "sd = 0.3"))
    other = tmp_path / "other"
    shutil.copytree(campaign, other)
    for path in other.glob("*.csv"):
        path.write_text(path.read_text() + "\n")
    told = ["identify", str(other), "--model", str(sure), "--joint", "--json"]
    assert run(told) == 0
    elsewhere = json.loads(capsys.readouterr().out)["joint"]
    assert "learned_from_these" not in elsewhere["flags"]

    def width(answer):
        offset = answer["parameters"]["deflection_offset.offset_um"]
        return offset["high"] - offset["low"]

    assert width(elsewhere) < width(joint)

    def never(*_, **__):
        raise AssertionError("computed again")

    monkeypatch.setattr("skinlab.discrepancy.workflow.explain", never)
    assert run(arguments) == 0
    again = json.loads(capsys.readouterr().out)
    assert again == {**document, "adopted_model": None}


def test_an_interrupted_run_says_what_it_knows(campaign, tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("skinlab.discrepancy.search.Pool", interrupted)  # once the base is fitted
    report = tmp_path / "report"
    assert run(["discrepancy", str(campaign), "--workers", "1", "--report", str(report)]) == 130
    assert "more than noise" in capsys.readouterr().err
    assert "more than noise" in (report / "partial.txt").read_text()
    # A finished report takes its place: "known so far" stood beside it
    monkeypatch.setattr("skinlab.report.missing_effect.render", lambda *_: "")
    page = write_report(None, report)
    assert list(report.iterdir()) == [page]
    page.unlink()
    (report / "partial.txt").write_text("of somebody else")
    write_report(None, report).unlink()
    (report / "partial.txt").unlink()
    (report / "partial.txt").mkdir()
    assert run(["discrepancy", str(campaign), "--workers", "1", "--report", str(report)]) == 130
    said = capsys.readouterr().err
    assert "more than noise" in said
    assert "partial.txt: cannot be written" in said


@pytest.mark.parametrize("option", ["--adopt", "--report"])
def test_what_cannot_be_written_is_said_before_anything_is_computed(
    campaign, tmp_path, capsys, monkeypatch, option
):
    def computed(*_, **__):
        raise InputError("computed")

    monkeypatch.setattr("skinlab.discrepancy.workflow.explain", computed)
    (tmp_path / "file").write_text("")
    at = tmp_path / "file" / "there"
    assert run(["discrepancy", str(campaign), option, str(at)]) == 3
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"skinlab: {at}")
    assert "cannot be written" in said.err
    assert run(["discrepancy", str(campaign), option, str(tmp_path / "new" / "there")]) == 3
    assert capsys.readouterr().err == "skinlab: computed\n"
    assert not (tmp_path / "new").exists()  # nothing is left behind


def test_an_answer_comes_also_where_its_files_can_no_longer_be_written(
    campaign, tmp_path, capsys, monkeypatch
):
    folder = write_campaign(tmp_path / "none", {}, [(6.0, "ramp:100@20")])

    def fails(*_):
        raise InputError("out: cannot be written (No space left on device)")

    monkeypatch.setattr("skinlab.report.missing_effect.write_report", fails)
    report = ["--report", str(tmp_path / "out")]
    assert run(["discrepancy", str(folder), "--workers", "1", "--json", *report]) == 3
    said = capsys.readouterr()
    assert json.loads(said.out)["verdict"] == "none"
    assert said.err.endswith("skinlab: out: cannot be written (No space left on device)\n")


def test_nothing_is_adopted_where_nothing_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = write_campaign(tmp_path / "none", {})
    model = tmp_path / "model.toml"
    assert run(["discrepancy", str(folder), "--workers", "1", "--adopt", str(model)]) == 0
    said = capsys.readouterr()
    assert "Nothing is missing" in said.out
    assert "Smallest sizes" in said.out
    assert "nothing to adopt" in said.err
    assert not model.exists()


def test_a_scatter_of_placements_overrides_the_campaign(campaign, monkeypatch, capsys):
    told, names = [], []

    def stopped(curves, *_, **__):
        told.append(curves.placement_scatter)
        raise InputError("enough")

    monkeypatch.setattr("skinlab.discrepancy.workflow.explain", stopped)
    monkeypatch.setattr("skinlab.discrepancy.cache.load", lambda name, _: names.append(name))
    for said in ([], ["0.05"], ["auto"]):
        option = ["--placement-scatter", *said] if said else []
        assert run(["discrepancy", str(campaign), *option]) == 3
    assert told == [0.0, 0.05, None]
    assert len(set(names)) == 3  # none of them is answered by what was kept of another
    for wrong, status in (("much", 2), ("1", 3), ("-0.1", 3), ("nan", 3)):
        assert run(["discrepancy", str(campaign), "--placement-scatter", wrong]) == status
        assert "expected auto, or 0 to below 1" in capsys.readouterr().err


def test_so_it_does_where_curves_are_identified_together(campaign, monkeypatch):
    told = []

    def stopped(identifier, _):
        told.append(identifier.sensor.placement_scatter)
        raise InputError("enough")

    monkeypatch.setattr("skinlab.inference.batch.identify_all", lambda *_: iter([]))
    monkeypatch.setattr("skinlab.inference.identify.Identifier.joint", stopped)
    for option in ([], ["--placement-scatter", "0.05"], ["--placement-scatter", "auto"]):
        assert run(["identify", str(campaign), "--joint", *option]) == 3
    assert told == [0.0, 0.05, None]


def test_a_sensor_that_is_dead_is_nothing_to_be_learned(campaign, capsys):
    """It was a zero that wanders by 120 µm."""
    header, *rows = (campaign / "1.csv").read_text().splitlines()
    dead = [f"{row.rsplit(',', 1)[0]},0.1" for row in rows]
    (campaign / "1.csv").write_text("\n".join([header, *dead]))
    assert run(["discrepancy", str(campaign), "--workers", "1"]) == 3
    said = capsys.readouterr()
    assert (said.out, said.err) == (
        "",
        "skinlab: 1.csv: the deflection is 0.1 mm at every suction; expected a dome\n",
    )


@pytest.mark.parametrize("noise_mbar", [0.0, 0.3])
def test_a_pressure_channel_that_is_dead_is_told(campaign, capsys, noise_mbar):
    """It was a RuntimeWarning, and "the model has no answer for these curves"."""
    toml = campaign / "campaign.toml"
    toml.write_text(toml.read_text().replace('program = "ramp:200@40"', ""))
    header, *rows = (campaign / "1.csv").read_text().splitlines()
    read = np.random.default_rng(5).normal(0.0, 1.0, len(rows)).clip(-2.0, 2.0) * noise_mbar
    cells = [row.split(",") for row in rows]
    lines = [f"{t},{p:.2f},{w}" for (t, _, w), p in zip(cells, read, strict=True)]
    (campaign / "1.csv").write_text("\n".join([header, *lines]))
    assert run(["discrepancy", str(campaign), "--workers", "1"]) == 3
    highest = max(float(f"{p:.2f}") for p in read) + 0.0  # and not -0
    said = f"1.csv: pressure_mbar goes no higher than {highest:g}; expected a suction"
    assert capsys.readouterr() == ("", f"skinlab: {said}\n")


def test_a_thickness_outside_the_database_is_told_as_identify_tells_it(campaign, capsys):
    """It was "the model has no answer for these curves"."""
    toml = campaign / "campaign.toml"
    toml.write_text(toml.read_text().replace("thickness_mm = 1.0", "thickness_mm = 9.0"))
    assert run(["identify", str(toml)]) == 5
    told = capsys.readouterr().err.replace(f"{campaign}/", "")
    assert "1.csv: thickness/radius 9 is outside the database" in told
    assert run(["discrepancy", str(toml), "--workers", "1"]) == 5
    assert capsys.readouterr() == ("", told)


def test_suction_that_is_recorded_as_negative_is_refused(campaign, capsys):
    header, *rows = (campaign / "1.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    lines = [",".join((t, str(-float(p)), w)) for t, p, w in cells]
    (campaign / "1.csv").write_text("\n".join([header, *lines]))
    assert run(["discrepancy", str(campaign), "--workers", "1"]) == 3
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == (
        "skinlab: 1.csv: pressure_mbar goes down to -200; expected a suction, which is positive: "
        "change its sign, or let `skinlab import` do so\n"
    )
    geometry = ["--aperture-mm", "2", "--thickness-mm", "1"]
    assert run(["identify", str(campaign / "1.csv"), *geometry]) == 3
    assert "goes down to -200" in capsys.readouterr().err


def test_bad_input_is_one_sentence(tmp_path, campaign, capsys):
    assert run(["discrepancy", str(tmp_path / "nowhere.toml")]) == 3
    assert run(["discrepancy", str(campaign / "0.csv")]) == 3
    taken = tmp_path / "taken.toml"
    taken.write_text("x")
    assert run(["discrepancy", str(campaign), "--adopt", str(taken)]) == 3
    assert "Traceback" not in capsys.readouterr().err
    assert taken.read_text() == "x"


class TestModelsWithoutEffects:
    def identify(self, campaign, tmp_path, text, *more):
        model = tmp_path / "prior.toml"
        model.write_text(text)
        return run(["identify", str(campaign / "campaign.toml"), "--model", str(model), *more])

    def test_a_prior_narrows(self, campaign, tmp_path, capsys):
        toml = str(campaign / "campaign.toml")
        assert run(["identify", toml, "--json"]) == 0
        wide = json.loads(capsys.readouterr().out)["curves"][0]["parameters"]["nu"]
        text = '[model]\nname = "p"\n[parameters.nu]\nlow = 0.2\nhigh = 0.49\n'
        text += "prior = {mean = 0.32, sd = 0.01}\n"
        assert self.identify(campaign, tmp_path, text, "--json") == 0
        document = json.loads(capsys.readouterr().out)
        narrow = document["curves"][0]["parameters"]["nu"]
        assert narrow["high"] - narrow["low"] < wide["high"] - wide["low"]
        assert document["model"]["name"] == "p"

    def test_bounds_hold(self, campaign, tmp_path, capsys):
        text = '[model]\nname = "p"\n[parameters.nu]\nlow = 0.3\nhigh = 0.34\n'
        assert self.identify(campaign, tmp_path, text, "--json") == 0
        for curve in json.loads(capsys.readouterr().out)["curves"]:
            nu = curve["parameters"]["nu"]
            assert 0.3 <= nu["low"] <= nu["value"] <= nu["high"] <= 0.34

    def test_kappa_that_contradicts_the_model_is_refused(self, campaign, tmp_path, capsys):
        text = '[model]\nname = "p"\nkappa = "consistent"\n'
        assert self.identify(campaign, tmp_path, text, "--kappa", "paper") == 3
        assert "kappa" in capsys.readouterr().err

    def test_effects_need_auto(self, campaign, tmp_path, capsys):
        text = '[model]\nname = "p"\n[effects.deflection_offset.offset_um]\nvalue = 5.0\n'
        assert self.identify(campaign, tmp_path, text, "--method", "sto") == 3
        assert "auto" in capsys.readouterr().err
