"""The driver against the simulated probe as a process of its own, over a real pty and real TCP."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
import threading

import pytest
import serial
from patience import FORGIVING_S, probe_command, reopen
from serial.rfc2217 import PortManager

from drivers.errors import LinkError, PortFileError, PortUrlError
from drivers.events import (
    Alarm,
    Gap,
    HostVented,
    InstrumentState,
    LinkLost,
    Sample,
    Segment,
    SegmentKind,
    State,
    VentConfirmed,
)
from drivers.link import list_ports, open_link
from drivers.probe import Limits, Probe

PATIENCE_S = 120.0
# The watchdog may not mind that the other process did not run for a while
APART = Limits(stale_s=FORGIVING_S, vent_time_s=FORGIVING_S)
PROGRAM = (
    Segment(SegmentKind.RAMP, target_mbar=60, rate_mbar_per_s=40),
    Segment(SegmentKind.RAMP, target_mbar=0, rate_mbar_per_s=40),
)
LONG = (
    Segment(SegmentKind.RAMP, target_mbar=60, rate_mbar_per_s=400),
    Segment(SegmentKind.HOLD, duration_s=55),
)
needs_pty = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")
WAYS = [pytest.param(("--pty",), marks=needs_pty), ("--tcp", "0")]


if hasattr(os, "openpty"):
    from serial.serialposix import Serial as PosixSerial


class Simulator:
    def __init__(self, *options: str) -> None:
        self.process = subprocess.Popen(
            probe_command(*options, patient=True),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.url = self.process.stdout.readline().strip()
        assert self.url, self.process.stderr.read()

    def end(self, how: signal.Signals) -> tuple[int, str, str]:
        if self.process.poll() is None:
            self.process.send_signal(how)
        out, err = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, out, err


@pytest.fixture(scope="module", params=WAYS, ids=["pty", "tcp"])
def simulator(request):
    simulator = Simulator(*request.param, "--speed", "10", "--seed", "4")
    yield simulator
    assert simulator.end(signal.SIGTERM) == (0, "", "")


def until(probe, wanted, seen):
    while True:
        timed = probe.next_event(PATIENCE_S)
        assert timed is not None, seen[-10:]
        seen.append(timed.event)
        if wanted(timed.event):
            return timed.event


def start(probe, segments):
    probe.open()
    start_again(probe, segments)


def start_again(probe, segments):
    probe.load(segments, 20)
    probe.arm()
    probe.start()


def done(event):
    return isinstance(event, State) and event.reason == "done"


def test_two_runs(simulator):
    with Probe(simulator.url, limits=APART) as probe:
        start(probe, PROGRAM)
        first = []
        until(probe, done, first)
        probe.arm()
        probe.start()
        second = []
        until(probe, done, second)
    for seen in (first, second):
        samples = [event for event in seen if isinstance(event, Sample)]
        assert [s.sequence for s in samples] == list(range(len(samples)))
        assert max(s.pressure_mbar for s in samples) == pytest.approx(60, abs=2)
        assert max(s.deflection_mm for s in samples) > 0.3
        assert any(isinstance(event, VentConfirmed) for event in seen)
        assert not any(isinstance(event, Gap | HostVented | Alarm) for event in seen)


def test_a_host_that_goes_and_comes_back(simulator):
    """A host that vanishes in a run and comes back finds the probe pulling, and vents it."""
    link = open_link(simulator.url)
    probe = Probe(simulator.url, open_link=lambda url: link, limits=APART)
    start(probe, LONG)
    until(probe, lambda e: isinstance(e, Sample) and e.pressure_mbar > 50, [])
    link.close()  # as where the process dies, without a word
    until(probe, lambda e: isinstance(e, LinkLost), [])
    probe.close()
    with Probe(simulator.url, limits=APART) as probe:
        probe.open()
        assert probe.state in {InstrumentState.IDLE, InstrumentState.LOADED}
        probe.load(PROGRAM, 20)
        probe.arm()
        probe.start()
        until(probe, done, [])


class Rfc2217Server(threading.Thread):
    """A terminal server as they are sold: one client, pyserial's own port manager, any port."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self.port = serial.serial_for_url(url, timeout=0)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self.listener.getsockname()[1]}"
        self.over = threading.Event()
        self.baud_rates: list[int] = []

    def write(self, data: bytes) -> None:  # what the port manager has to say to the client
        self.client.sendall(data)

    def run(self) -> None:
        self.client, _ = self.listener.accept()
        with self.client:
            self.client.settimeout(0.002)
            manager = PortManager(self.port, self)
            while not self.over.is_set():
                try:
                    received = self.client.recv(1024)
                    if not received:
                        break
                    self.port.write(b"".join(manager.filter(received)))
                except TimeoutError:
                    pass
                except OSError:
                    break
                self.baud_rates.append(self.port.baudrate)
                data = self.port.read(1024)
                if data:
                    self.client.sendall(b"".join(manager.escape(data)))
        self.port.close()
        self.listener.close()


