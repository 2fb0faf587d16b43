"""A probe's hidden errors come back within their intervals, from the simulated probe's phantoms."""

from __future__ import annotations

import json
import os
import stat
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np
import pytest

from drivers.dialects import get_dialect
from drivers.events import Alarm, Arm, InstrumentState, KeepAlive, Sample, Start
from drivers.probe import Probe
from sim_device.device import Device
from sim_device.files import ProbeSection, SensorSection
from sim_device.skin import load_of, make_phantom
from skinlab.acquisition.calibrating import measure_phantom
from skinlab.cli.calibrate import _ask
from skinlab.cli.main import run
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.phantoms import Phantom, read_phantoms
from skinlab.curves.probe_file import PARAMETERS, decode_probe, probe_text, read_probe
from skinlab.curves.program import parse_program
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.records import records_of
from skinlab.errors import AcquisitionError, InputError
from skinlab.inference.calibration import Reading, calibrate, check_probe
from skinlab.recording.audit import entries
from skinlab.recording.load_inputs import read_campaign_or_session
from skinlab.recording.session import read_session
from skinlab.recording.stream import Happened

NOW = datetime(2026, 1, 1, tzinfo=UTC)
WIRE = get_dialect("reference")
RESULTS = Path(__file__).parents[3] / "benchmarks" / "results" / "calibration.json"
HIDDEN = ProbeSection("P-9", 1.06, -35.0, 0.97, 0.6, 0.03)


def measured(phantom, probe, seed, *, kit=None, rate_hz=100.0, sensor=None):
    """What a simulated probe with these errors reads on a phantom, without a host."""
    skin = make_phantom(phantom.name, seed if kit is None else kit, probe)
    device = Device(skin, sensor or SensorSection(), seed=seed, probe=probe)
    load = load_of(str(phantom.asked), rate_hz)
    for number, command in enumerate((load, Arm(), Start())):
        device.receive(WIRE.encode_command(command, number))
    raw, samples = bytearray(), []
    while device.state not in {InstrumentState.LOADED, InstrumentState.FAULT} or not samples:
        device.process(0.1)
        device.receive(WIRE.encode_command(KeepAlive(), 0))
        raw += device.transmit()
        while (frame := WIRE.take(raw)) is not None:
            event = WIRE.decode_event(frame)[0]
            if isinstance(event, Sample) and event.segment < len(load.segments):
                samples.append(event)
    columns = ((s.device_time_s, s.pressure_mbar, s.deflection_mm) for s in samples)
    time_s, pressure, deflection = map(np.array, zip(*columns, strict=True))
    segment = np.array([s.segment for s in samples])
    return Curve(
        phantom.name, Setup(6.0, 1.0, phantom.asked), time_s, pressure, deflection, segment
    )


def calibrated(probe, seed, kit=None, sensor=None):
    readings = [Reading(p, measured(p, probe, seed, sensor=sensor)) for p in kit or read_phantoms()]
    return calibrate(readings, serial_number=probe.serial_number, model="m", now=NOW)


@pytest.fixture(scope="module")
def readings():
    return [Reading(p, measured(p, HIDDEN, 3)) for p in read_phantoms()]


@pytest.fixture(scope="module")
def known(readings):
    return calibrate(readings, serial_number=HIDDEN.serial_number, model="m", now=NOW)


def drawn(seed):
    rng = np.random.default_rng([41, seed])
    return ProbeSection(
        deflection_gain=float(rng.uniform(0.9, 1.1)),
        deflection_offset_um=float(rng.uniform(-60, 60)),
        pressure_gain=float(rng.uniform(0.93, 1.07)),
        pressure_offset_mbar=float(rng.uniform(-1, 1)),
        lag_s=int(rng.integers(0, 80)) / 1000,
    )


def within(seeds):
    """How often the 90 % intervals contain the true value, and half their widths, by parameter."""
    held = {name: [] for name in PARAMETERS}
    half = {name: [] for name in PARAMETERS}
    for seed in seeds:
        probe = drawn(seed)
        found = calibrated(probe, seed)
        for name in PARAMETERS:
            one = getattr(found, name)
            held[name].append(one.low <= getattr(probe, name) <= one.high)
            half[name].append((one.high - one.low) / 2)
    return held, half


