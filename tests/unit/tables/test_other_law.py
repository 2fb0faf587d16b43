"""A law with other parameters, not linear in them, from forward to discrepancy: Fung-Demiray."""

from __future__ import annotations

import json

import fung_table
import numpy as np
import pytest
from skinlab_example.fung import LAW

from skinlab.cli.main import run
from skinlab.curves.campaign import Campaign
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.model_identifier import with_model
from skinlab.discrepancy.workflow import explain
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.effects.model import response
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.fem.suction import SCREENING_MESH, Geometry
from skinlab.mechanics.materials import with_law
from skinlab.mechanics.model_file import EffectRange, Header, Model, Range
from skinlab.report.text import describe
from skinlab.tables.forward import simulate_from
from skinlab.tables.store import read, shipped_table

CUSTOM = """
[model]
name = "fung with an offset"
law = "fung"
[effects.deflection_offset.offset_um]
value = 0.0
[axis.C1_MPa]
low = 0.055
high = 0.08
nodes = 4
spacing = "log"
[axis.C2]
low = 8.0
high = 16.0
nodes = 4
spacing = "log"
[axis.nu]
low = 0.3
high = 0.36
nodes = 2
[axis.deflection_offset.offset_um]
low = -50.0
high = 50.0
nodes = 2
[pressures]
high_mbar = 60
nodes = 16
[mesh]
name = "screening-1"
"""
TRUTH = (0.066, 11.0, 0.33)
PROGRAM = parse_program("ramp:60@20")


@pytest.fixture(scope="module", autouse=True)
def law():
    with with_law(LAW):
        yield


@pytest.fixture(scope="module")
def dimensionless(tmp_path_factory):
    return fung_table.dimensionless(tmp_path_factory, tmp_path_factory.mktemp("law"))


def measured(truth, seed, aperture_mm=6.0, offset_um=0.0, noise_um=3.0):
    """Return a curve by the finite elements, with noise."""
    time_s = np.arange(61) / 20.0
    pressure = PROGRAM.pressure_mbar(time_s)
    found = response(
        Skin(truth, "paper", "fung"), {}, Geometry(aperture_mm, 1.0),
        PressurePath.of_program(PROGRAM), time_s, discretisation=SCREENING_MESH,
    )  # fmt: skip
    noise = np.random.default_rng(seed).normal(0.0, 1e-3 * noise_um, len(time_s))
    setup = Setup(aperture_mm, 1.0, PROGRAM)
    deflection = found.deflection_mm + noise + 1e-3 * offset_um
    return Curve(f"d{aperture_mm:g}_{seed}.csv", setup, time_s, pressure, deflection)


def written(folder, curve):
    path = folder / curve.name
    with path.open("w", encoding="utf-8") as file:
        write_curve(file, curve)
    return path


def test_forward_takes_the_laws_own_options(tmp_path, capsys):
    told = ["forward", "--direct", "--law", "fung", "--c1-mpa", "0.066", "--c2", "11", "--nu"]
    told += ["0.33", "--aperture-mm", "6", "--thickness-mm", "1", "--program", "ramp:60@20"]
    assert run(told) == 0
    last = capsys.readouterr().out.strip().splitlines()[-1]
    expected = measured(TRUTH, 0, noise_um=0.0).deflection_mm[-1]
    assert float(last.split(",")[2]) == pytest.approx(expected, rel=0.01)  # another mesh
    assert run([*told, "--x1-mpa", "0.03"]) == 2
    assert "--x1-mpa is not a parameter of the law fung" in capsys.readouterr().err
    assert run([t for t in told if t not in ("--c2", "11")]) == 2
    assert "Missing option '--c2'" in capsys.readouterr().err
    # The shipped database is of another law, and no number of it is shown under this one's name.
    assert run([t for t in told if t != "--direct"]) == 3
    told = capsys.readouterr()
    assert told.out == ""
    assert "law fung" in told.err
    assert "extended_neo_hookean" in told.err


def test_a_dimensionless_table_of_it_answers_as_the_finite_elements_do(dimensionless, capsys):
    table = read(dimensionless)
    assert table.law == "fung"
    for aperture, truth in ((6.0, TRUTH), (8.0, (0.075, 17.0, 0.3))):
        direct = measured(truth, 0, aperture, noise_um=0.0)
        found, warning = simulate_from(table, Skin(truth, "paper", "fung"), {}, direct.setup)
        assert warning is None
        assert np.abs(found.deflection_mm - direct.deflection_mm).max() < 4e-3
    assert run(["database", "info", str(dimensionless)]) == 0
    said = capsys.readouterr().out
    for part in ("law fung", "C2 ", "kappa_over_half_shear", "C1_MPa", "exact", table.content_hash):
        assert part in said
    assert run(["database", "verify", str(dimensionless), "--samples", "2"]) == 0


