"""A root by Brent's method, without scipy: its import takes longer than many a curve."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

_RTOL = 4.0 * sys.float_info.epsilon
_MOST_STEPS = 100


def brentq(
    f: Callable[[float], float], a: float, b: float, xtol: float = 2e-12, rtol: float = _RTOL
) -> float:
    """Return where `f` is zero between `a` and `b`: step by step what `scipy.optimize.brentq` does.

    R. P. Brent, Algorithms for Minimization Without Derivatives (1973), chapters 3 and 4. `x_far`
    is the end of the bracket that is opposite to `x`, the best so far.

    Raises:
        ValueError: `f` does not change its sign in between, or a hundred steps do not suffice.
    """
    x_before, x, x_far = float(a), float(b), 0.0
    f_before, f_x, f_far = f(x_before), f(x), 0.0
    before = step = 0.0
    if f_before == 0:
        return x_before
    if f_x == 0:
        return x
    if not (f_before < 0 < f_x or f_x < 0 < f_before):
        raise ValueError(f"no change of sign between {a:g} and {b:g}")
    for _ in range(_MOST_STEPS):
        if f_before != 0 and (f_before < 0) != (f_x < 0):
            x_far, f_far = x_before, f_before
            before = step = x - x_before
        if abs(f_far) < abs(f_x):
            x_before, x, x_far = x, x_far, x
            f_before, f_x, f_far = f_x, f_far, f_x
        delta = (xtol + rtol * abs(x)) / 2
        half = (x_far - x) / 2
        if f_x == 0 or abs(half) < delta:
            return x
        tried = math.inf
        if abs(before) > delta and abs(f_x) < abs(f_before):
            if x_before == x_far:  # a secant
                tried = -f_x * (x - x_before) / (f_x - f_before)
            else:  # the inverse parabola
                to_before = (f_before - f_x) / (x_before - x)
                to_far = (f_far - f_x) / (x_far - x)
                tried = (
                    -f_x
                    * (f_far * to_far - f_before * to_before)
                    / (to_far * to_before * (f_far - f_before))
                )
        if 2 * abs(tried) < min(abs(before), 3 * abs(half) - delta):
            before, step = step, tried
        else:
            before = step = half
        x_before, f_before = x, f_x
        x += step if abs(step) > delta else math.copysign(delta, half)
        f_x = f(x)
    raise ValueError(f"no root between {a:g} and {b:g} in {_MOST_STEPS} steps")
