"""A difference between the way up and the way back that nobody knows, whatever the rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.effects.base import Array, Values
from skinlab.mechanics.effects.learned import LearnedEffect, Seen, bent, coefficients, sines

_NEAR_MBAR = 5.0  # of the turning point and of rest: there it changes fastest
_SHAPES = 6


class LearnedLoop(LearnedEffect):
    """See the module."""

    name = "learned_loop"
    family = "history"
    meaning = "the way back differs from the way up, at any rate alike, as found from the data"
    formula = (
        "on the way back p + Σ (c_k top + d_k) sin((k − ½) π x), top the highest suction so far, "
        "x = 1/2 + (arsinh((top − p)/5 mbar) − arsinh(p/5 mbar)) / (2 arsinh(top/5 mbar))"
    )
    source = "rate-independent hysteresis: Visintin 1994; Gaussian process"
    physical = True
    bends = True
    order = 2
    parameters = (
        *coefficients(_SHAPES, "", 1.0, 0.05),
        *(replace(p, name=f"d{k}_mbar") for k, p in enumerate(
            coefficients(_SHAPES, "mbar", 100.0, 3.0), start=1
        )),
    )  # fmt: skip
    x_name = "pressure_mbar"
    y_name = "felt_more_mbar"

    def felt(self, path: PressurePath, values: Values) -> PressurePath:
        """Bend the way back."""
        if not any(values[n] for n in self.names):
            return path

        def more(p: Array) -> Array:
            top = np.maximum.accumulate(p)
            return np.where(_falls(p) & (p < top), self._more(p, top, values), 0.0)

        return bent(path, more)

    def abscissa(self, seen: Seen) -> Array:
        """Return suctions up to the highest one."""
        return np.linspace(0.0, seen.pressure_mbar, 41)

    def function(self, at: Array, values: Values) -> Array:
        """Return how much more is felt (m,), mbar, on the way back from the last of these."""
        return self._more(at, at[-1:], values)

    def _more(self, pressure_mbar: Array, top_mbar: Array, values: Values) -> Array:
        top = np.maximum(top_mbar, 1.0)
        since, left = ((v / _NEAR_MBAR) for v in (top - pressure_mbar, pressure_mbar))
        x = 0.5 + 0.5 * (np.arcsinh(since) - np.arcsinh(left)) / np.arcsinh(top / _NEAR_MBAR)
        share = sines(x, values, self.names[:_SHAPES])
        return share * top + sines(x, values, self.names[_SHAPES:])

    def sentence(self, x: Array, y: Array) -> str:
        """Say how far the way back is off."""
        i = int(np.abs(y).argmax())
        what = "more" if y[i] > 0 else "less"
        return (
            "depends on whether the suction rises or falls, at any rate alike: on the way back "
            f"from {x[-1]:.0f} mbar the skin feels {abs(y[i]):.2g} mbar {what} than is read at "
            f"{x[i]:.0f} mbar"
        )


def _falls(pressure: Array) -> NDArray[np.bool_]:
    """Return where (n,) the suction falls, or has fallen before it was held."""
    change = np.diff(pressure, prepend=pressure[:1])
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change)), 0))
    return np.asarray(change[last] < 0, dtype=np.bool_)


EFFECT = LearnedLoop()
