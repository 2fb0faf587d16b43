from __future__ import annotations

from types import SimpleNamespace

import pytest

from drivers import link
from drivers.errors import LinkError


@pytest.mark.parametrize(
    ("url", "name", "baud"),
    [
        ("/dev/ttyUSB0", "/dev/ttyUSB0", 115200),
        ("/dev/ttyUSB0?baud=460800", "/dev/ttyUSB0", 460800),
        ("COM3?baud=9600", "COM3", 9600),
        ("rfc2217://h:1?baud=230400&ign_set_control", "rfc2217://h:1?ign_set_control", 230400),
        ("rfc2217://h:1?timeout=2", "rfc2217://h:1?timeout=2", 115200),
        ("socket://h:1", "socket://h:1", 115200),
        ("sim://?seed=1", "sim://?seed=1", 115200),
    ],
)
def test_the_speed_of_the_line(monkeypatch, url, name, baud):
    opened = []
    monkeypatch.setattr(
        link.serial, "serial_for_url", lambda name, **options: opened.append((name, options))
    )
    link.open_link(url)
    [(opened_name, options)] = opened
    assert (opened_name, options["baudrate"]) == (name, baud)


@pytest.mark.parametrize(
    ("url", "match"),
    [
        ("/dev/ttyUSB0?baud=fast", "baud must be a whole number 1200 to 4000000, not 'fast'"),
        ("/dev/ttyUSB0?baud=10", "baud"),
        ("COM3?bauds=9600", "bauds is not known"),
        ("rfc2217://h:1?baud=1e5", "baud"),
    ],
)
def test_speeds_that_no_line_has(url, match):
    with pytest.raises(LinkError, match=match):
        link.open_link(url)


def test_ports_say_what_pyserial_knows(monkeypatch):
    usb = SimpleNamespace(
        device="/dev/ttyUSB1", description="Suction rig", manufacturer="FTDI", product="FT232R",
        serial_number="A5", vid=0x403, pid=0x6001, location="1-2",
    )  # fmt: skip
    bare = SimpleNamespace(
        device="/dev/ttyS0", description="n/a", manufacturer=None, product=None,
        serial_number=None, vid=None, pid=None, location=None,
    )  # fmt: skip
    monkeypatch.setattr(link.serial_list_ports, "comports", lambda: [usb, bare])
    first, second = link.list_ports()
    assert (first.url, first.details) == ("/dev/ttyS0", "serial port")
    assert second.usb_id == "0403:6001"
    assert second.details == "Suction rig, FTDI, A5, 0403:6001"
