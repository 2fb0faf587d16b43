"""A database of one's own: built, interrupted, resumed, interpolated, identified with."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference.custom_table import with_custom_table
from skinlab.inference.identify import Identifier
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import SCREENING_MESH, Geometry
from skinlab.mechanics.model_file import EffectRange, Normal
from skinlab.tables.build import build, rebuilt_differences
from skinlab.tables.build_checkpoint import KeptRows
from skinlab.tables.forward import simulate_from
from skinlab.tables.parallel_build import How
from skinlab.tables.spec_file import read_spec
from skinlab.tables.store import read, write

GEOMETRY = Geometry(6.0, 1.0)


def axis(name, low, high, nodes, spacing="linear"):
    return f'[axis.{name}]\nlow = {low}\nhigh = {high}\nnodes = {nodes}\nspacing = "{spacing}"\n'


TENSION = '[model]\nname = "tension"\n[effects.natural_tension.stretch]\nvalue = 1.03\n'
TINY = (
    TENSION
    + axis("X1_MPa", 0.02, 0.05, 3, "log")
    + axis("X2_MPa", 0.5, 2.0, 3, "log")
    + axis("nu", 0.28, 0.36, 2)
    + axis("natural_tension.stretch", 1.0, 1.06, 3, "chebyshev")
    + '[pressures]\nhigh_mbar = 60\nnodes = 16\n[mesh]\nname = "screening-1"\n'
)
# For what only asks for the same bits: a coarse mesh, and corners alone.
CORNERS = (
    TENSION
    + axis("X1_MPa", 0.02, 0.05, 2, "log")
    + axis("X2_MPa", 0.5, 2.0, 2, "log")
    + axis("nu", 0.28, 0.36, 2)
    + axis("natural_tension.stretch", 1.0, 1.06, 2)
    + '[pressures]\nhigh_mbar = 30\nnodes = 8\n[mesh]\nname = "screening-1"\n'
)
RELAXING = (
    '[model]\nname = "relaxing"\n'
    "[effects.viscoelasticity.g]\nvalue = 0.3\n[effects.viscoelasticity.tau_s]\nvalue = 1.0\n"
    + axis("X1_MPa", 0.025, 0.035, 2, "log")
    + axis("X2_MPa", 0.8, 1.2, 2, "log")
    + axis("nu", 0.3, 0.34, 2)
    + axis("viscoelasticity.g", 0.25, 0.35, 2)
    + '[pressures]\nnodes = 16\n[measurement]\nprogram = "ramp:40@20,hold:2,ramp:0@20"\n'
    '[mesh]\nname = "screening-1"\n'
)


def spec_of(tmp_path, text, name="spec.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_spec(path)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """The tiny database, as its file."""
    folder = tmp_path_factory.mktemp("tiny")
    (folder / "tiny.toml").write_text(TINY, encoding="utf-8")
    path = folder / "tiny.h5"
    spec, out = str(folder / "tiny.toml"), str(path)
    assert run(["database", "build", "--spec", spec, "--out", out, "--workers", "1"]) == 0
    return path


@pytest.fixture(scope="module")
def corners(tmp_path_factory):
    """The spec of the corners, and its hash when nothing interrupts it."""
    spec = spec_of(tmp_path_factory.mktemp("corners"), CORNERS)
    return spec, build(spec).content_hash


@pytest.fixture(scope="module")
def relaxing(tmp_path_factory):
    return build(spec_of(tmp_path_factory.mktemp("relaxing"), RELAXING))


@pytest.fixture(scope="module")
def off_the_nodes():
    """A curve between all nodes of the tiny database, by finite elements."""
    return solved((0.032, 1.2, 0.31), 1.025)


def solved(skin, stretch, text="ramp:60@10"):
    """Return the curve of a stretched skin, by the finite elements of the tiny database."""
    program = parse_program(text)
    path = PressurePath.of_program(program)
    time_s = np.arange(round(20 * program.duration_s) + 1) / 20
    effects = {"natural_tension": {"stretch": stretch}}
    found = response(Skin(skin), effects, GEOMETRY, path, time_s, discretisation=SCREENING_MESH)
    return Curve("c", Setup(6.0, 1.0, program), time_s, path(time_s), found.deflection_mm)


def csv_of(tmp_path, curve):
    path = tmp_path / "curve.csv"
    rows = zip(curve.time_s, curve.pressure_mbar, curve.deflection_mm, strict=True)
    lines = [f"{t:.9g},{p:.9g},{w:.12g}" for t, p, w in rows]
    path.write_text("\n".join(["time_s,pressure_mbar,deflection_mm", *lines]) + "\n")
    return path


def test_its_file_says_what_it_is(tiny, capsys):
    database = read(tiny)
    assert database.spec.shape == (3, 3, 2, 3)
    assert not (tiny.parent / "tiny.h5.rows").exists()
    with h5py.File(tiny) as file:
        assert file["axes/natural_tension.stretch"][:].tolist() == pytest.approx([1.0, 1.03, 1.06])
        assert file["axes/X1_MPa"].attrs["unit"] == "MPa"
        assert file["deflection_mm"].shape == (3, 3, 2, 3, 16)
        assert file["deflection_mm"].attrs["unit"] == "mm"
        assert "skinlab" in json.loads(file.attrs["versions"])
    assert run(["database", "info", str(tiny)]) == 0
    said = capsys.readouterr().out
    for part in ("model 'tension'", "natural_tension.stretch", "54 curves", "between the nodes"):
        assert part in said
    assert run(["database", "verify", str(tiny), "--samples", "2"]) == 0


def test_a_changed_number_is_found(tiny, tmp_path, capsys):
    database = read(tiny)
    spoiled = dataclasses.replace(database, values=database.values + 1e-5)
    assert len(rebuilt_differences(spoiled, 1, 0)) == 1
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(tiny.read_bytes())
    with h5py.File(damaged, "r+") as file:
        file["deflection_mm"][0, 0, 0, 0, 0] += 1e-9
    with pytest.raises(InputError, match="does not agree with its hash"):
        read(damaged)
    assert run(["database", "verify", str(damaged)]) == 1
    assert "does not agree with its hash" in capsys.readouterr().err
    assert run(["database", "info", str(damaged)]) == 3


def test_nodes_are_the_finite_elements_own_curves(tiny):
    database = read(tiny)
    pressure = database.spec.abscissa.nodes[1:-1]
    path = PressurePath((0.0, 1.0), (0.0, 60.0))
    effects = {"natural_tension": {"stretch": 1.03}}
    skin = Skin((0.05, 0.5, 0.36))
    time_s = np.clip(pressure / 60, 0, 1)
    direct = response(
        skin, effects, GEOMETRY, path, time_s, pressure, discretisation=SCREENING_MESH
    )
    at = np.array([[0.05, 0.5, 0.36, 1.03]])
    stored = database.model(GEOMETRY, pressure).deflection_mm(at)[0]
    np.testing.assert_allclose(stored, direct.deflection_mm, rtol=0, atol=2e-6)


def test_slopes_are_those_of_the_curves(tiny):
    model = read(tiny).model(GEOMETRY, np.linspace(5, 60, 12))
    at, step = np.array([0.031, 1.1, 0.33, 1.02]), np.array([1e-6, 1e-5, 1e-6, 1e-6])
    slopes = model.coordinate_slopes(at[None])[0]
    moved = at + np.concatenate([np.diag(step), -np.diag(step)])
    found = model.coordinates(moved)
    by_difference = ((found[:4] - found[4:]) / (2 * step[:, None])).T
    np.testing.assert_allclose(slopes, by_difference, rtol=1e-5, atol=1e-5)


def test_identify_finds_the_skin_and_the_effect(tiny, off_the_nodes, tmp_path, capsys):
    truth = {"X1_MPa": 0.032, "X2_MPa": 1.2, "nu": 0.31, "natural_tension.stretch": 1.025}
    database = read(tiny)
    # Forward: within what the build found the interpolation to err by.
    base = {name: truth[name] for name in ("X1_MPa", "X2_MPa", "nu")}
    effects = {"natural_tension": {"stretch": 1.025}}
    between, _ = simulate_from(database, Skin(tuple(base.values())), effects, off_the_nodes.setup)
    off = np.abs(between.deflection_mm - off_the_nodes.deflection_mm).max()
    assert 0 < off <= 1.5 * np.abs(database.extra["interpolation_error"]).max()
    # And back: the intervals know of it.
    curve = csv_of(tmp_path, off_the_nodes)
    told = ["--aperture-mm", "6", "--thickness-mm", "1", "--database", str(tiny), "--json"]
    assert run(["identify", str(curve), *told]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["database"]["hash"] == database.content_hash
    assert said["model"]["effects"] == ["natural_tension"]
    assert said["model"]["hash"] == database.spec.model.hash
    (answer,) = said["curves"]
    assert answer["order"] == list(truth)
    assert answer["rms_um"] < 2.0
    identifier = with_custom_table(Identifier(database), database, phases_said=False)
    held = dict.fromkeys(truth, 0)
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(0.0, 0.002, len(off_the_nodes))
        noisy = dataclasses.replace(
            off_the_nodes, deflection_mm=off_the_nodes.deflection_mm + noise
        )
        for name, found in identifier(noisy).parameters.items():
            held[name] += found.low <= truth[name] <= found.high
    assert min(held.values()) >= 4, held


def test_intervals_know_that_a_coarse_table_is_wrong_between_its_nodes(tiny):
    database = read(tiny)
    identifier = with_custom_table(Identifier(database), database, phases_said=False)
    between = (
        ((0.027, 0.65, 0.33), 1.015),
        ((0.041, 1.6, 0.3), 1.045),
        ((0.032, 1.2, 0.31), 1.025),
    )
    held = []
    for truth, stretch in between:
        found = identifier(solved(truth, stretch)).parameters
        for name, value in zip(("X1_MPa", "X2_MPa", "nu"), truth, strict=True):
            held.append(found[name].low <= value <= found[name].high)
    assert sum(held) >= 8  # of nine intervals of 90 %; the table is off by up to 7 µm there


def test_a_models_prior_counts(tiny, off_the_nodes):
    """Four unknowns on one curve lie in a valley: what is known of the effect chooses in it."""
    built = read(tiny)
    for mean in (1.02, 1.03):
        at = EffectRange(1.03, prior=Normal(mean, 1e-4))
        model = msgspec.structs.replace(
            built.spec.model, effects={"natural_tension": {"stretch": at}}
        )
        spec = msgspec.structs.replace(built.spec, model=model)
        identifier = with_custom_table(
            Identifier(built, sensor=Sensor(3.0, 0.0)),
            dataclasses.replace(built, spec=spec),
            phases_said=False,
        )
        found = identifier(off_the_nodes).parameters["natural_tension.stretch"]
        assert found.low < mean < found.high
        assert found.value == pytest.approx(mean, abs=2e-4)
        assert found.high - found.low < 1e-3


def test_other_measurements_are_outside(tiny, off_the_nodes, tmp_path, capsys):
    curve = str(csv_of(tmp_path, off_the_nodes))
    own = ["identify", curve, "--database", str(tiny), "--aperture-mm"]
    for told, said in (
        (["8", "--thickness-mm", "1"], "aperture_mm 8, and this database holds for 6 only"),
        (["6", "--thickness-mm", "1.1"], "thickness_mm 1.1, and this database holds for 1 only"),
        (["6", "--thickness-mm", "1", "--thickness-sd-mm", "0.1"], "holds one thickness"),
    ):
        assert run([*own, *told, "--json"]) == 5
        shown = capsys.readouterr()
        assert said in shown.err
        assert json.loads(shown.out)["curves"][0]["flags"] == ["outside_database"]
    here = [*own, "6", "--thickness-mm", "1"]
    assert run([*here, "--kappa", "consistent"]) == 3
    other = tmp_path / "other.toml"
    other.write_text(TENSION.replace("1.03", "1.04"))
    assert run([*here, "--model", str(other)]) == 3
    assert "is another" in capsys.readouterr().err
    assert run([*here, "--advise"]) == 2
    forward = ["forward", "--x1-mpa", "0.06", "--x2-mpa", "1", "--nu", "0.3", "--aperture-mm", "6"]
    forward += ["--thickness-mm", "1", "--program", "ramp:60@20", "--database", str(tiny)]
    assert run(forward) == 3
    assert "X1_MPa 0.06 is outside the database (0.02–0.05)" in capsys.readouterr().err


def test_pressures_beyond_are_left_out_and_flagged(tiny, tmp_path, capsys):
    curve = solved((0.03, 1.0, 0.32), 1.02, "ramp:90@20")
    told = ["--aperture-mm", "6", "--thickness-mm", "1", "--database", str(tiny), "--json"]
    assert run(["identify", str(csv_of(tmp_path, curve)), *told]) == 0
    (answer,) = json.loads(capsys.readouterr().out)["curves"]
    assert "outside_database" in answer["flags"]
    assert answer["fitted_points"] < answer["points"]


def test_forward_says_that_the_database_ends_and_not_the_model(tiny):
    setup = Setup(6.0, 1.0, parse_program("ramp:90@20"))
    with_tension = {"natural_tension": {"stretch": 1.02}}
    curve, ends = simulate_from(read(tiny), Skin((0.03, 1.0, 0.32)), with_tension, setup)
    assert 60.0 <= curve.pressure_mbar[-1] < 62.0
    assert ends.endswith("the database holds to 61 mbar only; the curve ends there")


@pytest.mark.long
def test_two_processes_give_the_same_bits(corners):
    spec, whole = corners
    seen = []
    how = How(workers=2, progress=lambda done, total: seen.append((done, total)))
    assert build(spec, how).content_hash == whole
    assert [done for done, _ in seen] == list(range(1, seen[-1][1] + 1))


KILLED = """
import os, signal, sys
from pathlib import Path
from skinlab.tables.build import build
from skinlab.tables.parallel_build import How
from skinlab.tables.spec_file import read_spec

