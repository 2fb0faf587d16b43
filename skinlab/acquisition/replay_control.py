"""The pace of a replay: as it was, faster, without waiting, paused, or sample by sample."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from skinlab.errors import InputError

_NAP_S = 0.05  # how long a pause, a step or a stop may go unnoticed
_DUE_S = 1e-6  # less is not waited for: a nap too short for a clock to show would be taken for ever


class ReplayControl:
    """Lets the events of a record through at its pace; `wait` is called by the replay alone.

    All other methods may be called from any thread. `speed` 1 keeps the original times, 10 is ten
    times as fast, None does not wait; the first `ahead_s` are not waited for. `clock` and `sleep`
    are in s.

    Raises:
        InputError: the speed is not positive.
    """

    def __init__(
        self,
        speed: float | None = None,
        *,
        paused: bool = False,
        ahead_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._clock = clock
        self._sleep = sleep
        self._lock = threading.Lock()
        self._speed = _checked(speed)
        self._paused = paused
        self._ahead_s = ahead_s
        self._steps = 0
        self._until_s: float | None = None  # what was recorded before this is not waited for
        self._to_event = False  # nor is any sample
        self._stopped = False
        self._at_s: float | None = None  # time of the record that is reached ...
        self._since_s = 0.0  # ... at this time of the clock

    @property
    def speed(self) -> float | None:
        """How much faster than it was; None: as fast as can be."""
        return self._speed

    @property
    def paused(self) -> bool:
        """Whether nothing goes on but steps."""
        return self._paused

    @property
    def at_s(self) -> float | None:
        """Time of the record that is reached; None: nothing came yet."""
        return self._at_s

    @property
    def stopped(self) -> bool:
        """Whether the replay was ended before its end."""
        return self._stopped

    def set_speed(self, speed: float | None) -> None:
        """Go on at another speed from here.

        Raises:
            InputError: the speed is not positive.
        """
        with self._lock:
            self._settle()
            self._speed = _checked(speed)

    def pause(self) -> None:
        """Stand still."""
        with self._lock:
            self._settle()
            self._paused = True

    def resume(self) -> None:
        """Go on; what was left to wait for at the pause is still waited for."""
        with self._lock:
            self._settle()
            self._paused = False
            self._steps = 0

    def step(self) -> None:
        """Pause, and let through what comes up to the next sample, and that."""
        with self._lock:
            self._settle()
            self._paused = True
            self._steps += 1

    def jump(self, ahead_s: float) -> None:
        """Let the next so many seconds of the record through without waiting."""
        with self._lock:
            self._settle()
            if self._at_s is not None:
                self._until_s = self._at_s + ahead_s

    def to_next_event(self) -> None:
        """Let samples through without waiting until something else comes; then pause."""
        with self._lock:
            self._settle()
            self._to_event = True

    def stop(self) -> None:
        """End the replay."""
        self._stopped = True

    def wait(self, record_time_s: float, *, sample: bool) -> bool:
        """Return once the event recorded at this time is due; False: the replay is to end.

        `sample`: a step ends with it.
        """
        while not self._stopped:
            with self._lock:
                nap_s = self._left(record_time_s, sample)
            if nap_s <= _DUE_S:
                return True
            self._sleep(min(nap_s, _NAP_S))
        return False

    def _left(self, record_time_s: float, sample: bool) -> float:
        """Return how long to wait (s); zero lets the event through."""
        self._settle()
        if self._at_s is None:
            self._at_s = record_time_s
            self._until_s = None if self._ahead_s is None else record_time_s + self._ahead_s
        if self._until_s is not None:
            if record_time_s <= self._until_s:
                self._at_s = max(self._at_s, record_time_s)
                return 0.0
            self._at_s, self._until_s = max(self._at_s, self._until_s), None
        if self._to_event:
            self._at_s = max(self._at_s, record_time_s)
            if not sample:
                self._to_event, self._paused = False, True
            return 0.0
        if self._paused:
            if not self._steps:
                return _NAP_S
            self._steps -= int(sample)
            self._at_s = max(self._at_s, record_time_s)
            return 0.0
        if self._speed is None:
            self._at_s = max(self._at_s, record_time_s)
            return 0.0
        return (record_time_s - self._at_s) / self._speed

    def _settle(self) -> None:
        """Move to where the record is now."""
        now = self._clock()
        if self._at_s is not None and self._speed is not None and not self._paused:
            self._at_s += (now - self._since_s) * self._speed
        self._since_s = now


def _checked(speed: float | None) -> float | None:
    if speed is not None and not 0 < speed < float("inf"):
        raise InputError(f"speed {speed:g}: expected a positive number")
    return speed
