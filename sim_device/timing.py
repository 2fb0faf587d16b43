"""The time of the simulated probe; a process may set it before it makes one."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(slots=True)
class Timing:
    """`clock` gives the host's seconds and never goes back; `keep_alive_s` is the device's."""

    clock: Callable[[], float] = time.monotonic
    keep_alive_s: float = 0.5  # without a word from the host it vents


TIMING = Timing()
