"""Try again and again to get a lost link back, ever more slowly, and not for ever."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import LinkError
from drivers.events import Hello
from drivers.probe import Probe


@dataclass(frozen=True, slots=True)
class Backoff:
    """How long to wait before each attempt, and when to give up.

    Raises ValueError for waits that do not make sense.
    """

    first_s: float = 0.1
    factor: float = 2.0
    most_s: float = 1.0
    give_up_s: float = 15.0  # since the first attempt

    def __post_init__(self) -> None:
        """Refuse what would never end, or hammer the port."""
        if not (0 < self.first_s <= self.most_s <= self.give_up_s and self.factor >= 1):
            raise ValueError(f"not a sensible backoff: {self}")


def reconnect(
    probe: Probe,
    backoff: Backoff = Backoff(),
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] = time.sleep,
    stop: Callable[[], bool] = lambda: False,
) -> Hello:
    """Open `probe` again after its link was lost; see `Probe.reopen`.

    stop: asked before each attempt; true means that nobody wants it any more.
    Raises LinkError (gave up, or stopped), RemoteProtocolError (another instrument is there now).
    """
    begin = clock()
    wait_s = backoff.first_s
    while not stop():
        sleep(wait_s)
        try:
            return probe.reopen()
        except LinkError as error:
            if clock() - begin >= backoff.give_up_s:
                raise LinkError(f"{error}; gave up after {backoff.give_up_s:g} s") from error
        wait_s = min(wait_s * backoff.factor, backoff.most_s)
    raise LinkError(f"no longer looking for {probe.url}")
