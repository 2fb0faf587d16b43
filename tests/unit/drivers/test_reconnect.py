from __future__ import annotations

import pytest

from drivers.errors import LinkError, RemoteProtocolError
from drivers.reconnect import Backoff, reconnect


class Gone:
    """A probe whose link comes back at the n-th attempt."""

    url = "gone"

    def __init__(self, back_at, error=LinkError):
        self.attempts = 0
        self.back_at = back_at
        self.error = error

    def reopen(self):
        self.attempts += 1
        if self.attempts < self.back_at:
            raise self.error("there is no such port")
        return "hello"


class Time:
    def __init__(self):
        self.now = 0.0
        self.slept = []

    def clock(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def test_it_waits_longer_and_longer():
    probe, time = Gone(back_at=7), Time()
    backoff = Backoff(first_s=0.1, factor=2, most_s=1)
    assert reconnect(probe, backoff, clock=time.clock, sleep=time.sleep) == "hello"
    assert time.slept == pytest.approx([0.1, 0.2, 0.4, 0.8, 1, 1, 1])


def test_it_gives_up():
    probe, time = Gone(back_at=10**9), Time()
    with pytest.raises(LinkError, match="no such port; gave up after 15 s"):
        reconnect(probe, clock=time.clock, sleep=time.sleep)
    assert 15 <= time.now <= 16
    assert probe.attempts == len(time.slept) < 25


def test_it_stops_when_nobody_wants_it():
    probe, time = Gone(back_at=10**9), Time()
    with pytest.raises(LinkError, match="no longer looking"):
        reconnect(probe, clock=time.clock, sleep=time.sleep, stop=lambda: probe.attempts == 3)
    assert probe.attempts == 3


def test_what_is_no_matter_of_the_link_comes_through_at_once():
    probe, time = Gone(back_at=10**9, error=RemoteProtocolError), Time()
    with pytest.raises(RemoteProtocolError):
        reconnect(probe, clock=time.clock, sleep=time.sleep)
    assert probe.attempts == 1


@pytest.mark.parametrize(
    "numbers", [(0, 2, 1, 10), (2, 2, 1, 10), (0.1, 0.5, 1, 10), (0.1, 2, 20, 10)]
)
def test_what_is_no_backoff(numbers):
    with pytest.raises(ValueError, match="sensible"):
        Backoff(*numbers)
