"""`skinlab identify` of campaigns: what is stated, what is not, and what answers together."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skinlab
from skinlab.cli.main import run
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import Geometry

RAMP = "ramp:100@20"
TRUTH = (0.035, 1.2, 0.32)


def call(capsys, *arguments):
    status = run([str(a) for a in arguments])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


def lasting(rng, size_um, time_s, n=100):
    """Errors (n,) at 20 Hz that are correlated for about `time_s`."""
    decay = np.exp(-0.05 / time_s)
    found = [size_um * rng.normal()]
    for _ in range(n - 1):
        found.append(decay * found[-1] + size_um * np.sqrt(1.0 - decay**2) * rng.normal())
    return np.array(found)


def campaign(folder, table, added_um, header="", cycles=None):
    """Write a campaign of ramps in 6 mm with these errors; return its file."""
    folder.mkdir()
    lines = [f'[campaign]\ntitle = "t"\n{header}\n']
    t = np.arange(len(added_um[0])) / 20.0
    for i, added in enumerate(added_um):
        cycle = 1 if cycles is None else cycles[i]
        p = 20.0 * t
        # A later cycle of a skin that is a fifth softer: W × 0.8.
        model = table.model(Geometry(6.0, 1.1), p * (1.0 if cycle == 1 else 1.25))
        w = model.deflection_mm(np.array([TRUTH]))[0]
        name = f"c{i}.csv"
        with (folder / name).open("w") as stream:
            write_curve(stream, Curve(name, Setup(6.0, 1.1), t, p, w + 1e-3 * added))
        lines.append(
            f'[[curve]]\nfile = "{name}"\naperture_mm = 6.0\nthickness_mm = 1.1\n'
            f'program = "{RAMP}"\ncycle = {cycle}\n'
        )
    path = folder / "campaign.toml"
    path.write_text("".join(lines))
    return path


def test_what_repeats_show_is_no_statement(capsys, tmp_path, table):
    """It was taken for a stated noise, which errors that last contradict in every campaign."""
    rng = np.random.default_rng(3)
    added = [lasting(rng, 4.0, 0.3) + rng.normal(0.0, 1.0, 100) for _ in range(3)]
    path = campaign(tmp_path / "c", table, added)
    status, out, _ = call(capsys, "identify", path, "--joint", "--json")
    assert status == 0
    document = json.loads(out)
    for entry in (*document["curves"], document["joint"]):
        assert "correlated_noise" in entry["flags"]
        assert "stated_noise_contradicted" not in entry["flags"]
        assert "misfit_above_noise" not in entry["flags"]


def test_by_a_model_with_an_effect_of_cycles_all_of_them_answer(capsys, tmp_path, table):
    """Without later cycles nothing could be said of a softening."""
    rng = np.random.default_rng(4)
    added = [rng.normal(0.0, 1.0, 60) for _ in range(2)]
    path = campaign(tmp_path / "c", table, added, cycles=[1, 2])
    model = tmp_path / "m.toml"
    model.write_text(
        '[model]\nname = "m"\nlaw = "extended_neo_hookean"\nkappa = "paper"\n'
        "[effects.preconditioning.softening]\nvalue = 0.1\nlow = 0.0\nhigh = 0.5\n"
    )
    found = skinlab.identify_joint(skinlab.read_campaign(path), model=model, placement_scatter=0.0)
    joint = found.to_dict()["joint"]
    softening = joint["parameters"]["preconditioning.softening"]
    assert softening["low"] < 0.2 < softening["high"]
    assert softening["high"] - softening["low"] < 0.05
    assert len(joint["files"]) == 2
    _, out, err = call(capsys, "identify", path, "--joint", "--json")
    assert "1 curve of later cycles left out" in err
    assert len(json.loads(out)["joint"]["files"]) == 1


def test_what_all_campaigns_state_is_used_and_else_it_is_said(capsys, tmp_path, table):
    """It was ignored without a word."""
    rng = np.random.default_rng(5)
    states = "noise_um = 10.0\nplacement_scatter = 0.0"
    one, two, other = [
        campaign(tmp_path / name, table, [rng.normal(0.0, 2.0, 100)], header)
        for name, header in (("a", states), ("b", states), ("c", ""))
    ]
    status, out, err = call(capsys, "identify", one, two, "--joint", "--json")
    assert (status, err) == (0, "")
    joint = json.loads(out)["joint"]
    assert "stated_noise_contradicted" in joint["flags"]
    assert joint["placement"] is None
    status, out, err = call(capsys, "identify", one, other, "--joint", "--json")
    assert status == 0
    assert err == (
        "skinlab: the files do not all state the same noise_um and placement_scatter: learned "
        "from all curves together\n"
    )
    joint = json.loads(out)["joint"]
    assert "stated_noise_contradicted" not in joint["flags"]
    assert joint["placement"]["count"] == 2
    said = ("--noise-um", "2", "--placement-scatter", "0")
    assert call(capsys, "identify", one, other, "--joint", *said)[2] == ""


def test_a_scatter_of_placements_is_of_curves_together(capsys, tmp_path, table):
    path = campaign(tmp_path / "c", table, [np.zeros(100)])
    status, out, err = call(capsys, "identify", path, "--placement-scatter", "0.05")
    assert (status, out) == (2, "")
    assert "--placement-scatter is for --joint" in err


def test_sessions_of_two_people_or_sites_are_no_one_skin(capsys, tmp_path, table):
    """They were one answer, without a word about who."""
    rng = np.random.default_rng(6)
    path = campaign(tmp_path / "c", table, [rng.normal(0.0, 2.0, 100) for _ in range(4)])
    files, told = [], (("P-1", "forearm"), ("P-2", "cheek"), ("P-1", "cheek"), ("P-1", ""))
    for i, (subject, site) in enumerate(told):
        files.append(tmp_path / f"s{i}.h5")
        who = ("--subject", subject, *(("--site", site) if site else ()))
        given = ("--aperture-mm", "6", "--thickness-mm", "1.1", "--out", files[i])
        assert call(capsys, "import", path.parent / f"c{i}.csv", *who, *given)[0] == 0
    arm, man, cheek, somewhere = files
    of_two = f"{arm} is of P-1 and {man} of P-2; expected curves of one person, as one skin is"
    of_sites = f"the sites differ ({arm} is of forearm and {cheek} of cheek); expected curves of"
    for other, says in ((man, of_two), (cheek, of_sites)):
        status, out, err = call(capsys, "identify", arm, other, "--joint", "--json")
        assert (status, out) == (3, "")
        assert err.startswith(f"skinlab: {says}")
        curves = [*skinlab.read_session(arm).curves, *skinlab.read_session(other).curves]
        with pytest.raises(InputError, match="expected curves of one"):
            skinlab.identify_joint(curves)
        with pytest.raises(InputError, match="expected curves of one"):
            skinlab.explain(skinlab.Campaign("two", None, None, tuple(curves)))
    assert call(capsys, "identify", arm, man)[0] == 0
    status, _, err = call(capsys, "identify", arm, somewhere, "--joint")
    assert (status, err) == (0, f"skinlab: Nobody stated the site of {somewhere}.\n")