def test_truth_hidden_in_simulated_curves_comes_back_within_the_intervals(
    dimensionless, tmp_path, capsys
):
    rng = np.random.default_rng(11)
    inside = []
    for seed in range(6):
        truth = (rng.uniform(0.055, 0.085), rng.uniform(8.0, 18.0), rng.uniform(0.28, 0.4))
        path = written(tmp_path, measured(truth, seed))
        told = ["identify", str(path), "--database", str(dimensionless), "--json"]
        assert run([*told, "--aperture-mm", "6", "--thickness-mm", "1"]) == 0
        (curve,) = json.loads(capsys.readouterr().out)["curves"]
        assert curve["order"] == ["C1_MPa", "C2", "nu"]
        assert curve["rms_um"] == pytest.approx(3.0, abs=1.0)
        values = curve["parameters"].values()
        inside += [v["low"] <= t <= v["high"] for v, t in zip(values, truth, strict=True)]
        assert curve["kappa_MPa"] > 0
        assert 0 < curve["nu_consistent"] < 0.5
    assert sum(inside) >= 14  # of 18, at 90 %


def test_the_text_speaks_of_its_parameters(dimensionless):
    found = Identifier(read(dimensionless), sensor=Sensor(3.0, 0.0))(measured(TRUTH, 3))
    text = describe(found)
    assert "C1 " in text
    assert "C2 " in text
    assert "X1" not in text


def test_a_custom_table_of_it_with_an_effect(tmp_path, capsys):
    path = fung_table.built(tmp_path, "custom", CUSTOM)
    capsys.readouterr()
    curve = written(tmp_path, measured(TRUTH, 4, offset_um=20.0))
    told = ["identify", str(curve), "--database", str(path), "--json"]
    assert run([*told, "--aperture-mm", "6", "--thickness-mm", "1"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["curves"]
    values = found["parameters"]
    assert list(values) == ["C1_MPa", "C2", "nu", "deflection_offset.offset_um"]
    truth = dict(zip(values, (*TRUTH, 20.0), strict=True))
    inside = [v["low"] <= truth[name] <= v["high"] for name, v in values.items()]
    assert sum(inside) >= 3
    offset = values["deflection_offset.offset_um"]
    assert offset["low"] <= 20.0 <= offset["high"]
    campaign = Campaign("", 3.0, 0.0, (measured(TRUTH, 4),))
    with pytest.raises(InputError, match='form = "dimensionless"'):
        explain(campaign, read(path), model=Model(Header("fung", "fung")))


@pytest.mark.long
def test_a_model_of_it_with_an_effect_is_identified_and_bounded(dimensionless):
    table = read(dimensionless)
    effects = {"deflection_offset": {"offset_um": EffectRange(0.0)}}
    model = Model(Header("fung", "fung"), effects=effects)
    base = Identifier(table, sensor=Sensor(3.0, 0.0))
    found = with_model(base, model)(measured(TRUTH, 5, offset_um=20.0))
    assert found.error is None
    for name, true in zip(("C1_MPa", "C2", "nu"), TRUTH, strict=True):
        at = found.parameters[name]
        assert at.low <= true <= at.high
    tight = Model(Header("fung", "fung"), {"C2": Range(13.0, 20.0, "log-uniform")}, effects)
    bounded = with_model(base, tight)(measured(TRUTH, 5, offset_um=20.0))
    assert bounded.parameters["C2"].value >= 13.0 - 1e-9


@pytest.mark.long
def test_discrepancy_names_what_is_missing_beside_it(dimensionless):
    curves = tuple(measured(TRUTH, k, a, offset_um=25.0) for k, a in enumerate((6.0, 8.0, 6.0)))
    model = Model(Header("fung", "fung"))
    campaign = Campaign("", 3.0, 0.0, curves)
    outcome = explain(campaign, read(dimensionless), model=model, finite_elements=False)
    assert outcome.verdict.name in ("named", "ambiguous")
    explanations = [c.effects for c in outcome.verdict.explanations]
    assert ("deflection_offset",) in explanations
    values = outcome.parameters(
        next(c for c in outcome.found.candidates if c.effects == ("deflection_offset",))
    )
    assert set(values) == {"C1_MPa", "C2", "nu", "deflection_offset.offset_um"}
    truth = dict(zip(("C1_MPa", "C2", "nu"), TRUTH, strict=True))
    inside = [values[n]["low"] <= true <= values[n]["high"] for n, true in truth.items()]
    assert sum(inside) >= 2


def test_a_law_that_the_database_is_not_of_is_refused_everywhere(dimensionless):
    curve = measured(TRUTH, 6)
    for table, law_name in ((shipped_table(), "fung"), (read(dimensionless), "mooney_rivlin")):
        model = Model(Header("another", law_name))
        with pytest.raises(InputError, match=f"law {law_name}: this database is of the law"):
            with_model(Identifier(table), model)
        with pytest.raises(InputError, match=f"law {law_name}: this database is of the law"):
            explain(Campaign("", 3.0, 0.0, (curve,)), table, model=model)
        skin = Skin(tuple(p.typical for p in model.law.parameters), "paper", law_name)
        with pytest.raises(InputError, match=f"law {law_name}: this database is of the law"):
            simulate_from(table, skin, {}, curve.setup)
