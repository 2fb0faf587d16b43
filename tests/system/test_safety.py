"""Tests for each row of docs/safety.md.

Where parts fail, against a simulated probe whose true pressure is watched; where an instrument
lies (`lying_instrument.py`), by when the host vents.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import FORGIVING_S, module_command, reopen

from drivers.errors import DriverError, LocalProtocolError, RemoteProtocolError
from drivers.events import (
    Alarm,
    Gap,
    HostVented,
    InstrumentFault,
    LinkLost,
    LinkRestored,
    Sample,
    Segment,
    SegmentKind,
    VentConfirmed,
)
from drivers.probe import DEFAULTS, Limits, Probe
from skinlab.cli.main import run as skinlab
from skinlab.recording.session import read_session

DOCUMENT = Path(__file__).parents[2] / "docs" / "safety.md"
SKIN = ["--aperture-mm", "6", "--thickness-mm", "1"]
LINKS = [
    pytest.param(
        ("--pty",), marks=pytest.mark.skipif(not hasattr(os, "openpty"), reason="no ptys")
    ),
    ("--tcp", "0"),
]


def ramp(target, rate):
    return Segment(SegmentKind.RAMP, target_mbar=target, rate_mbar_per_s=rate)


def hold(seconds):
    return Segment(SegmentKind.HOLD, duration_s=seconds)


PULL = (ramp(60, 200), hold(50))
PATIENCE_S = 300.0
# Where something else is shown: another process that did not run for a while is no reason to vent
PATIENT = Limits(stale_s=FORGIVING_S, clock_s=FORGIVING_S)


def fault(kind, **numbers):
    return "\n".join(
        ["[[fault]]", f'kind = "{kind}"', *(f"{k} = {v}" for k, v in numbers.items()), ""]
    )


def start(probe, segments=PULL, rate_hz=50):
    probe.open()
    probe.load(segments, rate_hz)
    probe.arm()
    probe.start()


def until(probe, wanted, seen):
    while True:
        timed = probe.next_event(PATIENCE_S)
        assert timed is not None, seen[-10:]
        seen.append(timed.event)
        if isinstance(timed.event, wanted):
            return timed.event


def vents(simulated, segments=PULL):
    """Pull; give the reason for which the driver vented, once the pressure has really fallen."""
    with Probe(simulated.url, limits=PATIENT) as probe:
        start(probe, segments)
        seen = []
        vented = until(probe, HostVented, seen)
        until(probe, VentConfirmed, seen)
        simulated.until_vented()
        assert not [event for event in seen if isinstance(event, Alarm)]
    return vented.reason


class Host:
    """`skinlab measure` as a process."""

    def __init__(self, folder, url, *options, program="ramp:60@200,hold:50", before=""):
        command = module_command("skinlab")
        if before:
            begin = "from patience import be_patient\nbe_patient(apart=True)\n"
            code = f"{begin}{before}\nfrom skinlab.cli.start import main\nmain()"
            command = [sys.executable, "-c", code]
        here = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        self.process = subprocess.Popen(
            [
                *command, "measure", "--port", url, *SKIN, "--program", program,
                "--out", "s.h5", *options,
            ],
            cwd=folder,
            env={
                **os.environ,
                "OPENBLAS_NUM_THREADS": "1",
                "PYTHONPATH": os.pathsep.join(filter(None, here)),  # for `patience`
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip

    def end(self):
        out, err = self.process.communicate(timeout=PATIENCE_S)
        assert "Traceback" not in err
        return self.process.returncode, out, err


@pytest.fixture(autouse=True)
def _patient_answers(monkeypatch):
    """Not how fast a busy machine answers a command is judged here, but the watchdogs."""
    monkeypatch.setattr(DEFAULTS, "command_timeout_s", FORGIVING_S)
    monkeypatch.setattr(DEFAULTS, "open_timeout_s", FORGIVING_S)


@pytest.fixture
def measure(tmp_path):
    """Start measurements; none outlives its test."""
    hosts = []

    def start_one(url, *options, **more):
        hosts.append(Host(tmp_path, url, *options, **more))
        return hosts[-1]

    yield start_one
    for host in hosts:
        host.process.kill()
        host.process.communicate(timeout=PATIENCE_S)


# ---- one row each -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "link",
    [
        pytest.param(*LINKS[0].values, id="pty", marks=LINKS[0].marks),
        pytest.param(LINKS[1], id="tcp", marks=pytest.mark.long),
    ],
)
def test_link_lost(simulate, link):
    simulated = simulate(*link, faults=fault("unplug", at_s=1.0, for_s=2.0), speed=2)
    with Probe(simulated.url) as probe:
        start(probe)
        seen = []
        until(probe, LinkLost, seen)
        assert "lift the probe" in until(probe, Alarm, seen).text
        simulated.until_vented()
        reopen(probe)
        until(probe, VentConfirmed, seen)
        until(probe, LinkRestored, seen)
        with pytest.raises(LocalProtocolError, match="acknowledge the alarm"):
            probe.load(PULL, 50)
        probe.acknowledge_alarm()
        probe.load(PULL, 50)
    rows = simulated.rows()
    begin = next(t for t, _, state in rows if state == "running")
    over = next(t for t, _, state in rows if t > begin and state != "running")
    low = next(t for t, p, _ in rows if t > over and p < 5)
    # On the device's clock, which runs twice as fast as the host's, and so does its patience
    assert over - begin <= 1.0 + 2 * 0.5 + 0.05
    assert low - over <= 1.0


def test_host_killed(simulate, measure):
    simulated = simulate("--tcp", "0")
    host = measure(simulated.url)
    simulated.until_suction()
    host.process.kill()
    host.process.communicate(timeout=PATIENCE_S)
    simulated.until_vented()
    assert simulated.rows()[-1][2] == "idle"


def test_host_hung(simulate, measure, tmp_path):
    simulated = simulate("--pty" if hasattr(os, "openpty") else "--tcp=0")
    host = measure(simulated.url)
    simulated.until_suction()
    host.process.send_signal(signal.SIGSTOP)
    try:
        simulated.until_vented()
    finally:
        host.process.send_signal(signal.SIGCONT)
    status, _, err = host.end()
    assert status == 4
    assert re.search("stale|keep-alive lost", err)
    (curve,) = read_session(tmp_path / "s.h5").curves
    assert curve.partial


def test_overshoot_above_the_command(simulate):
    """The host sees it first where the program's maximum is higher."""
    simulated = simulate("--tcp", "0", faults=fault("overshoot", at_s=1.0, size=35), patient=True)
    assert "overshoot" in vents(simulated, (ramp(100, 20), hold(20)))
    # Commanded were 20 mbar then: vented long before it could reach what the program goes to
    assert max(p for _, p, _ in simulated.rows()) < 90


