"""How to get a lost link back: again and again, ever more slowly, and not for ever."""

from __future__ import annotations

from dataclasses import dataclass


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
