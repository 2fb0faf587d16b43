"""MODEL.toml: strict in, whole out, and what `skinlab forward` makes of it."""

import csv
import io

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.mechanics.effects import EFFECTS, Effect, Parameter
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.model_file import BASE, EffectRange, Header, Model, Normal, Range, read_model
from skinlab.mechanics.model_plugins import plugins_of, warn_of_table
from skinlab.plugins import Origin

WHOLE = """
[model]
name = "forearm"
law = "extended_neo_hookean"
kappa = "consistent"
[parameters.X1_MPa]
low = 0.005
high = 0.2
prior = "log-uniform"
[parameters.nu]
low = 0.2
high = 0.48
[effects.viscoelasticity.g]
low = 0.0
high = 0.8
value = 0.3
prior = {mean = 0.3, sd = 0.05}
[effects.viscoelasticity.tau_s]
value = 1
[effects.deflection_offset.offset_um]
value = 20.0
[provenance]
data = {"d6 ramp.csv" = "sha256:12"}
versions = {skinlab = "0.1.0"}
verdict = "named"
date = "2026-11-21"
based_on = "sha256:00"
"""


def written(tmp_path, text):
    path = tmp_path / "MODEL.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_whole_file(tmp_path):
    model = read_model(written(tmp_path, WHOLE))
    assert model.model == Header("forearm", "extended_neo_hookean", "consistent")
    assert model.values == {
        "deflection_offset": {"offset_um": 20.0},
        "viscoelasticity": {"g": 0.3, "tau_s": 1.0, "g2": 0.0, "tau2_s": 10.0},
    }
    assert model.bounds("X1_MPa") == (0.005, 0.2)
    assert model.bounds("X2_MPa") == BASE.bounds("X2_MPa")
    assert model.bounds("viscoelasticity.g") == (0.0, 0.8)
    assert model.bounds("viscoelasticity.tau_s") == (0.01, 1000.0)
    assert model.effects["viscoelasticity"]["g"].prior == Normal(0.3, 0.05)
    with pytest.raises(InputError, match=r"has no parameter tape_slip\.slip_mm"):
        model.bounds("tape_slip.slip_mm")
    again = read_model(written(tmp_path, model.to_toml()))
    assert again == model
    assert again.hash == model.hash


def test_the_hash_is_of_what_the_model_says():
    one = Model(Header("a"), {"nu": Range(0.2, 0.4)})
    assert one.hash.startswith("sha256:")
    assert one.hash != Model(Header("a"), {"nu": Range(0.2, 0.41)}).hash
    assert one.hash != BASE.hash
    value = {"tape_slip": {"slip_mm": EffectRange(0.1)}}
    assert Model(Header("a"), effects=value).hash != Model(Header("a")).hash


def test_names_that_need_quoting_survive(tmp_path):
    model = Model(Header('a "b" \\ ü\n'))
    assert read_model(written(tmp_path, model.to_toml())) == model


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('name = "forearm"', "", "model: .*name"),
        ('name = "forearm"', 'name = " "', "model.name is empty"),
        ("[model]", "[modell]", "modell|model"),
        ('"consistent"', '"other"', "model.kappa"),
        ('"extended_neo_hookean"', '"rubber"', "law 'rubber' is not known"),
        (
            '"extended_neo_hookean"',
            '"mooney_rivlin"',
            "X1_MPa is not known; .* one of: C10_MPa",
        ),
        (
            "[parameters.nu]",
            "[parameters.mu]",
            "parameters.mu is not known; .* one of: X1_MPa",
        ),
        ("high = 0.48", "high = 0.6", "parameters.nu.high is 0.6: expected 0 to 0.499"),
        ("high = 0.48", "high = 0.1", "parameters.nu: low 0.2 is not below high 0.1"),
        ("low = 0.005", "low = nan", "parameters.X1_MPa.low is nan"),
        ("low = 0.005", "lo = 0.005", "parameters.X1_MPa: .*`lo`"),
        ("effects.viscoelasticity", "effects.elasticity", "effects.elasticity is not known"),
        ("tau_s]", "tau]", "effects.viscoelasticity.tau is not known; expected one of: g, tau_s"),
        ("value = 0.3", "value = 0.9", "effects.viscoelasticity.g.value is 0.9: expected 0 to 0.8"),
        (
            "value = 0.3",
            "value = 'x'",
            "effects.viscoelasticity.g.value: expected a number, got a text",
        ),
        ("value = 0.3", "", "effects.viscoelasticity.g: .*`value` is missing"),
        (
            "[provenance]",
            "[effects.viscoelasticity.g2]\nvalue = 0.8\n[provenance]",
            "effects.viscoelasticity: the shares g of the stress that relaxes: expected a",
        ),
        ("high = 0.8", "high = 1.8", "effects.viscoelasticity.g.high is 1.8: expected 0 to 0.9"),
        ("sd = 0.05", "sd = 0", "effects.viscoelasticity.g.prior: .*positive sd"),
        (
            '"log-uniform"',
            '"flat"',
            "parameters.X1_MPa.prior: 'flat' is not known; expected uniform, log-uniform",
        ),
        ('"named"', "1", "provenance.verdict: expected a text"),
        ("[provenance]", "[effects]\nslip = 3\n[provenance]", "effects.slip: expected a table"),
        ("[provenance]", "[provenance", "line|Invalid|Expected"),
    ],
)
def test_what_is_wrong_is_told_with_file_and_field(tmp_path, old, new, match):
    assert old in WHOLE
    path = written(tmp_path, WHOLE.replace(old, new))
    with pytest.raises(InputError, match=match) as caught:
        read_model(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_model(tmp_path / "none.toml")
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"binary\.toml"):
        read_model(path)