def test_overshoot_above_the_maximum(simulate):
    """The instrument sees it itself."""
    simulated = simulate("--tcp", "0", faults=fault("overshoot", at_s=1.0, size=100), patient=True)
    with Probe(simulated.url, limits=PATIENT) as probe:
        start(probe)
        seen = []
        assert until(probe, InstrumentFault, seen).code == "pressure"
        until(probe, VentConfirmed, seen)
        simulated.until_vented()
    # On its own clock: it vents as soon as it measures 10 mbar too much
    assert max(p for _, p, _ in simulated.rows()) < 80


def test_valve_stuck(simulate):
    simulated = simulate("--tcp", "0", faults=fault("stuck_valve", at_s=0.2), patient=True)
    with Probe(simulated.url) as probe:
        start(probe)
        simulated.until_suction(55)
        probe.vent()
        seen = []
        assert "lift the probe" in until(probe, Alarm, seen).text
        assert not [event for event in seen if isinstance(event, VentConfirmed)]
        assert simulated.rows()[-1][1] > 55  # as the alarm says
        assert probe.alarm is not None
        assert probe.alarm == next(e for e in seen if isinstance(e, Alarm)).text
        with pytest.raises(LocalProtocolError, match=r"alarm|not allowed"):
            probe.load(PULL, 50)


def test_leak(simulate):
    simulated = simulate(
        "--tcp", "0", faults=fault("leak", at_s=0.5, size=0.7), speed=2, patient=True
    )
    assert "leak" in vents(simulated)


def test_no_skin_contact(simulate):
    simulated = simulate("--tcp", "0", faults=fault("no_contact"), speed=2, patient=True)
    assert "no skin under the probe" in vents(simulated)
    assert max(p for _, p, _ in simulated.rows()) < 5


def test_frozen_sensor(simulate):
    simulated = simulate(
        "--tcp", "0", faults=fault("frozen_sensor", at_s=0.5), speed=2, patient=True
    )
    assert "frozen deflection" in vents(simulated, (ramp(100, 20),))


