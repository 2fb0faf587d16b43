"""SPEC.toml: strict in, filled in, and an adopted MODEL.toml as one."""

import pytest
from skinlab_example.warm_up import EFFECT as WARM_UP

from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.mechanics.effects import EFFECTS
from skinlab.tables.axes import AxisRange
from skinlab.tables.custom_spec import spec_from_json
from skinlab.tables.spec_file import read_spec

WHOLE = """
[model]
name = "tension"
kappa = "consistent"
[parameters.X1_MPa]
low = 0.005
high = 0.2
[effects.natural_tension.stretch]
value = 1.03
[effects.contact_preload.p0_mbar]
value = 2.0
[axis.nu]
low = 0.28
high = 0.4
nodes = 4
[axis.X2_MPa]
low = 0.5
high = 2
nodes = 3
spacing = "log"
[axis.X1_MPa]
low = 0.02
high = 0.05
nodes = 3
spacing = "log"
[axis.natural_tension.stretch]
low = 1.0
high = 1.06
nodes = 5
spacing = "chebyshev"
[pressures]
high_mbar = 60
nodes = 31
spacing = "chebyshev"
[mesh]
name = "screening-1"
[measurement]
aperture_mm = 8
thickness_mm = 1.2
program = "ramp:60@20"
cycle = 2
"""

HISTORY = """
[model]
name = "relaxing"
[effects.viscoelasticity.g]
value = 0.3
[effects.viscoelasticity.tau_s]
value = 1.0
"""