@pytest.mark.long
def test_hidden_errors_come_back_within_their_intervals():
    held, half = within(range(3))
    # 15 intervals of 90 %: fewer than 10 of them would happen once in four hundred times
    assert sum(sum(h) for h in held.values()) >= 10
    # and they are narrow enough to be of use
    assert np.median(half["deflection_gain"]) < 0.01
    assert np.median(half["deflection_offset_um"]) < 1.0
    assert np.median(half["pressure_offset_mbar"]) < 0.1
    assert np.median(half["lag_s"]) < 0.002
    # Silicone whose stiffness is known to 2 % cannot tell a pressure better than that
    assert 0.015 < np.median(half["pressure_gain"]) < 0.04


@pytest.mark.long
def test_a_pressure_in_whole_mbar_makes_its_zero_uncertain():
    sensor = SensorSection(pressure_resolution_mbar=1.0)
    for offset_mbar in (-0.85, 0.3):
        found = calibrated(ProbeSection(pressure_offset_mbar=offset_mbar), 3, sensor=sensor)
        assert found.misfit < 2
        one = found.pressure_offset_mbar
        assert one.low <= offset_mbar <= one.high
        assert one.high - one.low > 0.2


@pytest.mark.soak
def test_coverage_over_many_kits_and_probes():
    seeds = range(1000, 1100)
    held, half = within(seeds)
    share = {name: float(np.mean(h)) for name, h in held.items()}
    RESULTS.write_text(
        json.dumps(
            {
                "command": "make soak",
                "what": "90 % intervals that hold the hidden truth; kits, probes, noise drawn anew",
                "seeds": [seeds.start, seeds.stop],
                "coverage": share,
                "median_half_width": {name: float(np.median(h)) for name, h in half.items()},
            },
            indent=1,
        )
        + "\n"
    )
    assert min(share.values()) > 0.8


def test_rigid_bodies_alone_say_nothing_of_the_pressure():
    rigid = [p for p in read_phantoms() if p.kind == "rigid"]
    found = calibrated(HIDDEN, 5, rigid)
    assert set(found.not_determined) == {"pressure_gain", "pressure_offset_mbar", "lag_s"}
    assert abs(found.deflection_gain.value - 1.06) < 0.01
    assert found.check is None


@pytest.mark.long
def test_a_phantom_that_is_not_its_sheet_is_said_and_makes_intervals_wider(known, readings):
    assert known.misfit < 1.2
    assert known.phantoms_off == []
    # The same step twice, and once its sheet is wrong
    step = readings[1]
    other = msgspec.structs.replace(step.phantom, name="other", height_mm=0.7)
    found = calibrate([*readings, Reading(other, step.curve)], serial_number="", model="", now=NOW)
    assert "other" in found.phantoms_off
    one, before = found.deflection_gain, known.deflection_gain
    assert one.high - one.low > 3 * (before.high - before.low)


@pytest.mark.parametrize(
    ("change", "agrees"),
    [({}, True), ({"deflection_gain": 1.10}, False), ({"deflection_offset_um": -55.0}, False),
     ({"pressure_gain": 1.0}, False), ({"deflection_offset_um": -36.0}, True)],
)  # fmt: skip
def test_a_check_curve_says_whether_the_probe_still_agrees(known, change, agrees):
    probe = msgspec.structs.replace(HIDDEN, **change)
    soft = known.check.phantom
    # The same kit, another day: other noise
    assert check_probe(known, measured(soft, probe, 8, kit=3)).agrees == agrees


def test_a_probe_file_reads_back_and_is_strict(known):
    text = probe_text(known)
    assert decode_probe(text, "p.toml").file == known
    assert decode_probe(text, "p.toml").hash.startswith("sha256:")
    for old, new in (
        ('schema = "skinlab.probe/1"', 'schema = "other"'),
        ("aperture_mm = 6.0", "aperture_mm = 5.0"),
        ("misfit", "misfits"),
        ("[lag_s]", "[lag_s]\nsomething = 1"),
        ("not_determined = []", "not_determined = 3"),
    ):
        assert old in text
        with pytest.raises(InputError, match=r"p\.toml"):
            decode_probe(text.replace(old, new, 1), "p.toml")


