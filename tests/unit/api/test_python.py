"""`import skinlab`: what its functions return and refuse."""

from __future__ import annotations

import copy
import json
import os
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from skinlab_example.fung import LAW

import skinlab
from skinlab.cli.main import run
from skinlab.mechanics.materials import with_law

ROOT = Path(__file__).parents[3]
SKIN = {"X1_MPa": 0.03, "X2_MPa": 1.0, "nu": 0.32}
OPENING = {"aperture_mm": 6, "thickness_mm": 1.0}
GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]


@pytest.fixture
def curve():
    return skinlab.forward(**SKIN, **OPENING, program="ramp:100@20")


@pytest.fixture
def path(curve, tmp_path) -> Path:
    file = tmp_path / "c.csv"
    file.write_text(str(curve) + "\n")
    return file


def python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    file = folder / "script.py"
    file.write_text(code)
    return subprocess.run(
        [sys.executable, str(file)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


@pytest.mark.docs
def test_the_page_runs_as_one_program(tmp_path):
    page = (ROOT / "docs/python.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    facts = (
        "assert abs(result.parameters.X1_MPa.value - 0.03) < 3e-4\n"
        "assert measurement.results[1].parameters == measurement.curves[1].parameters\n"
        "assert explanation.effects == [['deflection_offset']], explanation.effects\n"
        "assert again.order[3] == 'deflection_offset.offset_um'\n"
        "assert explanation.adopted_model == 'model.toml'\n"
        "assert 'data:image/' in explanation._repr_html_()\n"
        "assert len(table) == study.curves == 6 and study.failures == []\n"
        "assert table.subject.unique().tolist() == list(people)\n"
        "assert 'data:image/' in study._repr_html_()\n"
    )
    done = python("\n".join([*blocks, facts]), tmp_path)
    assert done.returncode == 0, done.stderr
    assert "nothing.csv: No such file" in done.stdout


def test_a_study_says_what_it_needs(tmp_path):
    with pytest.raises(skinlab.InputError, match="no such folder"):
        skinlab.study(tmp_path / "nothing", out=tmp_path / "study")
    with pytest.raises(skinlab.InputError, match="expected a folder"):
        skinlab.study([], out=tmp_path / "study")
    with pytest.raises(skinlab.InputError, match="workers 0"):
        skinlab.study(tmp_path, out=tmp_path / "study", workers=0)


def test_a_sentence_names_arguments_as_python_has_them(tmp_path):
    with pytest.raises(skinlab.InputError, match=r"^layout {who}: {who} is unknown"):
        skinlab.study(tmp_path, out=tmp_path / "study", layout="{who}")
    with pytest.raises(skinlab.InputError, match="use direct=True, or a value inside"):
        skinlab.forward(**{**SKIN, "X1_MPa": 0.0011}, **OPENING, program="ramp:20@20")


def test_subjects_of_a_study_are_texts_in_its_frame(curve, tmp_path):
    """Read as numbers, 007 and 7 had been one person."""
    pytest.importorskip("pandas")
    for number, subject in enumerate(("007", "7")):
        file = tmp_path / "curves" / subject / "v1.csv"
        file.parent.mkdir(parents=True)
        moved = replace(curve, deflection_mm=curve.deflection_mm + 1e-3 * number)
        file.write_text(str(moved))
    study = skinlab.study(
        tmp_path / "curves", out=tmp_path / "out", layout="{subject}/v{visit}", workers=1, **OPENING
    )
    frame = study.to_frame()
    assert frame.subject.tolist() == ["007", "7"]
    assert frame.visit.tolist() == [1, 1]
    assert frame.site.isna().all()


def test_importing_is_light_and_complete(tmp_path):
    done = python(
        "import sys, skinlab\n"
        "print(sorted({'numpy', 'scipy', 'h5py', 'click', 'matplotlib'} & set(sys.modules)))\n"
        "assert set(skinlab.__all__) <= set(dir(skinlab))\n"
        "for name in skinlab.__all__:\n"
        "    assert getattr(skinlab, name).__name__ == name\n",
        tmp_path,
    )
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr
    with pytest.raises(AttributeError, match="no_such_name"):
        skinlab.no_such_name  # noqa: B018


@pytest.mark.long  # the same in a folder of its own: as_checkers_see_it.py is read by `make check`
def test_type_checkers_see_the_names(tmp_path):
    (tmp_path / "script.py").write_text(
        "import skinlab\n"
        "reveal_type(skinlab.read_curve('c.csv', aperture_mm=6, thickness_mm=1))\n"
        "skinlab.read_curve(1, aperture_mm=6, thickness_mm=1)\n"
    )
    # With the settings of `make check` what that has read need not be read again
    ours = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *ours, "script.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert 'note: Revealed type is "skinlab.api.results.Curve"' in done.stdout
    assert done.stdout.count("error:") == 1
    assert 'has incompatible type "int"' in done.stdout


@pytest.mark.parametrize("kind", [str, Path])
def test_a_path_is_a_str_or_a_path(path, kind):
    found = skinlab.read_curve(kind(path), **OPENING)
    assert found.deflection_mm.shape == (101,)
    with pytest.raises(skinlab.InputError, match="str or Path"):
        skinlab.read_curve(3, **OPENING)


def test_the_answer_is_the_command_lines(path, capsys):
    found = skinlab.identify(skinlab.read_curve(str(path), **OPENING), seed=3)
    assert run(["identify", str(path), *GEOMETRY, "--seed", "3"]) == 0
    assert capsys.readouterr().out == f"{found}\n"
    assert run(["identify", str(path), *GEOMETRY, "--seed", "3", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    said = found.to_dict()
    for one in (document, said):
        one["curves"][0]["seconds"] = 0
    assert json.loads(json.dumps(said)) == document
    assert found.parameters.X1_MPa.low == document["curves"][0]["parameters"]["X1_MPa"]["low"]
    assert found.model == document["model"]
    assert found.flags == []
    with pytest.raises(AttributeError, match="no field 'flag'"):
        _ = found.flag
    assert "\n" not in repr(found)
    assert np.abs(found.model_mm - 0).max() > 0.1


def test_a_result_can_be_changed_no_more_than_copied(curve):
    found = skinlab.identify(curve)
    copied = found.to_dict()
    copied["curves"][0]["flags"].append("mine")
    assert found.flags == []


def test_a_result_in_another_process_is_small_and_whole(curve):
    """It had been 7 MB, of which 300 results from a pool of processes made 2 GB."""
    found = skinlab.identify(curve)
    pickled = pickle.dumps(found)
    assert len(pickled) < 100_000
    again = pickle.loads(pickled)
    assert again.to_dict() == found.to_dict()
    assert str(again) == str(found)
    assert copy.deepcopy(found)._identifier.database is found._identifier.database


def test_a_program_that_has_numpy_raise_gets_the_same_answer(curve):
    """An underflow is no error here; it ended in a FloatingPointError."""
    with np.errstate(all="raise"):
        strict = [skinlab.identify(curve), skinlab.identify_joint([curve])]
    usual = [skinlab.identify(curve), skinlab.identify_joint([curve])]
    assert [one.parameters for one in strict] == [one.parameters for one in usual]


def test_options_of_a_method_go_by_name(curve):
    found = skinlab.identify(curve, method="sto", samples=200, best=10)
    assert found.method == "sto"
    with pytest.raises(skinlab.InputError, match=r"colour is not an option"):
        skinlab.identify(curve, method="sto", colour=3)
    with pytest.raises(skinlab.InputError, match="samples 1: expected"):
        skinlab.identify(curve, samples=1)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"method": "magic"}, "magic"),
        ({"phases": "climb"}, "'climb' is not a phase"),
        ({"phases": []}, "names no phase"),
        ({"site": "heel"}, "site and age_years are for a prior"),
        ({"kappa": "mine"}, "kappa 'mine': expected paper or consistent"),
        ({"seed": -1}, "seed -1"),
        ({"noise_um": 0.0}, "noise_um 0"),
        ({"model": "none.toml"}, "none.toml"),
        ({"database": "none.h5"}, "none.h5"),
        ({"phases": ("rest",)}, ""),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(curve, settings, sentence):
    with pytest.raises(skinlab.InputError) as told:
        skinlab.identify(curve, **settings)
    assert sentence in str(told.value)
    assert "--" not in str(told.value)


def test_a_phase_that_is_named_twice_is_fitted_and_named_once(curve):
    found = skinlab.identify(curve, phases="load, load")
    assert found.phases == ["load"]
    assert found.parameters == skinlab.identify(curve).parameters


class TestPopulation:
    """A prior is of somebody: at a site, of an age, from Python as by the command."""

    @pytest.fixture
    def prior(self, curve, tmp_path) -> Path:
        """People of 50, of whom older ones and those at the heel are stiffer."""
        hash_ = skinlab.identify(curve).to_dict()["model"]["hash"]
        file = tmp_path / "study.toml"
        file.write_text(
            'schema = "skinlab.prior/1"\nparameters = ["X1_MPa", "X2_MPa", "nu"]\n'
            'coordinates = ["log", "log", "linear"]\nmean = [-3.5, 0.0, 0.32]\n'
            "covariance = [[1e-2, 0, 0], [0, 1e-2, 0], [0, 0, 1e-4]]\nfreedom = 20.0\n"
            "people = 20\ncurves = 20\nage_years = 50.0\nage_sd_years = 10.0\n"
            f'per_decade = [0.01, 0, 0]\nmodel_hash = "{hash_}"\n'
            "sites.arm = {shift = [0, 0, 0], curves = 10}\n"
            "sites.heel = {shift = [0.05, 0.1, 0], curves = 10}\n"
        )
        return file

    def test_python_knows_of_whom_it_is_as_the_command_does(self, prior, path, curve, capsys):
        noisy = replace(
            curve, deflection_mm=curve.deflection_mm + np.random.default_rng(1).normal(0, 3e-3, 101)
        )
        path.write_text(str(noisy) + "\n")
        read = skinlab.read_curve(path, **OPENING)
        whose = {"site": "heel", "age_years": 70}
        found = skinlab.identify(read, prior=prior, **whose)
        assert found.parameters != skinlab.identify(read, prior=prior).parameters
        assert found.parameters == skinlab.identify_joint([read], prior=prior, **whose).parameters
        asked = ["--prior", str(prior), "--site", "heel", "--age-years", "70", "--json"]
        assert run(["identify", str(path), *GEOMETRY, *asked]) == 0
        (said,) = json.loads(capsys.readouterr().out)["curves"]
        assert said["parameters"] == found.to_dict()["curves"][0]["parameters"]
        with pytest.raises(skinlab.InputError, match="no site 'toe'; expected one of: arm, heel"):
            skinlab.identify(read, prior=prior, site="toe")

    def test_a_measurement_is_at_its_own_site(self, prior, tmp_path):
        """Its site was kept, and the prior was that of all sites."""
        with pytest.raises(skinlab.InputError, match="no site 'toe'"):
            skinlab.measure(
                "sim://", **OPENING, program="ramp:50@20", out=tmp_path / "s.h5", site="toe",
                prior=prior,
            )  # fmt: skip

    def test_a_study_takes_none(self, prior, path):
        with pytest.raises(skinlab.InputError, match="identified by themselves"):
            skinlab.study(path.parent, out=path.parent / "out", prior=prior)


class TestTypes:
    """What a type checker would have found is one sentence for whoever has none."""

    @pytest.mark.parametrize(
        ("ask", "sentence"),
        [
            (lambda c: skinlab.read_curve("c.csv", aperture_mm="6", thickness_mm=1),
             "aperture_mm '6': expected a number"),
            (lambda c: skinlab.read_curve("c.csv", aperture_mm=True, thickness_mm=1),
             "aperture_mm True: expected a number"),
            (lambda c: skinlab.read_curve(5, **OPENING), "path 5: expected a path, as str or Path"),
            (lambda c: skinlab.read_curve("c.csv", **OPENING, program=5),
             "program 5: expected a text or a Program or None"),
            (lambda c: skinlab.identify(c, seed="a"), "seed 'a': expected a whole number"),
            (lambda c: skinlab.identify(c, seed=0.5), "seed 0.5: expected a whole number"),
            (lambda c: skinlab.identify(c, samples="1000"),
             "samples '1000': expected a whole number or None"),
            (lambda c: skinlab.identify(c, method=None), "method None: expected a text"),
            (lambda c: skinlab.identify(c, phases=[1]), "phases [1]: expected a text or a list"),
            (skinlab.identify_joint, "expected a list, each of it a curve"),
            (lambda c: skinlab.identify_joint([c, 3]), "expected a list, each of it a curve"),
            (lambda c: skinlab.forward(**SKIN, **OPENING, program="ramp:100@20", rate_hz="20"),
             "rate_hz '20': expected a number"),
            (lambda c: skinlab.measure("sim://", **OPENING, program="ramp:50@20", out="s.h5",
                                       repeats="2"), "repeats '2': expected a whole number"),
            (lambda c: skinlab.measure("sim://", **OPENING, program="ramp:50@20", out="s.h5",
                                       on_result=3), "on_result 3: expected"),
            (lambda c: skinlab.forward(**{**SKIN, "X2_MPa": True}, **OPENING, program="ramp:9@9"),
             "X2_MPa True: expected a number"),
            (lambda c: skinlab.forward(**{**SKIN, "X2_MPa": b"1"}, **OPENING, program="ramp:9@9"),
             "X2_MPa b'1': expected a number"),
            (lambda c: skinlab.explain(7), "campaign 7: expected"),
            (lambda c: skinlab.explain(skinlab.Campaign("c", None, None, (c,)), workers=10**6),
             "workers 1000000: expected 1–1024"),
            (lambda c: skinlab.study([7], out="there"), "folder [7]: expected"),
            (lambda c: skinlab.study("here", out="there", workers="2"), "workers '2': expected"),
        ],
    )  # fmt: skip
    def test_another_type_is_refused_in_a_sentence(self, curve, ask, sentence):
        with pytest.raises(skinlab.InputError) as told:
            ask(curve)
        assert sentence in str(told.value)
        assert "\n" not in str(told.value)

    def test_numbers_of_numpy_are_numbers(self, curve):
        found = skinlab.identify(curve, seed=np.int64(1), noise_um=np.float32(3.0))
        assert found.seed == 1
        hka = skinlab.identify(curve, method="hka", slowdown=np.float32(0.5), samples=np.int64(100))
        setup = replace(curve.setup, aperture_mm=np.int16(6), cycle=np.uint8(1))
        stated = skinlab.Campaign("c", np.float32(2.0), None, (replace(curve, setup=setup),))
        for one in (found, hka, stated):
            json.dumps(one.to_dict())  # of numpy's own it was a TypeError

    def test_a_measurement_takes_numbers_of_numpy(self, tmp_path):
        """It had broken down at its first curve, under suction."""
        measured = skinlab.measure(
            "sim://?seed=1&speed=200",
            aperture_mm=np.int64(6),
            thickness_mm=np.float32(1.0),
            program="ramp:50@50",
            out=tmp_path / "v.h5",
            rate_hz=np.float32(50.0),
            repeats=np.int64(1),
            first_cycle=np.int64(1),
            seed=np.int64(2),
            noise_um=np.float32(3.0),
        )
        assert len(measured.curves) == 1
        assert skinlab.read_session(tmp_path / "v.h5").results[0].parameters

    def test_a_warning_names_the_line_of_the_caller(self):
        with pytest.warns(UserWarning, match="crease") as told:
            skinlab.forward(X1_MPa=0.01, X2_MPa=0.1, nu=0.3, **OPENING, program="ramp:100@20")
        assert told[0].filename == __file__


def test_a_curve_that_is_read_knows_its_placement(path):
    assert skinlab.read_curve(path, **OPENING).setup.placement is None
    assert skinlab.read_curve(path, **OPENING, placement="a").setup.placement == "a"


@pytest.mark.parametrize("program", ["ramp:100@5", "ramp:50@20,ramp:0@20"])
def test_a_curve_of_another_program_is_refused(path, program):
    """Its phases would be wrong: as a campaign's, and an import's."""
    with pytest.raises(skinlab.InputError, match="does not follow its program"):
        skinlab.read_curve(path, aperture_mm=6, thickness_mm=1, program=program)


def test_identify_wants_a_curve(path):
    with pytest.raises(skinlab.InputError, match="read_curve"):
        skinlab.identify(str(path))
    with pytest.raises(skinlab.InputError, match="one curve or more"):
        skinlab.identify_joint([])


def test_arguments_have_the_contracts_names(curve):
    names = {
        "read_curve": "path aperture_mm thickness_mm program",
        "read_session": "path",
        "read_campaign": "path",
        "identify": "curve method model prior seed",
        "identify_joint": "curves",
        "forward": "aperture_mm thickness_mm program model direct",
        "explain": "campaign model workers",
        "measure": "url",
        "study": "folder",
    }
    for function, arguments in names.items():
        assert set(arguments.split()) <= set(signature(getattr(skinlab, function)).parameters)
    by_name, by_place = skinlab.identify_joint(curves=[curve]), skinlab.identify_joint([curve])
    assert by_name.parameters == by_place.parameters


def test_a_campaign_that_is_not_there_is_said_so(tmp_path):
    for ask in (skinlab.read_campaign, skinlab.explain):
        with pytest.raises(skinlab.InputError, match="gone: no such file"):
            ask(tmp_path / "gone")


def test_a_name_that_is_too_long_is_said_so(tmp_path):
    long = tmp_path / ("x" * 300)
    for ask in (
        skinlab.read_campaign,
        skinlab.explain,
        lambda name: skinlab.study(name, out=tmp_path / "out"),
        lambda name: skinlab.study(tmp_path, out=name),
        lambda name: skinlab.measure("sim://", **OPENING, program="ramp:100@20", out=f"{name}.h5"),
    ):
        with pytest.raises(skinlab.InputError, match="too long"):
            ask(long)


def test_parameters_are_those_of_the_law(curve, capsys):
    with pytest.raises(skinlab.InputError, match="nu: missing for the law"):
        skinlab.forward(X1_MPa=0.03, X2_MPa=1, **OPENING, program="ramp:100@20")
    with pytest.raises(skinlab.InputError, match="C1_MPa: not of the law"):
        skinlab.forward(**SKIN, C1_MPa=1, **OPENING, program="ramp:100@20")
    with pytest.raises(skinlab.InputError, match="nu 'much': expected a number"):
        skinlab.forward(**{**SKIN, "nu": "much"}, **OPENING, program="ramp:100@20")
    command = ["forward", "--x1-mpa", "0.03", "--x2-mpa", "1", "--nu", "0.32", *GEOMETRY]
    assert run([*command, "--program", "ramp:100@20"]) == 0
    assert capsys.readouterr().out == f"{curve}\n"


def test_several_curves_answer_together(curve):
    again = replace(curve, deflection_mm=curve.deflection_mm + 1e-6)
    setup, more = replace(curve.setup, cycle=2), curve.deflection_mm + 2e-6
    later = replace(curve, setup=setup, deflection_mm=more)
    campaign = skinlab.Campaign("arm", 3.0, 0.0, (curve, again, later))
    with pytest.warns(UserWarning, match="1 curve of later cycles"):
        found = skinlab.identify_joint(campaign)
    assert found.to_dict()["curves"] == []
    assert found.files == ["simulated", "simulated (2)"]
    same = skinlab.identify_joint([curve, again], noise_um=3.0, pressure_noise_mbar=0.0)
    assert found.parameters == same.parameters
    assert found.parameters != skinlab.identify_joint([curve, again]).parameters
    assert found.parameters.X1_MPa.low < 0.03 < found.parameters.X1_MPa.high
    stated = replace(campaign, curves=(curve, again), placement_scatter=0.0)
    assert skinlab.identify_joint(stated).placement is None
    assert skinlab.identify_joint(stated, placement_scatter="auto").parameters == found.parameters
    with pytest.raises(skinlab.InputError, match="'much': expected auto or a number"):
        skinlab.identify_joint(stated, placement_scatter="much")
    for twice in ([curve, curve], skinlab.Campaign("arm", 3.0, 0.0, (curve, curve))):
        with pytest.raises(skinlab.InputError, match="the same readings are given twice"):
            skinlab.identify_joint(twice)
    with pytest.raises(skinlab.InputError, match="the same readings are given twice"):
        skinlab.explain(twice)
    assert "arm" in repr(campaign)
    assert len(campaign.to_dict()["curves"]) == 3


@pytest.mark.parametrize(
    ("stated", "sentence"),
    [
        ({"noise_um": -3.0}, "noise_um -3.0: expected more than 0 and less than 8000, or None"),
        ({"noise_um": float("nan")}, "noise_um nan: expected more than 0"),
        ({"pressure_noise_mbar": "0.2"}, "pressure_noise_mbar '0.2': expected 0 or more"),
        ({"placement_scatter": 2.0}, "placement_scatter 2.0: expected 0 to below 1, or None"),
        ({"curves": ()}, "curves: expected one curve or more"),
        ({"curves": ("c.csv",)}, "curves: 'c.csv' is no curve"),
        ({"curves": (None,)}, "curves: None is no curve"),
        ({"title": 3}, "title 3: expected a text"),
    ],
)
def test_a_campaign_that_no_file_could_state_is_refused(curve, stated, sentence):
    """Such a one had been a traceback of numpy; a scatter of 200 % was taken."""
    with pytest.raises(skinlab.InputError) as told:
        skinlab.Campaign(
            **{"title": "", "noise_um": None, "pressure_noise_mbar": None, "curves": (curve,)}
            | stated
        )
    assert sentence in str(told.value)
    known = skinlab.Campaign("", None, None, [curve], "auto")
    assert (known.curves, known.placement_scatter) == ((curve,), None)


@pytest.mark.long
def test_a_notebook_shows_no_markup_of_others(curve):
    named = replace(curve, name="<script>alert(1)</script>\x1b[2J")
    for one in (named, skinlab.identify(named), skinlab.Campaign("<b>", None, None, (named,))):
        page = one._repr_html_()
        assert "<script" not in page
        assert "<b>" not in page
        assert "\x1b" not in page
        assert 'src="data:image/' in page


def test_frames(curve):
    pytest.importorskip("pandas")
    assert curve.to_frame()["deflection_mm"].to_numpy() == pytest.approx(curve.deflection_mm)
    found = skinlab.identify(curve)
    frame = found.to_frame().set_index("parameter")
    assert frame.loc["nu", "low"] == found.parameters.nu.low


def test_without_pandas_a_sentence_says_what_to_install(curve, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(skinlab.InputError, match=r"pip install 'skinlab\[notebook\]'"):
        curve.to_frame()


def test_an_interrupted_measurement_is_saved(tmp_path):
    out = tmp_path / "s.h5"

    def stop(_):
        raise KeyboardInterrupt

    interval = sys.getswitchinterval()
    with pytest.raises(KeyboardInterrupt) as told:
        skinlab.measure(
            "sim://?seed=1&speed=20", **OPENING, program="ramp:50@20", out=str(out), on_result=stop
        )
    assert str(out) in told.value.__notes__[0]
    assert sys.getswitchinterval() == interval
    session = skinlab.read_session(str(out))
    assert len(session.curves) == 1
    assert "run ended" in str(session)
    assert session.to_dict()["curves"][0]["setup"]["program"] == "ramp:50@20"


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"program": None}, "program: expected"),
        ({"repeats": 0}, "repeats 0"),
        ({"phases": "hold"}, "has no hold"),
        ({"dose_limit_mbar_s": 1.0}, "(dose_limit_mbar_s)"),
        ({"dialect": "klingon"}, "klingon"),
        ({"dialect": Path("none.toml")}, "none.toml"),
        ({"url": "gopher://probe"}, "gopher"),
        ({"aperture_mm": 5}, "aperture_mm 5"),
    ],
)
def test_a_measurement_is_refused_before_it_begins(tmp_path, settings, sentence):
    usual = {"url": "sim://?seed=1", "program": "ramp:50@20", "out": tmp_path / "s.h5"}
    with pytest.raises(skinlab.InputError) as told:
        skinlab.measure(**{**usual, **OPENING, **settings})
    assert sentence in str(told.value)
    assert not list(tmp_path.iterdir())


def test_a_probe_that_is_not_there_is_an_acquisition_error(tmp_path):
    with pytest.raises(skinlab.AcquisitionError):
        skinlab.measure(
            str(tmp_path / "tty"), **OPENING, program="ramp:50@20", out=tmp_path / "s.h5"
        )
    assert not list(tmp_path.iterdir())


def test_another_laws_parameters_go_by_their_names():
    names = LAW.names
    with with_law(LAW):
        found = skinlab.forward(
            law=LAW.name,
            **dict(zip(names, (0.01, 12.0, 0.3), strict=True)),
            **OPENING,
            program="ramp:20@20",
            direct=True,
            rate_hz=10.0,
        )
        with pytest.raises(skinlab.InputError, match="X1_MPa, X2_MPa: not of the law fung"):
            skinlab.forward(law=LAW.name, **SKIN, **OPENING, program="ramp:20@20")
    assert found.deflection_mm[-1] > 0.1
