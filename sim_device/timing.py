"""The time of the simulated probe, and of solving it; a process may set it before it makes one."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(slots=True)
class Timing:
    """`clock` gives the host's seconds and never goes back; `keep_alive_s` is the device's.

    `coarse_skin` is for those who look at the wire and not at the skin: it is solved in a tenth of
    the time, and is some micrometres off.
    """

    clock: Callable[[], float] = time.monotonic
    keep_alive_s: float = 0.5  # without a word from the host it vents
    coarse_skin: bool = False


TIMING = Timing()
