"""A play that nobody knows: whatever follows the suction follows late, at any rate alike."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Array, Parameter, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, bent

_HALF_WIDTHS_MBAR = (1.0, 2.0, 4.0, 8.0, 16.0)
_SOURCE = "a sum of plays of unknown weights; their size is learned from the data"


class LearnedPlay(LearnedEffect):
    """See the module.

    `learned_loop` bends the way back alone. A play begins with the way up: nothing moves before it
    is taken up.
    """

    name = "learned_play"
    family = "history"
    meaning = "what is felt follows the suction with a play, as found from the data"
    formula = "p + Σ c_k (P_k − p), P_k the play of half-width r_k, r of 1, 2, 4, 8, 16 mbar"
    source = "Prandtl-Ishlinskii operator: Visintin 1994, Differential Models of Hysteresis, III.2"
    physical = True
    bends = True
    order = 2
    parameters = tuple(
        Parameter(
            f"c{k}", "", f"weight of the play of half-width {r:g} mbar", -3.0, 3.0, 0.0, 0.2,
            _SOURCE,
        )
        for k, r in enumerate(_HALF_WIDTHS_MBAR, start=1)
    )  # fmt: skip
    x_name = "pressure_mbar"
    y_name = "felt_more_mbar"

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Let the suction follow itself with the plays."""
        if not any(values[n] for n in self.names):
            return path
        return bent(path, lambda p: np.maximum(self._more(p, values), -p))

    def abscissa(self, seen: Seen) -> Array:
        """Return suctions up to the highest one."""
        return np.linspace(0.0, seen.pressure_mbar, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return how much more is felt (m,), mbar, on the way back from the last of these."""
        return self._more(np.concatenate([at, at[::-1]]), values)[len(at) :][::-1]

    def _more(self, pressure_mbar: Array, values: Values) -> Array:
        plays = _plays(pressure_mbar.tobytes())
        weights = np.array([values[n] for n in self.names])
        return np.asarray(weights @ plays - weights.sum() * pressure_mbar)

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far what is felt stays behind."""
        i = int(np.abs(y).argmax())
        what = "more" if y[i] > 0 else "less"
        return (
            "follows the suction late, at any rate alike, as where there is play or dry friction: "
            f"on the way back from {x[-1]:.0f} mbar the skin feels {abs(y[i]):.2g} mbar {what} "
            f"than is read at {x[i]:.0f} mbar"
        )


@lru_cache(maxsize=64)
def _plays(pressure_mbar: bytes) -> Array:
    """Return the plays (widths, n) of suctions (n,), which begin at rest."""
    half = np.array(_HALF_WIDTHS_MBAR)
    at, found = np.zeros(len(half)), []
    for p in np.frombuffer(pressure_mbar):
        at = np.clip(at, p - half, p + half)
        found.append(at)
    return np.array(found).T


EFFECT = LearnedPlay()