FORWARD = [
    *("forward", "--x1-mpa", "0.03", "--x2-mpa", "1", "--nu", "0.32", "--aperture-mm", "6"),
    *("--thickness-mm", "1", "--program", "ramp:40@40,hold:1,ramp:0@40"),
]


def forward(capsys, *more):
    status = run([*FORWARD, *map(str, more)])
    out, err = capsys.readouterr()
    return status, out, err


def columns(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    return tuple(
        np.array([float(row[name]) for row in rows])
        for name in ("time_s", "pressure_mbar", "deflection_mm")
    )


def test_forward_with_physical_effects_needs_no_direct(capsys, tmp_path):
    path = written(tmp_path, WHOLE)
    status, out, _ = forward(capsys, "--model", path)
    assert status == 0
    time, pressure, deflection = columns(out)
    program = parse_program("ramp:40@40,hold:1,ramp:0@40")
    np.testing.assert_allclose(pressure, program.pressure_mbar(time), atol=1e-4)
    expected = response(
        Skin((0.03, 1.0, 0.32), "consistent"), read_model(path).values, Geometry(6.0, 1.0),
        PressurePath.of_program(program), time,
    )  # fmt: skip
    np.testing.assert_allclose(deflection, expected.deflection_mm, atol=2e-6)
    assert deflection[0] == pytest.approx(0.02)


def test_forward_with_sensor_effects_asks_the_database_or_the_finite_elements(capsys, tmp_path):
    path = written(
        tmp_path,
        '[model]\nname = "sensor"\n[effects.pressure_lag.lag_s]\nvalue = 0.1\n'
        "[effects.deflection_gain.gain]\nvalue = 1.1\n",
    )
    table, direct, plain = (
        columns(forward(capsys, *more)[1])[2]
        for more in (("--model", path), ("--model", path, "--direct"), ())
    )
    np.testing.assert_allclose(table, direct, atol=2e-4)
    np.testing.assert_allclose(table[2:], 1.1 * plain[:-2], atol=1e-6)


def test_forward_takes_the_cycle(capsys, tmp_path):
    path = written(
        tmp_path, '[model]\nname = "m"\n[effects.preconditioning.softening]\nvalue = 0.2\n'
    )
    first, second, plain = (
        columns(forward(capsys, "--direct", *more)[1])[2].max()
        for more in (("--model", path), ("--model", path, "--cycle", 2), ())
    )
    assert first == plain
    assert second > 1.05 * first


def test_forward_refuses_what_contradicts(capsys, tmp_path):
    path = written(tmp_path, WHOLE)
    status, out, err = forward(capsys, "--model", path, "--kappa", "paper")
    assert (status, out) == (3, "")
    assert "kappa is 'consistent', and 'paper' was asked for" in err
    status, out, err = forward(capsys, "--model", tmp_path / "none.toml")
    assert (status, out) == (3, "")
    assert err.count("\n") == 1
    assert "none.toml: No such file" in err
    status, _, err = forward(capsys, "--cycle", 0)
    assert status == 3
    assert "cycle" in err


# ---- effects of plugins -------------------------------------------------------------------------

LEAK = """
[model]
name = "forearm with seal_leak"
[effects.seal_leak.leak_mbar]
value = 3.0
[provenance.versions]
skinlab = "0.2.0"
"plugin sealed" = "0.1.0 27ab12cd34ef"
"""


class SealLeak(Effect):
    name = "seal_leak"
    meaning = "the seal leaks"
    formula = "p − leak"
    source = "a test"
    physical = False
    parameters = (Parameter("leak_mbar", "mbar", "what is lost", 0.0, 8.0, 0.0, 1.5, "a test"),)


@pytest.fixture
def installed(monkeypatch):
    """Have an effect seal_leak of a package, in a state of its source files."""

    def install(package, stated):
        monkeypatch.setattr("skinlab.versions.installed", lambda: {package: stated})
        origins = {"seal_leak": Origin(package, stated.partition(" ")[0])}
        monkeypatch.setattr(EFFECTS, "origin", origins.get)

    with EFFECTS.lent(SealLeak()):
        yield install


def test_an_effect_of_the_same_plugin_is_the_one_that_was_adopted(tmp_path, installed, capsys):
    installed("sealed", "0.1.0 27ab12cd34ef")
    model = read_model(written(tmp_path, LEAK))
    assert model.differs == ""
    known = {"plugin sealed": "0.1.0 27ab12cd34ef"}
    assert plugins_of(model.model.law, ["deflection_offset", *model.effects]) == known
    hand_written = LEAK.partition("[provenance")[0]
    installed("another", "0.1.0 00ab12cd34ef")
    read_model(written(tmp_path, hand_written))
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("package", "stated", "here"),
    [
        ("another", "0.1.0 99ab12cd34ef", "another 0.1.0 (source files 99ab12cd34ef)"),
        ("sealed", "0.1.0 88ab12cd34ef", "sealed 0.1.0 (source files 88ab12cd34ef)"),
    ],
)
def test_an_effect_of_another_plugin_is_told(tmp_path, installed, capsys, package, stated, here):
    """Another formula of the same name had been used in silence."""
    installed(package, stated)
    path = written(tmp_path, LEAK)
    model = read_model(path)
    assert capsys.readouterr().err == (
        f"skinlab: {path}: effects.seal_leak was of plugin sealed 0.1.0 (source files "
        f"27ab12cd34ef) when the model was adopted, and is of plugin {here} here: what the model "
        "says of it may not hold\n"
    )
    assert model.values == {"seal_leak": {"leak_mbar": 3.0}}
    with pytest.raises(InputError, match=r"leak_um is not known; .* is of plugin"):
        read_model(written(tmp_path, LEAK.replace("leak_mbar", "leak_um")))