def test_another_probe_and_another_day_are_refused(known):
    probe = decode_probe(probe_text(known), "p.toml")
    probe.check_instrument("P-9", 6.0, NOW)
    for serial, opening, when in (
        ("P-8", 6.0, NOW),
        ("P-9", 8.0, NOW),
        ("P-9", 6.0, NOW.replace(year=2028)),
    ):
        with pytest.raises(InputError, match="probe file"):
            probe.check_instrument(serial, opening, when)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A probe that was calibrated by the command, and measured with."""
    at = tmp_path_factory.mktemp("probe")
    (at / "skin.toml").write_text(
        "[probe]\nserial_number = 'P-9'\ndeflection_gain = 1.06\ndeflection_offset_um = -35\n"
        "pressure_gain = 0.97\npressure_offset_mbar = 0.6\nlag_s = 0.03\n"
    )
    port = f"sim://?seed=3&speed=20&skin={at / 'skin.toml'}"
    assert run(["calibrate", "--port", port, "--out", str(at / "probe.toml")]) == 0
    status = run(
        ["measure", "--port", port, "--aperture-mm", "6", "--thickness-mm", "1", "--program",
         "ramp:100@20", "--probe", str(at / "probe.toml"), "--out", str(at / "s.h5")]
    )  # fmt: skip
    assert status == 0
    return at


@pytest.mark.long
def test_the_session_keeps_the_probe_and_replays_with_it(folder, capsys):
    assert run(["replay", str(folder / "s.h5"), "--speed", "max", "--verify", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["probe"]["serial_number"] == "P-9"
    # the session's own is used; without it the same curve is not explained by any skin
    assert run(["identify", str(folder / "s.h5"), "--json"]) == 0
    own = json.loads(capsys.readouterr().out)
    assert own["probe"] == again["probe"]
    assert own["curves"][0]["parameters"] == again["curves"][0]["parameters"]
    assert run(["identify", str(folder / "s.h5"), "--probe", "none", "--json"]) == 0
    blind = json.loads(capsys.readouterr().out)
    assert "probe" not in blind
    with_probe, without = again["curves"][0], blind["curves"][0]
    assert without["rms_um"] > 1.5 * with_probe["rms_um"]
    truth = {"X1_MPa": 0.025, "X2_MPa": 2.95, "nu": 0.28}
    for name, value in truth.items():
        one = with_probe["parameters"][name]
        assert one["low"] <= value <= one["high"]


def test_what_the_calibration_leaves_open_makes_intervals_wider(folder, tmp_path, capsys):
    text = (folder / "probe.toml").read_text()
    known = decode_probe(text, "p")
    sure = msgspec.structs.replace(known.file, covariance=(np.zeros((5, 5))).tolist())
    (tmp_path / "sure.toml").write_text(probe_text(sure))
    widths = []
    for path in (folder / "probe.toml", tmp_path / "sure.toml"):
        assert run(["identify", str(folder / "s.h5"), "--probe", str(path), "--json"]) == 0
        one = json.loads(capsys.readouterr().out)["curves"][0]["parameters"]["X1_MPa"]
        widths.append(np.log(one["high"] / one["low"]))
    assert widths[0] > widths[1]


MODEL = """[model]
name = "with an effect"
law = "extended_neo_hookean"
kappa = "paper"
[effects.{effect}.{parameter}]
value = {mean}
low = {low}
high = {high}
prior = {{ mean = {mean}, sd = 0.01 }}
"""


@pytest.mark.long
def test_a_model_with_effects_takes_the_calibration(folder, tmp_path, capsys):
    path = tmp_path / "m.toml"
    path.write_text(
        MODEL.format(effect="viscoelasticity", parameter="g", low=0, high=0.5, mean=0.02)
        + "[effects.viscoelasticity.tau_s]\nvalue = 1.0\n"
    )
    found = []
    for of in (["--probe", "none"], ["--model", str(path)]):
        assert run(["identify", str(folder / "s.h5"), *of, "--json"]) == 0
        found += json.loads(capsys.readouterr().out)["curves"]
    blind, one = found[0], found[1]["parameters"]["X1_MPa"]
    assert found[1]["rms_um"] < 0.8 * blind["rms_um"]
    assert one["low"] <= 0.025 <= one["high"]


@pytest.mark.long
def test_what_the_model_and_the_probe_file_both_know_counts_once(folder, tmp_path, capsys):
    path = tmp_path / "m.toml"
    path.write_text(
        MODEL.format(effect="deflection_gain", parameter="gain", low=0.8, high=1.2, mean=1.06)
    )
    identify = ["identify", str(folder / "s.h5"), "--model", str(path)]
    assert run([*identify, "--probe", str(folder / "probe.toml")]) == 3
    assert run(identify) == 3
    assert "would count twice" in capsys.readouterr().err
    assert run([*identify, "--probe", "none"]) == 0


def test_a_campaign_is_explained_by_true_readings(folder):
    """What the calibration takes off is no missing effect, and what it leaves open no certainty."""
    session, _ = read_campaign_or_session(folder / "s.h5")
    (raw,) = session.curves
    (record,) = records_of(session)
    gain, offset_mm = raw.probe.file.deflection_gain.value, -0.035
    assert record.curve.deflection_mm * gain + offset_mm == pytest.approx(
        raw.deflection_mm, abs=1e-3
    )
    (blind,) = records_of(replace(session, curves=(replace(raw, probe=None),)))
    assert (blind.curve.deflection_mm == raw.deflection_mm).all()
    errors, before = errors_of([record]).columns_mm, errors_of([blind]).columns_mm
    assert errors.shape[1] == before.shape[1] + len(PARAMETERS)
    # half an interval of the pressure's gain, through dw/dp at the top
    left_open = np.sqrt(np.square(errors[:, before.shape[1] :]).sum(axis=1))
    assert 1e-3 < left_open.max() < 0.05


def test_another_probe_is_refused_before_any_suction(folder, tmp_path, capsys):
    status = run(
        ["measure", "--port", "sim://?seed=3&speed=20", "--aperture-mm", "6", "--thickness-mm", "1",
         "--program", "ramp:100@20", "--probe", str(folder / "probe.toml"),
         "--out", str(tmp_path / "s.h5")]
    )  # fmt: skip
    assert status == 3
    assert "'P-9'; connected is 'SIM-1'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_commands_answers(folder, capsys):
    port = f"sim://?seed=3&speed=20&skin={folder / 'skin.toml'}"
    check = ["calibrate", "--port", port, "--check", str(folder / "probe.toml"), "--json"]
    assert run(check) == 0
    assert json.loads(capsys.readouterr().out)["agrees"] is True
    (folder / "drifted.toml").write_text((folder / "skin.toml").read_text().replace("1.06", "1.12"))
    check[2] = port.replace("skin.toml", "drifted.toml")
    assert run(check) == 1
    assert json.loads(capsys.readouterr().out)["agrees"] is False
    check[2] = "sim://?seed=3&speed=20"
    assert run(check) == 3
    assert "'P-9'; connected is 'SIM-1'" in capsys.readouterr().err
    out = str(folder / "probe.toml")
    assert run(["calibrate", "--port", port, "--out", out]) == 3
    assert "never overwritten" in capsys.readouterr().err
    assert run(["calibrate", "--port", "/dev/null", "--out", "x.toml"]) == 2
    assert run(["calibrate", "--port", port]) == 2
    (folder / "kit.toml").write_text('schema = "skinlab.phantoms/1"\nphantom = [{name = "a"}]\n')
    kit = ["--phantoms", str(folder / "kit.toml"), "--out", str(folder / "x.toml")]
    assert run(["calibrate", "--port", port, *kit]) == 3
    assert "kit.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("out", "more", "status", "says"),
    [
        ("p.curves", [], 3, "ends with .toml"),
        ("p.checks", [], 3, "ends with .toml"),
        ("old.toml", [], 3, "old.curves: exists already"),
        ("a file/p.toml", [], 3, "cannot be written"),
        ("p.toml", ["--aperture-mm", "0"], 3, "aperture_mm 0: no probe has this opening"),
    ],
)
def test_what_cannot_be_kept_or_meant_is_refused_before_any_suction(
    tmp_path, monkeypatch, capsys, out, more, status, says
):
    monkeypatch.setattr("skinlab.acquisition.calibrating.measure_phantom", None)
    (tmp_path / "a file").touch()
    (tmp_path / "old.curves").mkdir()
    assert run(["calibrate", "--port", "sim://", "--out", str(tmp_path / out), *more]) == status
    assert says in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--aperture-mm", "--valid-days"])
def test_a_check_refuses_what_it_would_not_look_at(capsys, option):
    assert run(["calibrate", "--port", "sim://", "--check", "p.toml", option, "6"]) == 2
    assert "leave --phantoms, --aperture-mm and --valid-days out" in capsys.readouterr().err


def test_an_alarm_is_said_at_once(tmp_path, monkeypatch, capsys):
    """Under a lost link nothing was said, while it was looked for without end."""

    def measure(*_, listener, **__):
        listener(Happened(Alarm("the link is lost: lift the probe")))
        assert "ALARM: the link is lost: lift the probe" in capsys.readouterr().err
        raise AcquisitionError("ended")

    monkeypatch.setattr("skinlab.acquisition.calibrating.measure_phantom", measure)
    assert run(["calibrate", "--port", "sim://", "--out", str(tmp_path / "p.toml")]) == 4


@pytest.mark.skipif(sys.platform == "win32", reason="no ptys")
def test_an_enter_of_before_starts_nothing(tmp_path, monkeypatch):
    """An Enter too many started suction on the next phantom, with the probe still on this one."""
    keyboard, terminal = os.openpty()
    with os.fdopen(keyboard, "wb", 0) as pressed, os.fdopen(terminal) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        pressed.write(b"early\n")
        asked = []

        def ask(text, **_):
            asked.append(text)
            pressed.write(b"late\n")

        monkeypatch.setattr("skinlab.cli.calibrate.echo", ask)
        _ask(Phantom("flat", "rigid"))
        assert len(asked) == 1
        pressed.write(b"next\n")
        assert stdin.readline() == "next\n"


def test_a_curve_that_a_lost_link_cut_is_kept_too(tmp_path, monkeypatch):
    setup = Setup(6.0, 1.0, parse_program("ramp:4@4"))
    cut, whole = (
        Curve("", setup, np.arange(n) / 10, np.arange(n) / 10, np.zeros(n), np.zeros(n, int))
        for n in (3, 10)
    )

    def measure(source, plan, pipeline):
        pipeline.complete(1, cut)
        pipeline.complete(2, whole)

    monkeypatch.setattr("skinlab.acquisition.calibrating.measure", measure)
    plate = Phantom("flat", "rigid")
    _, curve = measure_phantom("sim://?speed=200", plate, None, folder=tmp_path)
    assert curve is whole
    lines = {p.name: len(p.read_text().splitlines()) for p in tmp_path.iterdir()}
    assert lines == {"flat.csv": 11, "flat-cut-1.csv": 4}


def test_an_opening_that_nobody_says_is_asked_for():
    """It was taken for 6 mm."""

    class Silent(Probe):
        def open(self):
            return replace(super().open(), aperture_mm=None)

    with pytest.raises(InputError, match="--aperture-mm"):
        measure_phantom("sim://?speed=200", Phantom("flat", "rigid"), None, Silent)


def test_whether_the_probe_was_checked_is_said_and_kept(folder, tmp_path, capsys):
    path = tmp_path / "probe.toml"
    path.write_text((folder / "probe.toml").read_text())
    port = f"sim://?seed=3&speed=20&skin={folder / 'skin.toml'}"
    measure = ["measure", "--port", port, "--aperture-mm", "6", "--thickness-mm", "1",
               "--program", "ramp:60@60", "--method", "lm", "--probe", str(path),
               "--out"]  # fmt: skip
    check = ["calibrate", "--port", port, "--check", str(path)]
    assert run([*measure, str(tmp_path / "a.h5")]) == 0
    assert "probe P-9 was not checked yet: before the visit" in capsys.readouterr().err
    assert run(check) == 0
    assert stat.S_IMODE((tmp_path / "probe.checks").stat().st_mode) == 0o600
    assert run([*measure, str(tmp_path / "b.h5")]) == 0
    assert "probe P-9 agreed with its calibration" in capsys.readouterr().err
    trail = {e.what: e.detail for e in entries(read_session(tmp_path / "b.h5").records)}
    assert trail["probe file"]["agrees"] is True
    known, now = read_probe(path), datetime.now(UTC)
    assert known.standing(now + timedelta(hours=13))[0] is False
    assert "since" in known.standing(now + timedelta(hours=13))[1]
    (tmp_path / "probe.checks").write_bytes((tmp_path / "probe.checks").read_bytes() + b"\xff{\n")
    assert known.standing(now)[0] is True
    known.keep_check(now + timedelta(days=360), agrees=True)
    agrees, words = known.standing(now + timedelta(days=360))
    assert not agrees
    assert "ends in 4 days" in words
    known.keep_check(now + timedelta(days=361), agrees=False)
    assert "DIFFERED" in known.standing(now + timedelta(days=361))[1]
