"""The command line in process: output, exit status, and one sentence for bad input."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest

from drivers.reading import read_whole
from skinlab import workers
from skinlab.cli.main import _COMMANDS, cli, run
from skinlab.cli.method_options import MethodCommand
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import METHODS, get_method, method_names
from skinlab.inference.methods.base import Method, Option
from skinlab.mechanics.effects import EFFECTS
from skinlab.mechanics.effects.base import Effect, Parameter
from skinlab.quality.gates import all_gates
from skinlab.recording.session import read_session

ROOT = Path(__file__).parents[3]
CSV = "time_s,pressure_mbar,deflection_mm\n"
SKIN = ["--aperture-mm", "6", "--thickness-mm", "1"]
FORWARD = ["forward", "--x1-mpa", "0.03", "--x2-mpa", "1", "--nu", "0.32", *SKIN]
RAMP = ["--program", "ramp:100@20"]


def call(capsys, *arguments):
    status = run([str(a) for a in arguments])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


@pytest.fixture
def curve_csv(tmp_path, capsys) -> Path:
    path = tmp_path / "c.csv"
    assert run([*FORWARD, *RAMP, "--csv", str(path)]) == 0
    capsys.readouterr()
    return path


def test_forward_prints_a_curve_that_identify_reads(capsys, tmp_path):
    status, out, err = call(capsys, *FORWARD, *RAMP, "--direct")
    assert (status, err) == (0, "")
    rows = np.array([line.split(",") for line in out.splitlines()[1:]], dtype=float)
    assert out.startswith(CSV)
    assert rows.shape == (101, 3)
    assert rows[-1, :2].tolist() == [5.0, 100.0]
    path = tmp_path / "c.csv"
    path.write_text(out)
    status, out, err = call(capsys, "identify", path, *SKIN, "--json")
    assert (status, err) == (0, "")
    (entry,) = json.loads(out)["curves"]
    assert entry["parameters"]["X1_MPa"]["value"] == pytest.approx(0.03, rel=0.01)


def test_what_an_effect_prints_is_no_line_of_a_simulated_curve(capsys, tmp_path):
    class Loud(Effect):
        name = meaning = formula = source = "loud"
        physical = False
        parameters = (Parameter("size_um", "µm", "a size", 0.0, 9.0, 0.0, 1.0, "s"),)

        def read(self, since_s, deflection_mm, values):
            print("found")  # noqa: T201 -- as a plugin may
            return deflection_mm

    model = tmp_path / "m.toml"
    model.write_text('[model]\nname = "m"\n[effects.loud.size_um]\nvalue = 1.0\n')
    plain = call(capsys, *FORWARD, *RAMP)
    with EFFECTS.lent(Loud()):
        status, out, err = call(capsys, *FORWARD, *RAMP, "--model", model)
    assert (status, out) == plain[:2]
    assert set(err.splitlines()) == {"found"}


def test_a_method_takes_no_command_its_help(capsys):
    method = Method("mine", get_method("lm").search, "as lm", (Option("help", 1, "of mine"),))
    with METHODS.lent(method):
        others = [click.Option(["--seed"])]
        flags = {
            flag for option in MethodCommand("c", params=others).params for flag in option.opts
        }
    assert "--slowdown" in flags
    assert "--help" not in flags
    assert (
        "method 'mine': its option --help is the command's; expected another"
        in capsys.readouterr().err
    )


def test_a_simulated_curve_replaces_a_file_only_by_force(capsys, curve_csv):
    before = curve_csv.read_bytes()
    other = [*FORWARD, "--program", "ramp:50@20", "--csv", curve_csv]
    status, _, err = call(capsys, *other)
    assert status == 3
    assert "exists already; --force replaces it" in err
    assert curve_csv.read_bytes() == before
    assert call(capsys, *other, "--force")[0] == 0
    assert curve_csv.read_bytes() != before


def test_database_and_finite_elements_agree_between_nodes(capsys):
    arguments = ["forward", "--x1-mpa", "0.0345", "--x2-mpa", "1.234", "--nu", "0.333"]
    arguments += [*SKIN, *RAMP]
    curves = []
    for direct in ([], ["--direct"]):
        status, out, _ = call(capsys, *arguments, *direct)
        assert status == 0
        rows = [line.split(",") for line in out.splitlines()[1:]]
        curves.append(np.array(rows, dtype=float)[:, 2])
    assert np.abs(curves[0] - curves[1]).max() < 5e-4  # half a µm


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (["forward"], 2, "Missing option"),
        (["nonsense"], 2, "No such command"),
        (["identify"], 2, "Missing argument"),
        (["identify", "x.csv"], 2, "--aperture-mm"),
        (["identify", "x.csv", *SKIN, "--method", "magic"], 2, "magic"),
        (["identify", "x.csv", *SKIN, "--phases", "lunch"], 2, "lunch"),
        (["identify", "x.csv", *SKIN, "--best", "1"], 3, "best 1: expected 2"),
        (["identify", "absent.csv", *SKIN], 3, "absent.csv: no such file"),
        (["identify", "absent.h5"], 3, "absent.h5: no such file"),
        (["identify", "."], 3, ".: a folder without a campaign.toml, which names its curves"),
        (["identify", ".", *SKIN], 2, "name its curves one by one"),
        (["discrepancy", "."], 3, ".: a folder without a campaign.toml, which names its curves"),
        ([*FORWARD, "--program", "ramp:900@20"], 3, "0–500 mbar"),
        ([*FORWARD[:-1], "0", *RAMP], 3, "expected 0.1–10 mm"),
        ([*FORWARD, *RAMP, "--nu", "0.6"], 3, "nu is 0.6: expected 0 to 0.49999"),
        ([*FORWARD, *RAMP, "--nu", "0.5"], 3, "nu is 0.5: expected 0 to 0.49999"),
        ([*FORWARD, *RAMP, "--x1-mpa", "-1"], 3, "X1_MPa is -1: expected 0.001 to 100 MPa"),
        ([*FORWARD, *RAMP, "--x1-mpa", "nan"], 3, "X1_MPa is nan: expected 0.001 to 100 MPa"),
        ([*FORWARD, *RAMP, "--x1-mpa", "90"], 3, "X1_MPa 90 is outside the database"),
        ([*FORWARD, *RAMP, "--aperture-mm", "5"], 3, "no probe has this opening"),
        (["replay", "absent.h5"], 3, "absent.h5: no such file"),
        (["recover", "absent.journal"], 3, "absent.journal: no such file"),
        (["recover", os.devnull], 3, "a device; expected a file"),
        (["recover", "absent.journal", "--out", "s"], 3, "s: expected a name that ends with .h5"),
        (["measure", "--port", "sim://", *SKIN, *RAMP, "--out", "s"], 3, "ends with .h5"),
        (["database", "info", "absent.h5"], 3, "absent.h5: no such file"),
        (["database", "verify", "--samples", "0"], 3, "samples 0"),
        (
            ["measure", "--port", "/dev/absent", *SKIN, *RAMP, "--out", "s.h5"],
            4,
            "/dev/absent",
        ),
        (
            ["measure", "--port", "sim://?skin=absent.toml", *SKIN, *RAMP, "--out", "s.h5"],
            3,
            "absent.toml",
        ),
        (["measure", "--port", "sim://", *SKIN, "--program", "x", "--out", "s.h5"], 3, "segment"),
        (["measure", "--port", "sim://?seed=x", *SKIN, *RAMP, "--out", "s.h5"], 2, "whole number"),
        (["measure", "--port", "socket://", *SKIN, *RAMP, "--out", "s.h5"], 2, "HOST:PORT"),
        (["measure", "--port", "no://x", *SKIN, *RAMP, "--out", "s.h5"], 2, "not known"),
        (
            ["measure", "--port", "/dev/x", *SKIN, *RAMP, "--phases", "rest,hold", "--out", "s.h5"],
            2,
            "ramp:100@20 has no rest,hold, so that nothing could be fitted; it has load",
        ),
        (["identify", "absent.h5", "--aperture-mm", "6"], 2, "sessions and campaigns state"),
        (["identify", ".", "--thickness-sd-mm", "0.1"], 2, "sessions and campaigns state"),
    ],
)
def test_bad_input_is_one_sentence_and_the_contracts_status(
    capsys, tmp_path, monkeypatch, arguments, status, says
):
    monkeypatch.chdir(tmp_path)
    got, out, err = call(capsys, *arguments)
    assert got == status
    assert says in err
    assert out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time_s,pressure_mbar\n0,0\n", "missing column deflection_mm"),
        (CSV + "0,0,nan\n", "line 2: deflection_mm is nan"),
        (CSV + "0,0,0,0,0,1\n", "is the decimal sign a comma?"),
        ("", "missing column"),
    ],
)
def test_bad_curves_name_the_line(capsys, tmp_path, text, says):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    status, _, err = call(capsys, "identify", path, *SKIN)
    assert status == 3
    assert says in err
    assert len(err.strip().splitlines()) == 1


def test_the_good_inputs_are_done_and_the_bad_ones_named(capsys, tmp_path, curve_csv):
    bad = tmp_path / "bad.csv"
    bad.write_text(CSV + "0,0,nan\n")
    status, out, err = call(capsys, "identify", bad, curve_csv, *SKIN, "--json")
    assert status == 3
    first, second = json.loads(out)["curves"]
    assert "deflection_mm is nan" in first["error"]
    assert first["parameters"] is None
    assert second["error"] is None
    assert second["parameters"]["nu"]["value"] == pytest.approx(0.32, abs=0.01)
    assert "deflection_mm is nan" in err


def test_what_may_not_be_read_is_bad_input_and_not_usage(capsys, tmp_path, curve_csv, monkeypatch):
    locked = tmp_path / "locked.csv"
    locked.write_text(CSV)
    really = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != str(locked) and really(path, mode))
    status, out, _ = call(capsys, "identify", locked, curve_csv, *SKIN, "--json")
    assert status == 3  # of the owner; root reads it all the same, and has no samples
    assert [c["error"] is None for c in json.loads(out)["curves"]] == [False, True]
    for command in all_commands():
        for parameter in command.params:
            assert not getattr(parameter.type, "readable", False), (command.name, parameter.name)


@pytest.mark.parametrize("ending", [".csv", ".h5", ".toml"])
def test_a_name_that_is_too_long_is_bad_input_like_any_other(capsys, curve_csv, ending):
    long = curve_csv.with_name("x" * 300 + ending)
    status, out, err = call(capsys, "identify", long, curve_csv, *SKIN, "--json")
    assert status == 3
    first, second = json.loads(out)["curves"]
    assert first["error"].startswith(f"{long}: ")
    assert second["parameters"] is not None
    assert f"{long}: " in err


def test_a_truncated_session_is_bad_input(capsys, tmp_path):
    path = tmp_path / "cut.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(200))
    for command in (["identify"], ["replay"], ["session", "verify"], ["database", "info"]):
        status, out, err = call(capsys, *command, path)
        assert (status, out) == (3, "")
        assert str(path) in err


def test_sto_takes_the_papers_arguments(capsys, curve_csv):
    results = []
    for seed in (1, 1, 2):
        arguments = ["--method", "sto", "--samples", 500, "--best", 10, "--seed", seed]
        status, out, _ = call(capsys, "identify", curve_csv, *SKIN, *arguments, "--json")
        assert status == 0
        document = json.loads(out)
        assert (document["method"], document["seed"]) == ("sto", seed)
        (entry,) = document["curves"]
        assert entry["evaluations"] == 500 * entry["iterations"]
        results.append(entry["parameters"])
    assert results[0] == results[1] != results[2]


def test_a_campaign_can_be_given(capsys, tmp_path, curve_csv):
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\ntitle = "t"\n[[curve]]\nfile = "c.csv"\naperture_mm = 6.0\n'
        'thickness_mm = 1.0\nprogram = "ramp:100@20"\n'
    )
    for name in (tmp_path, tmp_path / "campaign.toml"):
        status, out, _ = call(capsys, "identify", name)
        assert status == 0
        assert "X1" in out


def test_the_gates_that_a_file_fails_are_flags(capsys, tmp_path, curve_csv):
    """A sensor at the end of its range was a misfit at most, and lost samples were nothing."""
    head, *rows = curve_csv.read_text().splitlines()
    values = np.array([[float(x) for x in row.split(",")] for row in rows])
    stuck, gap = values.copy(), np.delete(values, slice(20, 30), axis=0)
    stuck[:, 2] = np.minimum(stuck[:, 2], 0.6 * stuck[:, 2].max())
    files = [curve_csv]
    for name, changed in (("stuck", stuck), ("gap", gap)):
        files.append(tmp_path / f"{name}.csv")
        lines = [",".join(str(x) for x in row) for row in changed.tolist()]
        files[-1].write_text("\n".join([head, *lines]) + "\n")
    status, out, _ = call(capsys, "identify", *files, *SKIN, "--json")
    good, stopped, lost = ({*one["flags"]} for one in json.loads(out)["curves"])
    gates = {gate.name for gate in all_gates()}
    assert status == 0
    assert not good & gates
    assert stopped & gates == {"frozen", "saturated"}
    assert lost & gates == {"time_gaps"}


def test_the_good_curves_of_a_campaign_are_done(capsys, tmp_path, curve_csv):
    """One wrong line cost the answers of all its other curves."""
    bad = tmp_path / "bad.csv"
    bad.write_text(curve_csv.read_text().replace("\n", "\nx,", 1))
    files = [curve_csv.name, bad.name, "absent.csv"]
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\ntitle = "t"\n'
        + "".join(
            f'[[curve]]\nfile = "{file}"\naperture_mm = 6.0\nthickness_mm = 1.0\n' for file in files
        )
    )
    status, out, err = call(capsys, "identify", tmp_path, "--json")
    assert status == 3
    good, *others = json.loads(out)["curves"]
    assert good["parameters"] is not None
    assert [one["file"] for one in others] == [str(bad), str(tmp_path / "absent.csv")]
    assert others[0]["error"].startswith(f"{bad}: line 2: ")
    assert f"{bad}: line 2: " in err
    # Together there is no answer without them.
    status, out, _ = call(capsys, "identify", tmp_path, "--joint", "--json")
    assert status == 3
    document = json.loads(out)
    assert document["joint"] is None
    assert [one["parameters"] for one in document["curves"]] == [None]


def test_database_commands(capsys):
    status, out, _ = call(capsys, "database", "info")
    assert status == 0
    assert "1360 curves" in out
    status, out, _ = call(capsys, "database", "verify", "--samples", 1)
    assert status == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes in folders")
def test_a_database_takes_the_place_of_no_device_or_pipe(capsys, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    status, out, err = call(capsys, "database", "build", "--out", tmp_path / "pipe")
    assert (status, out) == (3, "")
    assert "pipe: expected the name of a file to write" in err


@pytest.mark.parametrize("port", ["-1", "0", "65536"])
def test_a_tcp_port_that_is_none_is_wrong_usage(capsys, port):
    status, out, err = call(capsys, "ui", "--serve", "--serve-port", port)
    assert (status, out) == (2, "")
    assert "'--serve-port'" in err


def all_commands():
    context = cli.make_context("skinlab", ["--help"], resilient_parsing=True)
    for name in _COMMANDS:
        command = cli.get_command(context, name)
        yield from (getattr(command, "commands", None) or {name: command}).values()


@pytest.mark.parametrize(("workers", "status"), [("0", 3), ("-1", 3), ("1025", 3), ("two", 2)])
def test_a_number_of_processes_out_of_its_range_is_bad_input(capsys, tmp_path, workers, status):
    """It was wrong usage, where `--samples 0` and `--repeats 0` are bad input."""
    curve = ("curve.csv", "--aperture-mm", "6", "--thickness-mm", "1")
    for command in (
        ("identify", *curve), ("discrepancy", "campaign.toml"), ("paper",), ("database", "build"),
        ("study", tmp_path, "--out", tmp_path / "out"),
    ):  # fmt: skip
        found, out, err = call(capsys, *command, "--workers", workers)
        assert (found, out) == (status, "")
        assert status == 2 or err == f"skinlab: workers {workers}: expected 1–1024\n"


@pytest.mark.parametrize("seconds", ["nan", "-1"])
def test_a_capture_of_no_time_that_there_is_is_refused(tmp_path, capsys, seconds):
    out = tmp_path / "c.jsonl"
    assert run(["capture", "--port", "sim://", "--seconds", seconds, "--out", str(out)]) == 3
    assert f"seconds {seconds}: expected 0 or more" in capsys.readouterr().err
    assert not out.exists()


@pytest.fixture
def no_port(monkeypatch):
    """Opening a port fails the test: nothing may be said to an instrument."""

    def opened(*arguments, **named):
        raise AssertionError(arguments)

    monkeypatch.setattr("drivers.link.open_link", opened)
    monkeypatch.setattr("drivers.probe.Probe.open", opened)


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        ("capture --port COM3 --through tcp:x --out c", 2, "cannot open tcp:x"),
        ("capture --port COM3 --through tcp:70000 --out c", 2, "cannot open tcp:70000"),
        ("capture --port COM3 --dialect other.toml --out c", 3, "aperture_mm is 5"),
        ("capture --port COM3 --out taken/c", 3, "taken/c: cannot be written"),
        ("measure --port COM3 --dialect mine.toml --aperture-mm 4 {} --out s.h5", 3, "has 6 mm"),
        ("measure --port COM3 --dialect other.toml --aperture-mm 4 {} --out s.h5", 3, "is 5"),
        ("calibrate --port COM3 --dialect mine.toml --phantoms k --out p.toml", 2, "runs programs"),
    ],
)
def test_wrong_arguments_are_refused_before_the_port_is_opened(
    arguments, status, says, tmp_path, monkeypatch, capsys, no_port
):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "examples" / "dialects" / "plain_line.toml").read_text()
    for name, opening in (("mine", 6), ("other", 5)):
        stream = f"\n[stream]\naperture_mm = {opening}.0"
        Path(f"{name}.toml").write_text(text.replace("\n[stream]", stream))
    Path("taken").write_text("")
    rest = "--thickness-mm 1 --program ramp:50@20"
    found, _, err = call(capsys, *arguments.format(rest).split())
    assert (found, says in err) == (status, True), err
    assert {p.name for p in tmp_path.iterdir()} == {"mine.toml", "other.toml", "taken"}


def test_what_the_instrument_cannot_do_is_bad_input(tmp_path, capsys):
    """It was told as a probe that failed: 4."""
    out = ["--out", tmp_path / "s.h5"]
    done = call(capsys, "measure", "--port", "sim://", *SKIN, *RAMP, "--rate-hz", "5000", *out)
    assert (done[0], "outside 1 to 1000 Hz" in done[2]) == (3, True), done
    assert not list(tmp_path.iterdir())


def test_a_terminal_that_can_show_no_screen_is_a_sentence(monkeypatch, capsys):
    """The screen stayed half empty, and heard neither v nor Ctrl+C."""
    monkeypatch.delenv("TEXTUAL_DRIVER", raising=False)
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setattr("skinlab.cli.ui.has_screen", lambda: True)
    assert run(["ui", "--port", "sim://"]) == 3
    assert "TERM=dumb: expected a terminal that can show a screen" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "says"), [([], "in use"), (["--dose-limit-mbar-s", "-3"], "dose_limit_mbar_s -3")]
)
def test_no_address_is_printed_that_leads_nowhere(capsys, more, says):
    pytest.importorskip("textual_serve")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        assert run(["ui", "--serve", "--serve-port", port, *more]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err


def test_every_command_has_help_with_an_example():
    for command in all_commands():
        assert "Example: skinlab" in (command.help or ""), command.name


@pytest.mark.long
def test_every_method_can_be_asked_for(capsys, curve_csv):
    for method in method_names():
        status, out, _ = call(capsys, "identify", curve_csv, *SKIN, "--method", method, "--json")
        assert status == 0
        document = json.loads(out)
        assert document["method"] == method
        assert document["curves"][0]["error_um"] < 5


class TestOptionsOfSingleMethods:
    def identify(self, capsys, curve_csv, *arguments):
        return call(capsys, "identify", curve_csv, *SKIN, "--json", *arguments)

    @pytest.mark.parametrize(
        ("method", "option", "says"),
        [
            ("auto", ["--sampling", "lhs"], "--sampling belongs to --method sto"),
            ("hka", ["--confidence", "0.9"], "--confidence belongs to --method sto"),
            ("gn", ["--accuracy", "0.1"], "--accuracy belongs to --method sto"),
            ("sto", ["--slowdown", "0.5"], "--slowdown belongs to --method hka"),
            ("lm", ["--forgetting", "0.5"], "--forgetting belongs to --method rls"),
            ("sto", ["--covariance", "2"], "--covariance belongs to --method rls"),
            ("gn", ["--passes", "2"], "--passes belongs to --method rls"),
            ("sto", ["--samples", "500", "--confidence", "0.9"], "leave --samples out"),
            ("sto", ["--sampling", "sobol"], "sobol"),
        ],
    )
    def test_what_a_method_does_not_read_is_wrong_usage(
        self, capsys, curve_csv, method, option, says
    ):
        status, out, err = self.identify(capsys, curve_csv, "--method", method, *option)
        assert (status, out) == (2, "")
        assert says in err

    @pytest.mark.parametrize(
        ("method", "option", "says"),
        [
            ("sto", ["--confidence", "1"], "confidence 1: expected more than 0 and less than 1"),
            ("sto", ["--accuracy", "1e-12"], "more than 1000000 samples"),
            ("hka", ["--slowdown", "2"], "slowdown 2.0: expected"),
            ("rls", ["--forgetting", "0"], "forgetting 0.0: expected"),
            ("rls", ["--covariance", "nan"], "covariance nan: expected"),
            ("rls", ["--passes", "0"], "passes 0: expected 1 or more"),
        ],
    )
    def test_out_of_range_is_refused(self, capsys, curve_csv, method, option, says):
        status, out, err = self.identify(capsys, curve_csv, "--method", method, *option)
        assert (status, out) == (3, "")
        assert says in err

    def test_confidence_and_accuracy_give_n(self, capsys, curve_csv):
        rule = ["--method", "sto", "--confidence", "0.9", "--accuracy", "0.05"]
        status, out, err = self.identify(capsys, curve_csv, *rule)
        assert (status, err) == (0, "")
        (entry,) = json.loads(out)["curves"]
        assert entry["evaluations"] == 45 * entry["iterations"]  # ln 0.1 / ln 0.95 = 44.9

    def test_a_draw_that_breaks_the_rule_is_told(self, capsys, curve_csv):
        status, _, err = self.identify(capsys, curve_csv, "--method", "sto", "--samples", "458")
        assert status == 0
        assert err == (
            "skinlab: 458 samples break the paper's rule, eq. (10): 459 or more for a confidence "
            "of 0.99 and an accuracy of 0.01\n"
        )
        for enough in (["--method", "sto", "--samples", "459"], ["--method", "lm"]):
            assert self.identify(capsys, curve_csv, *enough)[2] == ""

    def test_each_option_reaches_its_method(self, capsys, curve_csv):
        def found(*arguments):
            status, out, _ = self.identify(capsys, curve_csv, *arguments)
            assert status == 0
            (entry,) = json.loads(out)["curves"]
            return entry["parameters"], entry["iterations"]

        passes = ("--method", "rls", "--passes", "2")
        rls = found(*passes)
        assert rls[1] == 2
        assert found(*passes, "--forgetting", "0.99") != rls
        assert found(*passes, "--covariance", "10") != rls
        assert found("--method", "hka") != found("--method", "hka", "--slowdown", "0.9")
        assert found("--method", "sto") != found("--method", "sto", "--sampling", "lhs")

    @pytest.mark.parametrize("command", ["identify", "measure"])
    def test_help_sets_them_apart(self, capsys, command):
        _, out, _ = call(capsys, command, "--help")
        general, single = out.split("Options of single methods:")
        assert "--sampling" in single
        assert "--passes" in single
        assert "--slowdown" not in general
        assert "--samples" in general
        assert "--help" in general


def test_start_up_is_light():
    """`--help` imports none of the heavy libraries."""
    code = (
        "import sys\nfrom skinlab.cli.main import run\nrun(['--help'])\n"
        "heavy = {'numpy', 'scipy', 'h5py', 'textual', 'serial'} & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_reader_that_goes_away_is_no_failure(curve_csv, tmp_path):
    command = f"{sys.executable} -m skinlab {' '.join(FORWARD)} {' '.join(RAMP)} | head -1"
    script = f"set -o pipefail; {command} >/dev/null"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("as_json", [[], ["--json"]])
def test_a_reader_that_goes_away_does_not_end_a_measurement(tmp_path, as_json):
    """The second result could not be printed: the probe was vented, the status 0."""
    out = tmp_path / "s.h5"
    command = [sys.executable, "-m", "skinlab", "measure", "--port", "sim://?seed=1&speed=20"]
    command += [*SKIN, "--program", "ramp:40@20", "--repeats", "3", "--rest-s", "0", *as_json]
    process = subprocess.Popen(
        [*command, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    process.stdout.close()
    assert process.wait(120) == 0, process.stderr.read()
    process.stderr.close()
    assert [c.partial for c in read_session(out).curves] == [False, False, False]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--program", "mode1:100,1,1,33"], "a program of 132 segments; 1 to 128 fit"),
        (
            ["--program", "ramp:40@20", "--first-cycle", "9995", "--repeats", "10"],
            "cycle 9995 with 10 repeats: loading 10008 may be reached; expected at most 10000",
        ),
    ],
)
def test_what_could_not_be_measured_to_its_end_is_bad_input(tmp_path, capsys, more, said):
    out = tmp_path / "s.h5"
    measure = ["measure", "--port", "sim://?seed=1&speed=50", *SKIN, *more, "--out", out]
    status, _, err = call(capsys, *measure)
    assert status == 3
    assert said in err
    assert not out.exists()


def test_a_capture_that_is_too_large_to_be_read_again_is_there(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("drivers.capture.read_whole", lambda path: read_whole(path, 10))
    out = tmp_path / "c.jsonl"
    capture = ["capture", "--port", "sim://?seed=1", "--seconds", "0", "--dialect", "reference"]
    status, _, err = call(capsys, *capture, "--out", out)
    assert (status, out.exists()) == (0, True)
    assert "understands of it is not known" in err
    assert "larger than 10 bytes" in err


def test_strict_refuses_what_ends_at_a_bound(capsys, tmp_path):
    path = tmp_path / "zero.csv"
    path.write_text(CSV + "".join(f"{i},{2 * i},0\n" for i in range(50)))
    assert call(capsys, "identify", path, *SKIN)[0] == 0
    assert call(capsys, "identify", path, *SKIN, "--strict")[0] == 5


def test_readings_that_no_probe_gives_are_refused(capsys, tmp_path):
    path = tmp_path / "huge.csv"
    path.write_text(CSV + "".join(f"{i},{2 * i},{i}e300\n" for i in range(1, 50)))
    status, _, err = call(capsys, "identify", path, *SKIN)
    assert status == 3
    assert "line 2: deflection_mm is 1e300, expected at most 100" in err


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        (["--port", "sim://", "--dialect", "klingon"], 2, "expected one of: reference"),
        (["--port", "sim://?dialect=klingon"], 2, "dialect 'klingon' is not known"),
        (["--port", "sim://?dialect=reference", "--dialect", "mine.toml"], 2, "was asked for"),
        (["--port", "sim://", "--dialect", "none.toml"], 3, "none.toml: cannot be read"),
        (["--port", "sim://", "--dialect", "bad.toml"], 3, "bad.toml: dialect.nmae is not known"),
        (["--port", "COM99", "--dialect", "mine.toml", "--rate-hz", "20"], 2, "own limits hold"),
        (["--port", "sim://", "--dialect", "mine.toml"], 2, "the simulated probe speaks reference"),
        (["--port", "sim://?seed=1&dialect=mine.toml"], 2, "and not dialect 'plain_line'"),
        (["--port", "sim://"], 2, "Missing option '--program'"),
    ],
)
def test_dialects_that_do_not_fit_are_refused(
    capsys, monkeypatch, tmp_path, options, status, words
):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "examples" / "dialects" / "plain_line.toml").read_text()
    Path("mine.toml").write_text(text)
    Path("bad.toml").write_text(text.replace('model = "', 'nmae = "'))
    found, _, err = call(capsys, "measure", *options, *SKIN, "--out", "s.h5")
    assert found == status
    assert words in " ".join(err.split())
    assert not list(tmp_path.glob("s.h5*"))


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["exprot", "a.h5"], "did you mean export?"),
        (["session", "verfy", "a.h5"], "did you mean verify?"),
        (["database", "biuld"], "did you mean build?"),
        (["identify", "--apertur-mm", "6", "c.csv"], "--aperture-mm"),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(capsys, words, meant):
    status, out, err = call(capsys, *words)
    assert (status, out) == (2, "")
    assert meant in err


def test_a_word_that_is_like_no_command_gets_no_guess(capsys):
    _, _, err = call(capsys, "zzz")
    assert "No such command 'zzz'." in err
    assert "did you mean" not in err


PROTOCOL = """
[study]
title = "Winter forearms"
[conditions]
room_temperature_c = [20.0, 24.0]
operator = true
[[step]]
aperture_mm = 6.0
program = "ramp:50@20"
[[step]]
aperture_mm = 6.0
program = "ramp:60@60"
repeats = 2
rest_s = 0.5
"""


def test_a_step_of_a_protocol_is_measured_and_its_session_keeps_what_was_otherwise(
    capsys, tmp_path
):
    protocol, out = tmp_path / "p.toml", tmp_path / "s.h5"
    protocol.write_text(PROTOCOL)
    said = ["measure", "--port", "sim://?seed=1&speed=50", "--thickness-mm", "1", "--out", out]
    said += ["--protocol", protocol, "--step", "2"]
    status, _, err = call(capsys, *said, "--program", "ramp:50@20")
    assert (status, out.exists()) == (2, False)
    assert "leave them out" in err
    assert call(capsys, *said[:-1], "3")[0] == 2
    status, _, err = call(capsys, *said, "--condition", "room_temperatur_c=22")
    assert (status, "did you mean room_temperature_c?" in err) == (2, True)
    status, printed, err = call(capsys, *said, "--condition", "room_temperature_c=26")
    assert status == 0, err
    assert printed.count("X1") >= 2
    assert "otherwise than the protocol says: not stated: operator" in err
    assert "room temperature 26 °C, not 20 to 24" in err
    status, printed, _ = call(capsys, "session", "info", out)
    assert "protocol deviation: text not stated: operator" in printed
    assert "conditions: room_temperature_c 26" in printed
    assert "[[step]]" not in printed


def test_a_slip_in_a_program_or_an_effect_is_answered_too(capsys, tmp_path):
    model = tmp_path / "m.toml"
    model.write_text('[model]\nname = "a"\n[effects.viscoelasticty.g]\nvalue = 0.3\n')
    assert "did you mean ramp?" in call(capsys, *FORWARD, "--program", "rump:100@20")[2]
    _, _, err = call(capsys, *FORWARD, *RAMP, "--model", model)
    assert "did you mean viscoelasticity?" in err


@pytest.mark.parametrize(
    ("words", "found"), [("skinlab exp", "export"), ("skinlab identify --thick", "--thickness-mm")]
)
def test_the_shell_completes_commands_and_options(words, found):
    typed = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    done = subprocess.run(
        [str(Path(sys.executable).parent / "skinlab")],
        env={**os.environ, **typed, "_SKINLAB_COMPLETE": "bash_complete"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"plain,{found}" in done.stdout.splitlines()


def test_workers_share_the_curves_of_all_files(capsys, monkeypatch, curve_csv):
    """A file is one curve: its processes were for the curves of one file, and 300 had one."""
    asked = []

    class Here(workers.Pool):
        def __init__(self, count, state):
            asked.append(count)
            super().__init__(1, state)

    monkeypatch.setattr(workers, "Pool", Here)
    other, absent = curve_csv.with_name("d.csv"), curve_csv.with_name("absent.csv")
    other.write_text(curve_csv.read_text())
    command = ["identify", curve_csv, absent, other, *SKIN, "--json"]
    alone, together = (json.loads(call(capsys, *command, *w)[1]) for w in ([], ["--workers", 3]))
    assert asked == [2]
    for document in (alone, together):
        names = [Path(entry["file"]).name for entry in document["curves"]]
        assert names == ["c.csv", "absent.csv", "d.csv"]
        for entry in document["curves"]:
            entry.pop("seconds")
    assert alone == together


@pytest.mark.parametrize("more", [(), ("--advise",)])
def test_an_interrupted_identify_gives_what_is_done(capsys, monkeypatch, curve_csv, more):
    """Of two curves, as Ctrl-C comes in the second; nothing was printed of 299 of 300."""
    calls = []

    def interrupted(self, curve, whole=Identifier.__call__):
        calls.append(curve)
        if len(calls) % 2 == 0:
            raise KeyboardInterrupt
        return whole(self, curve)

    monkeypatch.setattr(Identifier, "__call__", interrupted)
    other = curve_csv.with_name("d.csv")
    other.write_text(curve_csv.read_text())
    absent = curve_csv.with_name("absent.csv")
    command = ["identify", curve_csv, absent, other, *SKIN]
    status, out, err = call(capsys, *command, *more)
    assert status == 130
    assert out.startswith(f"{curve_csv}  (6 mm opening")
    assert "d.csv" not in out
    assert err.endswith("\nskinlab: stopped after 2 of 3 curves\n")
    status, out, err = call(capsys, *command, *more, "--json")
    document = json.loads(out)
    assert status == 130
    assert [Path(c["file"]).name for c in document["curves"]] == ["c.csv", "absent.csv"]
    assert (document["joint"], document["advice"]) == (None, None)


def test_identify_that_is_interrupted_at_once_has_nothing_to_tell(capsys, monkeypatch, curve_csv):
    def interrupted(self, curve):
        raise KeyboardInterrupt

    monkeypatch.setattr(Identifier, "__call__", interrupted)
    for form in ((), ("--json",)):
        status, out, err = call(capsys, "identify", curve_csv, *SKIN, *form)
        assert (status, out, err.strip()) == (130, "", "skinlab: interrupted")


def test_identify_that_is_interrupted_in_what_curves_say_together_gives_each(
    capsys, monkeypatch, curve_csv
):
    def interrupted(self, curves):
        raise KeyboardInterrupt

    monkeypatch.setattr(Identifier, "joint", interrupted)
    status, out, err = call(capsys, "identify", curve_csv, *SKIN, "--joint", "--json")
    assert (status, err) == (130, "skinlab: stopped after 1 of 1 curve\n")
    assert json.loads(out)["curves"][0]["parameters"] is not None