def written(tmp_path, text, name="spec.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_whole_spec_is_read(tmp_path):
    spec = read_spec(written(tmp_path, WHOLE))
    # X1, X2 and ν first, whatever the file's order; quotes around effect.parameter or none.
    assert list(spec.axis) == ["X1_MPa", "X2_MPa", "nu", "natural_tension.stretch"]
    assert spec.shape == (3, 3, 4, 5)
    assert spec.entries == 180
    assert spec.discretisation.name == "screening-1"
    assert (spec.geometry.aperture_mm, spec.geometry.thickness_mm) == (8.0, 1.2)
    skin, effects = spec.skin((0.03, 1.0, 0.3, 1.05))
    assert (skin.values, skin.kappa) == ((0.03, 1.0, 0.3), "consistent")
    # A parameter without an axis takes the model's value.
    assert effects == {"natural_tension": {"stretch": 1.05}, "contact_preload": {"p0_mbar": 2.0}}
    quoted = WHOLE.replace("axis.natural_tension.stretch", 'axis."natural_tension.stretch"')
    assert read_spec(written(tmp_path, quoted)) == spec
    assert spec_from_json(spec.to_json()) == spec


def test_nodes_are_spaced_as_asked():
    assert AxisRange(0.0, 3.0, 4).values().tolist() == [0.0, 1.0, 2.0, 3.0]
    assert AxisRange(0.01, 1.0, 3, "log").values() == pytest.approx([0.01, 0.1, 1.0])
    chebyshev = AxisRange(-1.0, 1.0, 5, "chebyshev").values()
    assert chebyshev == pytest.approx([-1.0, -(0.5**0.5), 0.0, 0.5**0.5, 1.0], abs=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("nodes = 4", "nodes = 1", "axis.nu.nodes is 1: expected 2 to 1000"),
        ("nodes = 4", "nodes = 4.5", "axis.nu.nodes"),
        ("nodes = 4", "", "axis.nu: .*nodes"),
        ("nodes = 5", "nodes = 40", "axis.natural_tension.stretch.nodes is 40: expected 2 to 16"),
        ("nodes = 4", "nodes = 4\nknots = 3", "axis.nu.*knots"),
        ('spacing = "log"', 'spacing = "even"', "axis.X2_MPa.spacing"),
        ("low = 0.5\n", "low = 0\n", "axis.X2_MPa.spacing: log needs a positive low"),
        ("low = 0.28", "low = 0.4", "axis.nu: low 0.4 is not below high 0.4"),
        ("low = 0.28", "low = nan", "axis.nu.low is nan"),
        ("low = 0.28", 'low = "a"', "axis.nu.low"),
        ("high = 0.4\n", "high = 0.5\n", "axis.nu.high is 0.5: expected 0 to 0.499"),
        ("low = 0.02", "low = 0.001", "axis.X1_MPa.low is 0.001: expected 0.005 to 0.2"),
        ("high = 1.06", "high = 1.3", "axis.natural_tension.stretch.high is 1.3: expected 1 to"),
        ("[axis.nu]", "[axis.Nu]", "axis.Nu is not known; expected one of: X1_MPa, X2_MPa, nu"),
        ("axis.natural_tension.stretch", "axis.natural_tension.pull", "axis.natural_tension.pull"),
        ("axis.natural_tension.stretch", "axis.tape_slip.slip_mm", "axis.tape_slip.slip_mm is not"),
        ("effects.natural_tension.stretch", "effects.natural_tension.pull", "pull is not known"),
        ("[mesh]", "[meshes]", "meshes is not known; expected one of: axis"),
        ("screening-1", "fine", "mesh.name 'fine' is not known; expected one of: record-2"),
        ("high_mbar = 60", "high_mbar = 501", "pressures.high_mbar is 501"),
        ("high_mbar = 60", "high_mbar = 50", "high_mbar is 50, and measurement.program goes to 60"),
        ("high_mbar = 60", "top = 60", "pressures.*top"),
        ("nodes = 31", "nodes = 3", "pressures.nodes is 3: expected 4"),
        ("[pressures]\nhigh_mbar = 60", "[pressures]\nhigh_mbar = inf", "pressures.high_mbar"),
        ("aperture_mm = 8", "aperture_mm = 7", "measurement.aperture_mm: .*2, 4, 6, 8"),
        ("thickness_mm = 1.2", "thickness_mm = 0", "measurement.thickness_mm: .*0.1"),
        ("ramp:60@20", "climb:60", "measurement.program: "),
        ("cycle = 2", "cycle = 0", "measurement.cycle is 0"),
        ("[mesh]\nname", "mesh = 3\n[mesh2]\nname", "spec.toml: "),
        ('kappa = "consistent"', 'kappa = "other"', "model.kappa"),
        ("value = 1.03", "value = 2.0", "effects.natural_tension.stretch is 2"),
        ("[model]", "[model", "spec.toml: "),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, said):
    assert old in WHOLE
    path = written(tmp_path, WHOLE.replace(old, new, 1))
    with pytest.raises(InputError, match=said) as caught:
        read_spec(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_axes_where_there_is_no_such_skin_are_refused(tmp_path):
    text = """
    [model]
    name = "layered"
    [effects.surface_layer.thickness_um]
    value = 20.0
    [effects.surface_layer.X1_MPa]
    value = 1.0
    [effects.thickness_error.ratio]
    value = 1.0
    [measurement]
    thickness_mm = 0.1
    [axis.surface_layer.thickness_um]
    low = 10.0
    high = 100.0
    nodes = 3
    """
    with pytest.raises(InputError, match=r"axis: at X1_MPa .* expected less than the skin"):
        read_spec(written(tmp_path, text))


def test_a_model_file_is_a_spec(tmp_path):
    model = """
    [model]
    name = "adopted"
    [parameters.nu]
    low = 0.3
    high = 0.45
    [effects.natural_tension.stretch]
    value = 1.03
    prior = {mean = 1.03, sd = 0.005}
    [provenance]
    verdict = "named"
    """
    spec = read_spec(written(tmp_path, model, "adopted.toml"))
    assert list(spec.axis) == ["X1_MPa", "X2_MPa", "nu", "natural_tension.stretch"]
    assert (spec.axis["nu"].low, spec.axis["nu"].high) == (0.3, 0.45)  # within the model's bounds
    stretch = spec.axis["natural_tension.stretch"]
    assert (stretch.low, stretch.high) == pytest.approx((1.01, 1.05))  # four deviations
    assert spec.high_mbar == 100.0
    named = '[model]\nfile = "adopted.toml"\n'
    assert read_spec(written(tmp_path, named)) == spec
    with pytest.raises(InputError, match=r"model.name is not known beside model.file"):
        read_spec(written(tmp_path, named + 'name = "mine"\n'))
    with pytest.raises(InputError, match=r"effects is not known beside model.file"):
        read_spec(written(tmp_path, named + "[effects.natural_tension.stretch]\nvalue = 1.1\n"))
    with pytest.raises(InputError, match=r"away.toml: No such file"):
        read_spec(written(tmp_path, '[model]\nfile = "away.toml"\n'))


def test_an_effect_of_time_has_a_program(tmp_path):
    spec = read_spec(written(tmp_path, HISTORY))
    assert spec.has_history
    assert str(spec.program) == "ramp:100@20,ramp:0@20"
    own = read_spec(written(tmp_path, HISTORY + '[measurement]\nprogram = "ramp:60@5,hold:2"\n'))
    assert str(own.program) == "ramp:60@5,hold:2"
    assert own.high_mbar == 60.0
    without = spec.to_json().replace('"program":"ramp:100@20,ramp:0@20"', '"program":null')
    with pytest.raises(InputError, match=r"measurement.program is missing: effects of its model"):
        spec_from_json(without)  # of a file whose effect was taken for one of the suction alone


def test_a_plugins_effect_of_time_has_a_program_too(tmp_path):
    """It had none where the plugin did not say that it needs one."""
    text = HISTORY.replace("viscoelasticity.g]\nvalue = 0.3", "warm_up.rise_um]\nvalue = 30.0")
    text = text.replace("viscoelasticity.tau_s", "warm_up.tau_s")
    with EFFECTS.lent(WARM_UP):
        spec = read_spec(written(tmp_path, text))
        assert spec.has_history
        assert str(spec.program) == "ramp:100@20,ramp:0@20"


def test_the_command_says_it_in_one_sentence(tmp_path, capsys):
    path = written(tmp_path, WHOLE.replace("nodes = 4", "nodes = 0"))
    out = tmp_path / "out.h5"
    assert run(["database", "build", "--spec", str(path), "--out", str(out)]) == 3
    assert capsys.readouterr().err == f"skinlab: {path}: axis.nu.nodes is 0: expected 2 to 1000\n"
    assert run(["database", "build", "--spec", str(tmp_path / "no.toml"), "--out", str(out)]) == 3
    assert run(["database", "build", "--spec", str(path), "--out", str(path)]) == 3
    capsys.readouterr()
    assert run(["database", "build", "--spec", "papr", "--out", str(out)]) == 3
    assert "did you mean paper?" in capsys.readouterr().err
    assert run(["database", "build", "--workers", "2", "--dask", "tcp://x:1"]) == 2
    assert not out.exists()