class Lines(PosixSerial if hasattr(os, "openpty") else object):
    """A pty as a serial port with modem lines, which it has not."""

    cts = dsr = cd = True
    ri = False

    def _update_rts_state(self) -> None:
        pass

    def _update_dtr_state(self) -> None:
        pass


@pytest.fixture
def terminal_server(simulate, monkeypatch):
    monkeypatch.setattr(serial, "Serial", Lines)
    server = Rfc2217Server(simulate("--pty", speed=5, patient=True).url)
    server.start()
    yield server
    server.over.set()
    server.join(PATIENCE_S)
    assert not server.is_alive()


pyserial_is_old = pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")


@needs_pty
@pyserial_is_old
def test_rfc2217(terminal_server):
    """A serial port over the network, with the speed of the line set from here."""
    with Probe(f"{terminal_server.url}?baud=460800", limits=APART) as probe:
        start(probe, PROGRAM)
        seen = []
        until(probe, done, seen)
    samples = [event for event in seen if isinstance(event, Sample)]
    assert [s.sequence for s in samples] == list(range(len(samples)))
    assert not any(isinstance(event, Gap | HostVented | Alarm) for event in seen)
    assert terminal_server.baud_rates[-1] == 460800


@needs_pty
@pyserial_is_old
def test_a_terminal_server_that_goes(terminal_server):
    with Probe(terminal_server.url, limits=APART) as probe:
        start(probe, LONG)
        seen = []
        until(probe, lambda e: isinstance(e, Sample) and e.pressure_mbar > 50, seen)
        terminal_server.over.set()
        until(probe, lambda e: isinstance(e, LinkLost), seen)
        assert "lift the probe" in until(probe, lambda e: isinstance(e, Alarm), seen).text


@needs_pty
def test_one_host_at_a_time():
    simulator = Simulator("--pty")
    with Probe(simulator.url, limits=APART) as probe:
        probe.open()
        with pytest.raises(LinkError, match="another program uses it"):
            open_link(simulator.url)
    assert simulator.end(signal.SIGINT) == (0, "", "")


@pytest.mark.parametrize(
    "way",
    [
        pytest.param(("--pty",), id="pty", marks=needs_pty),
        pytest.param(("--tcp", "0"), id="tcp", marks=pytest.mark.long),
    ],
)
def test_unplugged_in_a_run(way):
    simulator = Simulator(*way)
    with Probe(simulator.url, limits=APART) as probe:
        start(probe, LONG)
        seen = []
        until(probe, lambda e: isinstance(e, Sample) and e.pressure_mbar > 50, seen)
        simulator.end(signal.SIGKILL)
        lost = until(probe, lambda e: isinstance(e, LinkLost), seen)
        assert simulator.url in lost.reason
        alarm = until(probe, lambda e: isinstance(e, Alarm), seen)
        assert "lift the probe" in alarm.text
        with pytest.raises(LinkError, match=simulator.url):
            probe.start()
    with pytest.raises(LinkError, match=simulator.url):
        Probe(simulator.url, limits=APART).open()


def test_in_process(monkeypatch):
    class PowerSkin:
        def prepare(self, aperture_mm, load):
            assert aperture_mm == 4

        def start(self):
            pass

        def deflection_mm(self, time_s, pressure_mbar):
            return 0.05 * pressure_mbar**0.7

    # The finite elements are in the other tests, in a process that keeps them on one core
    monkeypatch.setattr("sim_device.skin.make_skin", lambda *_: PowerSkin())
    with Probe("sim://?seed=2&speed=20&aperture_mm=4") as probe:
        assert probe.open().aperture_mm == 4
        probe.load(PROGRAM, 100)
        probe.arm()
        probe.start()
        seen = []
        until(probe, done, seen)
    assert len([event for event in seen if isinstance(event, Sample)]) > 290


@pytest.mark.long
def test_the_speed_changes_no_byte_of_a_run(simulate):
    faults = '[[fault]]\nkind = "drifting_sensor"\n[[fault]]\nkind = "counter_jump"\nat_s = 1.0\n'
    runs = []
    for speed in (3, 40):
        simulated = simulate("--tcp", "0", "--seed", "7", faults=faults, speed=speed, patient=True)
        received = []
        with Probe(
            simulated.url,
            limits=APART,
            on_bytes=lambda way, _, data, to=received: to.append(data) if way == "rx" else None,
        ) as probe:
            start(probe, PROGRAM)
            until(probe, done, [])
        lines = b"".join(received).split(b"\r\n")
        runs.append([line for line in lines if line.startswith(b"$S,")])
    assert len(runs[0]) > 60
    assert runs[0] == runs[1]