def test_frozen_pressure():
    """It reads 30 mbar on a ramp that goes on to 100."""
    reason, at_s = caught("frozen pressure", segments=(ramp(100, 20),))
    assert "frozen pressure: 30 mbar" in reason
    assert 1.5 < at_s <= 2.1


def test_drifting_sensor(simulate):
    drift = fault("drifting_sensor", at_s=0.5, rate=5000)
    simulated = simulate("--tcp", "0", faults=drift, speed=2, patient=True)
    assert "impossible deflection" in vents(simulated)


@pytest.mark.parametrize(
    "faults",
    [
        pytest.param(fault("stall", at_s=0.5), id="stalled"),
        # Later and later, with never more than 200 ms without one
        pytest.param(
            fault("late_samples", at_s=0.5, for_s=0.5, size=0.2)
            + fault("late_samples", at_s=1.0, for_s=0.5, size=0.4)
            + fault("late_samples", at_s=1.5, size=0.6),
            id="ever-later",
            marks=pytest.mark.long,
        ),
    ],
)
def test_stale_data(simulate, faults):
    simulated = simulate("--tcp", "0", faults=faults, patient=True)
    with Probe(simulated.url) as probe:
        start(probe)
        assert "stale" in until(probe, HostVented, []).reason
        simulated.until_vented()


def test_wrong_aperture(simulate, measure):
    simulated = simulate("--tcp", "0", "--aperture-mm", "2")
    host = measure(simulated.url)
    status, _, err = host.end()
    assert status == 3
    assert "aperture_mm 6: the probe has 2 mm" in err
    assert not [p for _, p, _ in simulated.rows() if p > 0]


def test_wrong_units(simulate, tmp_path, capsys):
    simulated = simulate("--tcp", "0")
    for option, value, named in (
        ("--program", "ramp:10000@2000", "ramp:10000"),  # Pa
        ("--thickness-mm", "1000", "thickness_mm 1000"),  # µm
        ("--aperture-mm", "0.006", "aperture_mm 0.006"),  # m
        ("--aperture-mm", "3", "aperture_mm 3"),  # the radius
    ):
        options = {"--program": "ramp:100@20", "--thickness-mm": "1", "--aperture-mm": "6"}
        words = [word for pair in (options | {option: value}).items() for word in pair]
        out = str(tmp_path / "s.h5")
        assert skinlab(["measure", "--port", simulated.url, *words, "--out", out]) == 3
        assert named in capsys.readouterr().err
    assert not [p for _, p, _ in simulated.rows() if p > 0]


def test_wrong_firmware(simulate):
    simulated = simulate("--tcp", "0", faults=fault("wrong_firmware"))
    with Probe(simulated.url) as probe, pytest.raises(RemoteProtocolError, match="version 2"):
        probe.open()
    assert not [p for _, p, _ in simulated.rows() if p > 0]


def test_clock_jump(simulate, measure, tmp_path):
    """The time of day may go where it likes: every reading of it here is a day off the last."""
    jumps = (
        "import itertools, time\nreal, days = time.time, itertools.cycle((0, 86400, -86400))\n"
        "time.time = lambda: real() + next(days)"
    )
    simulated = simulate(
        "--tcp", "0", faults=fault("counter_jump", at_s=0.5, size=7), speed=5, patient=True
    )
    host = measure(simulated.url, program="ramp:60@40,ramp:0@40", before=jumps)
    status, _, err = host.end()
    assert status == 0, err
    (curve,) = read_session(tmp_path / "s.h5").curves
    assert not curve.partial
    simulated.until_vented()


def test_disk_full(simulate, measure, tmp_path):
    """No file may grow beyond 200 kB: the journal reaches that in the middle of the run."""
    full = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))"
    simulated = simulate("--tcp", "0", patient=True)
    host = measure(simulated.url, "--rate-hz", "1000", before=full)
    status, _, err = host.end()
    assert status == 4
    assert "cannot be written" in err
    simulated.until_vented()
    assert max(p for _, p, _ in simulated.rows()) > 5  # so there was something to vent
    assert [path for path in tmp_path.glob("s.h5*") if path.stat().st_size > 0]