def test_an_effect_of_a_plugin_that_is_gone_is_told_with_the_plugin(tmp_path):
    path = written(tmp_path, LEAK)
    with pytest.raises(InputError) as told:
        read_model(path)
    assert str(told.value) == (
        f"{path}: effects.seal_leak is not known: the model was adopted with the plugin sealed "
        "0.1.0, which is not installed here"
    )


TABLE = {"plugin sealed": "0.1.0 27ab12cd34ef", "plugin unrelated": "2.0 00ab12cd34ef"}


def test_a_table_of_another_state_of_a_plugin_is_told(installed, capsys):
    """It answered by the formula that it was built with, in silence."""
    installed("sealed", "0.1.0 27ab12cd34ef")
    warn_of_table("t.h5", BASE.model.law, ["seal_leak"], TABLE)
    assert capsys.readouterr().err == ""
    installed("sealed", "0.2.0 88ab12cd34ef")
    warn_of_table("t.h5", BASE.model.law, ["seal_leak"], TABLE)
    assert capsys.readouterr().err == (
        "skinlab: t.h5: effects.seal_leak was of plugin sealed 0.1.0 (source files 27ab12cd34ef) "
        "when the table was built, and is of plugin sealed 0.2.0 (source files 88ab12cd34ef) "
        "here: what the table says of it may not hold\n"
    )
    with pytest.raises(
        InputError, match=r"effects.gone is not known: the table was built with the"
    ):
        warn_of_table("t.h5", BASE.model.law, ["gone"], TABLE)
