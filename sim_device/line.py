"""The line between the firmware and the host, both ways, with what goes wrong on it."""

from __future__ import annotations

from collections import deque

import numpy as np

from sim_device.faults import Kind, Schedule

_DAMAGE: tuple[Kind, ...] = ("bit_flip", "drop_bytes", "duplicate_bytes")
_TIMED: tuple[Kind, ...] = ("stall", "garbage", "unplug")


class Line:
    """Bytes come out as the faults left them. All times are µs on the clock of the faults.

    The outcome depends on the bytes and their times, not on the pieces in which they come.
    """

    def __init__(self, schedule: Schedule, seed: int) -> None:
        self._schedule = schedule
        out_seed, in_seed, noise_seed = np.random.SeedSequence(seed, spawn_key=(1,)).spawn(3)
        self._to_host = _Damage(schedule, np.random.default_rng(out_seed))
        self._to_device = _Damage(schedule, np.random.default_rng(in_seed))
        self._noise = np.random.default_rng(noise_seed)
        self._out = bytearray()
        self._stalled = bytearray()
        self._late: deque[tuple[float, bytes]] = deque()  # samples: when they are due, and what

    def plugged(self, time_us: int) -> bool:
        """Whether there is a line at all."""
        return self._schedule.active("unplug", time_us) is None

    def busy(self, time_us: int, *, ticking: bool) -> bool:
        """Whether time alone may bring bytes, or take the line away or bring it back.

        ticking: the clock of the faults runs.
        """
        if self._schedule.active("garbage", time_us):
            return True
        waiting = bool(self._late or self._stalled)
        return ticking and (waiting or self._schedule.changes_after(time_us, _TIMED))

    def send(self, data: bytes, time_us: int, *, sample: bool) -> None:
        """Take bytes from the firmware; `sample`: they are one reading."""
        late = self._schedule.active("late_samples", time_us)
        if sample and (late is not None or self._late):
            due = time_us + (0.0 if late is None else 1e6 * late.amount)
            if self._late:
                due = max(due, self._late[-1][0])  # they never overtake each other
            self._late.append((due, data))
        else:
            self._carry(data, time_us)

    def receive(self, data: bytes, time_us: int) -> bytes:
        """Give what of the host's bytes gets through to the firmware."""
        return self._to_device.of(data, time_us) if self.plugged(time_us) else b""

    def step(self, time_us: int, step_us: int) -> None:
        """Let time pass: late bytes come, and noise."""
        while self._late and self._late[0][0] <= time_us:
            self._carry(self._late.popleft()[1], time_us)
        garbage = self._schedule.active("garbage", time_us)
        if garbage is not None and self._noise.random() < garbage.often * step_us / 1e6:
            self._carry(self._noise.bytes(int(garbage.amount)), time_us)
        if self._stalled and self._schedule.active("stall", time_us) is None:
            self._out += self._stalled
            self._stalled.clear()

    def take(self) -> bytes:
        """Take what the host can read."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def _carry(self, data: bytes, time_us: int) -> None:
        if not self.plugged(time_us):
            self._stalled.clear()
            return
        damaged = self._to_host.of(data, time_us)
        if self._stalled or self._schedule.active("stall", time_us) is not None:
            self._stalled += damaged
        else:
            self._out += damaged


class _Damage:
    """What happens to single bytes, one way."""

    def __init__(self, schedule: Schedule, rng: np.random.Generator) -> None:
        self._schedule = schedule
        self._rng = rng
        self._dropping = 0  # bytes of the present loss that are still to come
        self._doubling: bytearray | None = None  # what is to be sent twice, so far

    def of(self, data: bytes, time_us: int) -> bytes:
        flip, drop, double = (self._schedule.active(kind, time_us) for kind in _DAMAGE)
        if not (flip or drop or double):
            return data
        out = bytearray()
        for byte in data:
            if drop and not self._dropping and self._rng.random() < drop.often:
                self._dropping = int(drop.amount)
            if self._dropping:
                self._dropping -= 1
                continue
            sent = byte
            if flip and self._rng.random() < flip.often:
                for bit in self._rng.permutation(8)[: int(flip.amount)]:
                    sent ^= 1 << int(bit)
            out.append(sent)
            if double:
                if self._doubling is None and self._rng.random() < double.often:
                    self._doubling = bytearray()
                if self._doubling is not None:
                    self._doubling.append(sent)
                    if len(self._doubling) == int(double.amount):
                        out += self._doubling
                        self._doubling = None
        return bytes(out)