def test_power_lost(simulate):
    """The instrument's; the host's is `host killed`."""
    simulated = simulate("--tcp", "0")
    with Probe(simulated.url) as probe:
        start(probe)
        simulated.until_suction()
        simulated.end(signal.SIGKILL)
        seen = []
        until(probe, LinkLost, seen)
        assert "lift the probe" in until(probe, Alarm, seen).text
        again = simulate("--tcp", simulated.url.rpartition(":")[2])
        reopen(probe)
        until(probe, VentConfirmed, seen)
        probe.acknowledge_alarm()
        with pytest.raises(LocalProtocolError, match="load a program first"):
            probe.arm()
    assert not [p for _, p, _ in again.rows() if p > 0]


# ---- instruments that lie, each a process of its own --------------------------------------------

LIAR = Path(__file__).parents[1] / "lying_instrument.py"
TWO_S = (ramp(60, 1e5), hold(2))
# A process that did not run for a while is forgiven, the clocks of both are real
STRICT = Limits(stale_s=FORGIVING_S)


@contextmanager
def lying(lie, *, limits=STRICT, segments=TWO_S, pty=False, start=True):
    """A probe at an instrument that runs and lies; gives the probe."""
    process = subprocess.Popen(
        [sys.executable, str(LIAR), *(["--pty"] if pty else []), lie],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        url = process.stdout.readline().strip()
        with Probe(url, limits=limits, clock=time.monotonic) as probe:
            probe.open()
            probe.load(segments, 50)
            probe.arm()
            if start:
                probe.start()
            yield probe
    finally:
        process.kill()
        process.communicate()


def caught(lie, **options):
    """Why it was vented, and the time of the sample that gave it away, by its own clock."""
    seen = []
    with lying(lie, **options) as probe:
        reason = until(probe, HostVented, seen).reason
        until(probe, VentConfirmed, [])
    return reason, max([event.device_time_s for event in seen if isinstance(event, Sample)] or [0])


@pytest.mark.parametrize(
    ("lie", "pty"),
    [pytest.param("holds on", True, marks=LINKS[0].marks), ("holds on", False), ("dips", False)],
)
def test_a_program_that_does_not_end(lie, pty):
    """It accepted 2 s and goes on and on, with samples that are plausible, dips or no dips."""
    reason, at_s = caught(lie, pty=pty)
    assert "behind the program: still segment 1 (hold)" in reason
    assert 2.0 < at_s <= 2.5


TO_A_HEIGHT = (
    Segment(SegmentKind.UNTIL, target_mbar=100, rate_mbar_per_s=20, height_mm=0.2),
    hold(1),
)


def test_a_height_that_is_passed():
    """It reads 0.2 mm after 0.8 s, and rises on: its pressure and time would allow 5 s."""
    reason, at_s = caught("passes the height", segments=TO_A_HEIGHT)
    assert "passed" in reason
    # 0.1 mm of tolerance, 0.15 s, and a sample
    assert 1.2 < at_s <= 1.5


def test_a_height_that_is_not_reached(simulate):
    """The most that was allowed is never exceeded, and the program goes on and ends."""
    simulated = simulate("--tcp", "0", speed=2)
    high = (Segment(SegmentKind.UNTIL, target_mbar=60, rate_mbar_per_s=60, height_mm=3), hold(1))
    with Probe(simulated.url, limits=PATIENT) as probe:
        start(probe, high)
        seen = []
        until(probe, VentConfirmed, seen)
        assert not [event for event in seen if isinstance(event, HostVented)]
    assert 55 < max(p for _, p, _ in simulated.rows()) < 62


def test_a_height_for_an_instrument_that_cannot():
    """One that has not said that it can is not even asked."""
    with (
        pytest.raises(LocalProtocolError, match="cannot stop at a height"),
        lying("truth", segments=TO_A_HEIGHT, start=False),
    ):
        pass


def test_pressure_after_the_end():
    """It says that it vents, and pulls."""
    reason, at_s = caught("vents in words")
    assert "overshoot: 60 mbar" in reason
    assert 2.0 < at_s <= 2.5
    reason, at_s = caught("done")
    assert "suction of 60 mbar while loaded" in reason
    assert 2.0 < at_s <= 2.5
    reason, at_s = caught("stays high")
    assert "overshoot: 60 mbar" in reason
    assert 2.0 < at_s <= 2.5
    reason, at_s = caught("leaks shut")
    assert "suction around 5 mbar or more for 1 s" in reason
    assert 3.0 < at_s <= 3.5
    reason, at_s = caught("fault in name")
    assert "reports a fault" in reason
    assert 2.0 <= at_s + 0.02 <= 2.5


def test_a_last_vent_that_nobody_can_see():
    """It says that its program is over, of a pressure of 60 mbar, and nothing more."""
    reason, at_s = caught("vents in silence", limits=Limits())
    assert "stale" in reason
    assert at_s <= 2.0


def test_hello_in_the_middle_of_a_run():
    reason, at_s = caught("hello again")
    assert "hello in the middle of a run" in reason
    assert at_s <= 1.5


def test_pressure_with_the_wrong_sign():
    reason, at_s = caught("wrong sign")
    assert "impossible pressure: -60 mbar" in reason
    assert at_s <= 0.5


def test_a_vent_in_words_only():
    """It says that it has vented, with a pressure of 0, and its samples go on at 60 mbar."""
    seen = []
    with lying("vents in name") as probe:
        assert "lift the probe" in until(probe, Alarm, seen).text
        assert probe.alarm is not None
    assert "overshoot" in next(e for e in seen if isinstance(e, HostVented)).reason


@pytest.mark.parametrize(
    ("lie", "said"), [("refuses to vent", "refuses to vent"), ("vents in name", "does not fall")]
)
def test_a_vent_that_is_refused(lie, said):
    """It says no, or yes, and its pressure rises on."""
    seen = []
    with lying(lie, limits=Limits(stale_s=FORGIVING_S, vent_time_s=FORGIVING_S)) as probe:
        alarm = until(probe, Alarm, seen).text
        assert said in alarm
        assert alarm.endswith("lift the probe")


@pytest.mark.parametrize(
    ("lie", "said"), [("old program", "overshoot: 60 mbar"), ("old times", "ahead of the host's")]
)
def test_samples_of_an_earlier_run(lie, said):
    reason, _ = caught(lie, segments=(ramp(100, 20),))
    assert said in reason


def test_suction_before_the_start():
    """It pulls when it is loaded; or when it is armed, and was told to start."""
    # Loaded or armed already: the vent may come before either is confirmed.
    try:
        reason, _ = caught("streams early", start=False)
    except DriverError as error:
        reason = str(error)
    # Samples are of runs: while it is armed they mean that it runs
    assert "suction of 30 mbar while" in reason or "running and nobody asked" in reason
    # Told to start it says "armed", and runs as a run that nobody announced: it ends as others do
    reason, at_s = caught("answers another")
    assert "overshoot: 60 mbar" in reason
    assert 2.0 < at_s <= 2.5


@pytest.mark.parametrize(
    "lie", ["floods", "floods with lines", pytest.param("babbles", marks=pytest.mark.long)]
)
def test_a_flood(lie):
    """No sample among what comes, or one now and then."""
    reason, _ = caught(lie, limits=Limits(vent_time_s=FORGIVING_S))
    assert "stale" in reason or "at once" in reason


def test_pressure_beyond_the_moment():
    """60 mbar are fine at first, and not after the ramp down, half a second later."""
    program = (ramp(60, 1e5), hold(1), ramp(20, 1e5), hold(3))
    reason, at_s = caught("stays high", segments=program)
    assert "overshoot: 60 mbar" in reason
    assert 1.0 < at_s <= 1.6


@pytest.mark.parametrize(
    ("lie", "said"),
    [("past the end", "segment 7, past the end"), ("back again", "back in segment")],
)
def test_a_segment_that_cannot_be(lie, said):
    reason, _ = caught(lie)
    assert said in reason


@pytest.mark.parametrize(
    ("lie", "said"),
    [("runs ahead", "ahead of the host's"), ("jumps", "ahead of the host's"),
     ("slow", "late"), ("stops", "late")],
)  # fmt: skip
def test_the_clock_of_the_instrument(lie, said):
    """Plausible samples for ever, by a clock that has nothing to do with the host's."""
    reason, _ = caught(lie, segments=(ramp(60, 1e5), hold(50)))
    assert said in reason


@pytest.mark.parametrize("lie", ["stands", "runs backwards"])
def test_a_clock_that_does_not_go_on(lie):
    """A sample that is not later than the one before counts as none: the link is stale."""
    reason, at_s = caught(lie, limits=Limits(), segments=(ramp(60, 1e5), hold(50)))
    assert "stale" in reason
    assert at_s <= 1.0


def test_started_by_itself():
    reason, _ = caught("starts by itself", start=False)
    assert "running and nobody asked" in reason
    reason, _ = caught("starts again")
    assert "armed and nobody asked" in reason


def test_another_program_than_was_asked_for():
    """It reads back what was sent, and then once more: longer. The host follows its own."""
    reason, _ = caught("another program")
    assert "behind the program: still segment 1 (hold)" in reason


def test_no_pause():
    """It pulls on through a pause of the program, but for a sample below 5 mbar twice a second."""
    program = (
        ramp(60, 1e5),
        hold(1.7),
        Segment(SegmentKind.REST, duration_s=0.27),
    ) * 3
    limits = Limits(stale_s=FORGIVING_S, max_suction_s=2)
    reason, _ = caught("no pause", segments=program, limits=limits)
    assert "suction for more than" in reason
    assert "without a pause" in reason


def test_too_much_in_one_visit():
    """What was allowed is refused the second time; what comes all the same is vented."""
    limits = Limits(stale_s=FORGIVING_S, max_dose_mbar_s=150)
    with lying("truth", limits=limits) as probe:
        until(probe, VentConfirmed, [])
        assert probe.dose.suction_mbar_s == pytest.approx(120, abs=2)
        with pytest.raises(LocalProtocolError, match=r"needs a dose of 120.* more than the 150"):
            probe.load(TWO_S, 50)
        with pytest.raises(LocalProtocolError, match="load a program first"):
            probe.arm()
    with lying("truth", limits=limits) as probe:
        until(probe, VentConfirmed, [])
        with pytest.raises(LocalProtocolError, match="allowed in one visit"):
            probe.arm()
    allowed = Limits(stale_s=FORGIVING_S, max_dose_mbar_s=50)
    low = (ramp(52, 1e5), hold(0.9))
    reason, _ = caught("stays high", limits=allowed, segments=low)
    assert "a dose of" in reason


# ---- what a noisy line does to a whole measurement ----------------------------------------------


def test_noisy_line(simulate):
    faults = fault("bit_flip", rate=0.0005) + fault("garbage", rate=2, size=40)
    simulated = simulate(
        "--tcp", "0", faults=faults + fault("drop_bytes", rate=0.0005), speed=5, patient=True
    )
    with Probe(simulated.url, limits=PATIENT) as probe:
        start(probe, (ramp(60, 20), ramp(0, 20)))
        seen = []
        until(probe, VentConfirmed, seen)
        simulated.until_vented()
    samples = [event for event in seen if isinstance(event, Sample)]
    gaps = [event for event in seen if isinstance(event, Gap)]
    assert gaps
    assert [s.sequence for s in samples] == sorted({s.sequence for s in samples})
    assert all(-1 < s.pressure_mbar < 65 for s in samples)


# ---- the table ----------------------------------------------------------------------------------

HAZARDS = (
    "link lost", "host killed", "host hung", "overshoot", "valve stuck", "leak", "no skin contact",
    "frozen sensor", "frozen pressure", "drifting sensor", "stale data",
    "wrong aperture", "wrong units", "wrong firmware", "clock jump", "disk full", "power lost",
    "program that does not end", "suction that goes on", "too high for this moment",
    "segment that cannot be", "the instrument's clock", "started by itself", "another program",
    "suction without a pause", "height that is passed", "height that is never reached",
    "height for an instrument", "too much in one visit", "a last vent that nobody", "another instr",
    "pressure with the wrong sign", "a vent that is refused", "samples of an earlier run",
    "suction before the start", "a flood",
)  # fmt: skip


def table():
    lines = DOCUMENT.read_text(encoding="utf-8").splitlines()
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if "`test_" in line
    ]
    return {row[0].lower(): row for row in rows}


def test_the_table_and_the_tests_agree():
    rows = table()
    assert all(len(row) == 4 and all(row) for row in rows.values())
    assert [hazard for hazard in HAZARDS if not any(name.startswith(hazard) for name in rows)] == []
    named = [name for row in rows.values() for name in re.findall(r"`(test_\w+)`", row[3])]
    here = {name for name in globals() if name.startswith("test_")}
    elsewhere = (DOCUMENT.parents[1] / "tests" / "system" / "test_read_only.py").read_text("utf-8")
    there = {name for name in named if f"def {name}(" in elsewhere}
    assert len(named) == len(set(named))
    assert set(named) - there == here - {"test_the_table_and_the_tests_agree"}