def test_unplugged_in_process(monkeypatch, tmp_path):
    """The device lives on while no host can reach it; opening the URL again finds the same one."""

    class PowerSkin:
        def prepare(self, *arguments):
            pass

        def start(self):
            pass

        def deflection_mm(self, *arguments):
            return 0.05 * arguments[-1] ** 0.7

    monkeypatch.setattr("sim_device.skin.make_skin", lambda *_: PowerSkin())
    faults = tmp_path / "FAULTS.toml"
    faults.write_text('[[fault]]\nkind = "unplug"\nat_s = 1.0\nfor_s = 5.0\n')
    url = f"sim://?seed=2&speed=10&faults={faults}"
    with Probe(url) as probe:
        start(probe, LONG)
        seen = []
        assert "the device is gone" in until(probe, lambda e: isinstance(e, LinkLost), seen).reason
        with pytest.raises(LinkError, match="no such port"):
            probe.reopen()
        reopen(probe)
        until(probe, lambda e: isinstance(e, VentConfirmed), seen)
        probe.acknowledge_alarm()
        start_again(probe, PROGRAM)
        until(probe, done, seen)
    with Probe(url) as probe:  # closed, not unplugged: that was the end of it
        start(probe, LONG)
        until(probe, lambda e: isinstance(e, LinkLost), [])


@pytest.mark.parametrize(
    ("url", "match"),
    [
        ("/dev/no-such-port", "there is no such port"),
        (os.devnull, "not a serial port"),
        ("socket://no-such-host.invalid:77", "there is no such host"),
        ("sim://?skin=/no/such.toml", "/no/such.toml: cannot be read"),
        ("sim://?faults=/no/such.toml", "/no/such.toml: cannot be read"),
    ],
)
def test_what_cannot_be_opened_is_one_sentence(url, match):
    with pytest.raises(LinkError, match=match) as caught:
        open_link(url)
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not isinstance(caught.value, PortUrlError)
    assert isinstance(caught.value, PortFileError) == url.startswith("sim://")


@pytest.mark.parametrize(
    ("url", "match"),
    [
        ("", "expected a port"),
        ("no://such", "not known"),
        ("socket://127.0.0.1", "expected socket://HOST:PORT"),
        ("socket://127.0.0.1:70000", "1 to 65535"),
        ("socket://127.0.0.1:x", "1 to 65535"),
        ("socket://:80", "expected socket://HOST:PORT"),
        ("socket://127.0.0.1:80?speed=9", "options are not understood"),
        ("rfc2217://host", "expected rfc2217://HOST:PORT"),
        ("sim://?seed=x", "seed must be a whole number"),
        ("sim://?seed", "seed"),
        ("sim://?aperture_mm=5", "aperture_mm must be one of"),
        ("sim://?speed=0", "speed"),
        ("sim://?sped=10", "sped"),
        ("sim://?seed=1&seed=2", "twice"),
        ("sim://somewhere", "query"),
    ],
)
def test_a_wrong_url_is_told_from_a_link_that_fails(url, match):
    with pytest.raises(PortUrlError, match=match) as caught:
        open_link(url)
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nobody_listens():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(LinkError, match=f"127.0.0.1:{port}.*connection refused"):
        open_link(f"socket://127.0.0.1:{port}")


def test_somebody_who_is_no_probe():
    with socket.create_server(("127.0.0.1", 0)) as server:
        probe = Probe(f"socket://127.0.0.1:{server.getsockname()[1]}")
        with pytest.raises(LinkError, match="no answer to Identify"):
            probe.open(0.3)
        assert not probe.is_open


def test_ports_are_listed():
    assert all(port.url and port.description for port in list_ports())


@pytest.mark.parametrize(
    ("options", "status", "match"),
    [
        ((), 2, "one of --pty and --tcp"),
        (("--pty", "--tcp", "0"), 2, "one of --pty and --tcp"),
        (("--tcp", "0", "--skin", "/no/such.toml"), 3, "/no/such.toml"),
        (("--tcp", "0", "--faults", "/no/such.toml"), 3, "/no/such.toml"),
        (("--tcp", "0", "--trace", "/no/such/trace"), 3, "/no/such/trace"),
        pytest.param(
            ("--tcp", "0", "--aperture-mm", "5"), 3, "aperture_mm", marks=pytest.mark.long
        ),
    ],
)
def test_bad_input_of_the_process(options, status, match):
    result = subprocess.run(
        [sys.executable, "-m", "sim_device", *options], capture_output=True, text=True, check=False
    )
    assert result.returncode == status
    assert match in result.stderr
    assert result.stdout == ""
    if status == 3:
        assert len(result.stderr.splitlines()) == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
@pytest.mark.parametrize("options", [["--help"], ["--tcp", "0"]])
def test_a_full_disk_is_one_sentence_of_the_process(options):
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "sim_device", *options],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 3
    assert done.stderr == f"sim_device: cannot write: {os.strerror(errno.ENOSPC)}\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_a_trace_on_a_full_disk_is_named():
    command = [sys.executable, "-m", "sim_device", "--tcp", "0", "--trace", "/dev/full"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr.startswith("sim_device: /dev/full: cannot be written (")
