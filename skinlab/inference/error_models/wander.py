"""A zero that wanders during a curve: the weight of the probe, tape that creeps.

A random walk of 0.5 to 1 µm per root second. Beside errors that last for a while it is what grows
with the time of a curve; in their place it would be cut off where these end, and a slow ramp's
intervals would be too narrow. It begins anew, at zero, with every curve. Its first terms by
Karhunen and Loève are columns of the covariance, the walk's size their common factor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.covariance import block_diagonal
from skinlab.inference.error_models.base import Array, Hyperparameter, Look, Part, Terms
from skinlab.inference.settings import KINDS


@dataclass(frozen=True)
class Wander:
    """A random walk of each curve's zero.

    `fewest_terms` are taken of a short curve, one for each `each_s` of a longer one.
    """

    fewest_terms: int = KINDS.wander_terms
    each_s: float = KINDS.wander_each_s
    most_terms: int | None = KINDS.wander_most
    fewest_samples: int = KINDS.fewest_lasting
    name: str = "wander"
    meaning: str = "a zero that wanders as a random walk during each curve"

    @property
    def prior(self) -> str:
        """What is known before the data."""
        median, below, above = KINDS.wander
        return (
            f"{median:g} µm per root second, {below:g} below and {above:g} above; "
            "as likely there as not"
        )

    def part(self, look: Look) -> Part | None:
        """Return its part; a handful of samples cannot tell it from the skin."""
        samples = look.samples
        if len(samples) < self.fewest_samples:
            return None
        times = np.split(samples.time_s, samples.ends[:-1])
        columns = 1e-3 * block_diagonal([self.shapes(t) for t in times])

        def terms(values: Sequence[float]) -> Terms:
            return Terms(columns_mm=columns, sizes=np.full(columns.shape[1], values[0]))

        median, below, above = KINDS.wander
        size = Hyperparameter("wander_um_per_root_s", median, below, log_sd_above=above)
        return Part(
            self.name, (size,), terms, math.log(KINDS.wander_odds), lasting=True,
            why="zeros wander during curves",
        )  # fmt: skip

    def shapes(self, time_s: Array) -> Array:
        """Return the first terms (n, m) of a walk of 1 per root second from its first time on.

        Each is as large as its standard deviation (Karhunen and Loève). What is left out,
        2/(π²m) of the mean square, grows with the time: a longer curve has more.
        """
        if not len(time_s):
            return np.zeros((0, 0))
        t = time_s - time_s[0]
        whole_s = max(float(t[-1]), 1e-9)
        terms = max(self.fewest_terms, math.ceil(whole_s / self.each_s))
        if self.most_terms is not None:
            terms = min(terms, self.most_terms)
        odd = (np.arange(terms) + 0.5) * np.pi
        return np.asarray(math.sqrt(2.0 * whole_s) / odd * np.sin(np.outer(t / whole_s, odd)))


ERROR_MODEL = Wander()