def progress(done, total):
    if done == 7:
        os.kill(os.getpid(), signal.SIGKILL)

build(read_spec(sys.argv[1]), How(keep=Path(sys.argv[2]), progress=progress))
"""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no disk that is full")
def test_rows_that_have_no_room_are_told_with_their_file(tmp_path):
    kept = tmp_path / "db.h5.rows"
    kept.symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"db.h5.rows: cannot be written \(No space left"):
        KeptRows(kept, "of", 3, resume=False)


def test_a_killed_build_goes_on_to_the_same_bits(corners, tmp_path, capsys):
    _, whole = corners
    spec_file, out, kept = (tmp_path / n for n in ("spec.toml", "db.h5", "db.h5.rows"))
    spec_file.write_text(CORNERS)
    killed = subprocess.run([sys.executable, "-c", KILLED, spec_file, kept], check=False)
    assert killed.returncode == -9
    assert not out.exists()
    # What the kill might have cut: the last row.
    kept.write_bytes(kept.read_bytes()[:-5])
    told = ["database", "build", "--spec", str(spec_file), "--out", str(out), "--workers", "1"]
    assert run(told) == 3
    assert "--resume goes on" in capsys.readouterr().err
    other = tmp_path / "other.toml"
    other.write_text(CORNERS.replace("high_mbar = 30", "high_mbar = 31"))
    assert run([*told[:3], str(other), *told[4:], "--resume"]) == 3
    assert "rows of another build" in capsys.readouterr().err
    seen = []
    how = How(keep=kept, resume=True, progress=lambda done, total: seen.append(done))
    resumed = build(read_spec(spec_file), how)
    assert seen[0] == 6  # rows that were there, less the torn one
    assert resumed.content_hash == whole
    # All rows are kept until the file is written: now nothing is left to compute.
    assert run([*told, "--resume"]) == 0
    shown = capsys.readouterr()
    assert whole in shown.out
    assert "%" not in shown.err  # no progress bar in a pipe
    assert not kept.exists()
    assert run(told) == 3
    assert "db.h5: exists already; --force replaces it" in capsys.readouterr().err
    out.write_text("another one")
    assert run([*told, "--force"]) == 0
    assert whole in capsys.readouterr().out
    assert read(out).content_hash == whole


def test_a_damaged_row_and_all_after_it_are_computed_again(tmp_path):
    path = tmp_path / "rows"
    rows = np.arange(12.0).reshape(4, 3)
    with KeptRows(path, "this", 3, resume=False) as kept:
        for entry, row in enumerate(rows):
            kept.add(entry, row)
    raw = bytearray(path.read_bytes())
    raw[-2 * (8 + 24 + 16) + 10] ^= 1  # in the third row
    path.write_bytes(raw)
    with KeptRows(path, "this", 3, resume=True) as kept:
        found = list(kept.found())
        assert [entry for entry, _ in found] == [0, 1]
        np.testing.assert_array_equal([row for _, row in found], rows[:2])
        kept.add(2, rows[2])
    with KeptRows(path, "this", 3, resume=True) as kept:
        assert [entry for entry, _ in kept.found()] == [0, 1, 2]
    with KeptRows(tmp_path / "none", "this", 3, resume=True) as kept:
        assert list(kept.found()) == []
    assert not (tmp_path / "none").exists()  # nothing was computed: nothing is left behind


def test_where_a_skin_creases_it_goes_on_and_says_so(tmp_path):
    text = (
        TENSION
        + axis("X1_MPa", 0.01, 0.05, 2, "log")
        + axis("X2_MPa", 0.1, 2.0, 2, "log")
        + axis("nu", 0.2, 0.3, 2)
        + '[pressures]\nhigh_mbar = 100\nnodes = 11\n[mesh]\nname = "screening-1"\n'
    )
    database = build(spec_of(tmp_path, text))
    soft, stiff = database.holds_to[0, 0], database.holds_to[1, 1]
    assert (soft < 100).all()
    assert (stiff >= 100).all()
    assert np.isfinite(database.values).all()
    at = np.array([[0.012, 0.12, 0.25]])
    to_the_top = database.model(GEOMETRY, np.linspace(0, 100, 11))
    assert to_the_top.creases(at)[0]
    assert np.isfinite(to_the_top.deflection_mm(at)).all()
    assert (np.diff(to_the_top.deflection_mm(at)[0]) > 0).all()
    write(tmp_path / "own.h5", database)
    kept = read(tmp_path / "own.h5")
    assert kept.content_hash == database.content_hash
    again = kept.model(GEOMETRY, np.linspace(0, 100, 11)).deflection_mm(at)
    np.testing.assert_array_equal(again, to_the_top.deflection_mm(at))
    low = database.model(GEOMETRY, np.linspace(0, 0.9 * database.holds_to.min(), 11))
    assert np.isfinite(low.deflection_mm(at)).all()
    setup = Setup(6.0, 1.0, parse_program("ramp:100@20"))
    soft = Skin((0.012, 0.12, 0.25))
    curve, warning = simulate_from(database, soft, {}, setup)
    assert curve.pressure_mbar[-1] == 100.0
    assert warning.startswith("crease: ")


def relaxed_curve(spec, skin, g, off_mbar=0.0):
    program = spec.program
    time = np.arange(0.0, program.duration_s + 1e-9, 0.05)
    path = PressurePath.of_program(program)
    pressure = path(time) + off_mbar
    effects = {"viscoelasticity": {"g": g, "tau_s": 1.0}}
    found = response(
        skin, effects, GEOMETRY, path, time, pressure, discretisation=spec.discretisation
    )
    return time, pressure, found.deflection_mm


@pytest.mark.long
def test_a_database_with_memory_holds_along_its_program(relaxing):
    spec = relaxing.spec
    corner = Skin((0.035, 0.8, 0.34))
    for off_mbar, allowed_mm in ((0.0, 2e-4), (0.5, 3e-4)):  # 16 nodes up, 12 along the hold
        time, pressure, direct = relaxed_curve(spec, corner, 0.35, off_mbar)
        model = relaxing.model(GEOMETRY, pressure, time_s=time)
        found = model.deflection_mm(np.array([[0.035, 0.8, 0.34, 0.35]]))[0]
        inside = np.isfinite(direct)
        assert inside.sum() > 0.9 * len(time)
        np.testing.assert_allclose(found[inside], direct[inside], rtol=0, atol=allowed_mm)
    with pytest.raises(NotTrustworthyError, match="needs times"):
        relaxing.model(GEOMETRY, pressure)


@pytest.mark.long
def test_memory_is_identified_from_the_whole_curve(relaxing, tmp_path, capsys):
    time, pressure, deflection = relaxed_curve(relaxing.spec, Skin((0.03, 1.0, 0.32)), 0.29)
    curve = Curve("c", Setup(6.0, 1.0), time, pressure, deflection)
    path = tmp_path / "relaxing.h5"
    write(path, relaxing)
    told = ["--aperture-mm", "6", "--thickness-mm", "1", "--database", str(path), "--json"]
    assert run(["identify", str(csv_of(tmp_path, curve)), *told]) == 0
    (answer,) = json.loads(capsys.readouterr().out)["curves"]
    assert answer["fitted_points"] == len(curve)
    found = answer["parameters"]["viscoelasticity.g"]
    assert found["low"] <= 0.29 <= found["high"]
    assert found["value"] == pytest.approx(0.29, abs=0.01)


def test_a_curve_of_another_program_or_cycle_is_outside(relaxing):
    time = np.linspace(0, 8, 81)
    slow = Curve("slow", Setup(6.0, 1.0), time, 5.0 * time, 0.1 * time)
    with pytest.raises(NotTrustworthyError, match=r"does not follow the database's program ramp"):
        relaxing.covers(slow)
    time, pressure, deflection = relaxed_curve(relaxing.spec, Skin((0.03, 1.0, 0.32)), 0.29)
    second = Curve("second", Setup(6.0, 1.0, cycle=2), time, pressure, deflection)
    with pytest.raises(NotTrustworthyError, match="holds for cycle 1 only"):
        relaxing.covers(second)
    left = pressure.copy()
    left[60:70] += 10.0  # what the skin remembers from then on is another program
    strayed = Curve("strayed", Setup(6.0, 1.0), time, left, deflection)
    assert relaxing.covers(strayed).tolist() == [True] * 60 + [False] * (len(time) - 60)
    left = pressure.copy()
    left[60] += 10.0  # one wild reading is only itself left out
    assert relaxing.covers(Curve("wild", Setup(6.0, 1.0), time, left, deflection)).sum() == (
        len(time) - 1
    )


def test_dask_that_is_not_there_is_one_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    spec_file, out = tmp_path / "spec.toml", tmp_path / "db.h5"
    spec_file.write_text(CORNERS)
    build = ["database", "build", "--spec", str(spec_file), "--out", str(out)]
    assert run([*build, "--dask", "tcp://127.0.0.1:8786"]) == 3
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("skinlab: --dask needs dask.distributed, which is not installed: pip")
    assert list(tmp_path.iterdir()) == [spec_file]


@pytest.mark.filterwarnings("ignore")  # dask's own
def test_a_dask_cluster_gives_the_same_bits(corners):
    distributed = pytest.importorskip("distributed")
    spec, whole = corners
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        assert build(spec, How(dask=cluster.scheduler_address)).content_hash == whole


def test_a_build_does_not_go_on_with_another_state_of_a_plugin(tmp_path, monkeypatch):
    """The table would have been of two formulas."""
    spec, kept = spec_of(tmp_path, CORNERS), tmp_path / "t.h5.rows"

    def stop(done, total):
        raise KeyboardInterrupt

    def build_with(state, **how):
        monkeypatch.setattr("skinlab.tables.build.versions", lambda: {"plugin sealed": state})
        return build(spec, How(keep=kept, **how))

    with pytest.raises(KeyboardInterrupt):
        build_with("0.1.0 27ab12cd34ef", progress=stop)
    with pytest.raises(InputError, match="rows of another build"):
        build_with("0.1.0 88ab12cd34ef", resume=True)
