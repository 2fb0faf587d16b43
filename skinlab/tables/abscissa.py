"""The abscissa of a custom table's curves: pressure, or the time of a program.

Where no effect depends on time, the deflection is a function of the pressure, whatever the program.
Else it is held along one program, with its slope by the pressure: a reading that is a little off
the program is answered at once, and what the skin remembers is the program.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import Program
from skinlab.curves.settings import SAMPLES
from skinlab.errors import NotTrustworthyError
from skinlab.mechanics.fem.suction import EXTENSION_ABOVE, EXTENSION_BELOW_MBAR
from skinlab.tables.settings import NODES, READINGS
from skinlab.tables.splines import basis, inverse

Array = NDArray[np.float64]
Respond = Callable[[PressurePath, Array, Array], Array]
"""Deflections (n,) of a skin along a path, at times and pressures (n,)."""

_PROBE_SHARE = 0.0025  # of the highest pressure: for slopes
_LATE_S = 1e-6


class PressureAbscissa:
    """Nodes of the pressure, its small extensions included."""

    unit = "mbar"

    def __init__(self, high_mbar: float, nodes: int, denser_at_ends: bool) -> None:
        self._high_mbar = high_mbar
        low, high = -EXTENSION_BELOW_MBAR, high_mbar * (1 + EXTENSION_ABOVE)
        self._place = _Place(low, high, nodes, denser_at_ends)
        self.nodes = self._place.nodes
        self.width = len(self.nodes)

    def row(self, respond: Respond) -> Array:
        """Return a skin's curve (width,) on the nodes; NaN where it does not hold."""
        p = self.nodes
        path = PressurePath((0.0, 1.0), (0.0, self._high_mbar))
        return respond(path, np.clip(p / self._high_mbar, 0.0, 1.0), p)

    def covered(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) the nodes reach."""
        p = curve.pressure_mbar
        return np.asarray((p >= self.nodes[0] - 1e-9) & (p <= self.nodes[-1] + 1e-9))

    def along(self, pressure_mbar: Array, time_s: Array | None) -> Array:
        """Return what of pressures and times (u,) the curves run along."""
        del time_s
        return pressure_mbar

    def operator(self, pressure_mbar: Array, time_s: Array | None) -> Array:
        """Return the matrix (u, width) that takes rows to samples."""
        del time_s
        return self._place.matrix(pressure_mbar)


class ProgramAbscissa:
    """Nodes of the time, in each piece of the program for itself; times since its start."""

    unit = "s"

    def __init__(self, program: Program, high_mbar: float, pressure_nodes: int) -> None:
        self._high_mbar, self._program = high_mbar, program
        self._path = PressurePath.of_program(program)
        self._pieces: list[_Place] = []
        knots = zip(self._path.time_s, self._path.pressure_mbar, strict=True)
        for (t0, p0), (t1, p1) in pairwise(knots):
            if t1 - t0 <= _LATE_S:
                continue
            share = abs(p1 - p0) / high_mbar
            nodes = max(NODES.ramp, round(share * pressure_nodes))
            if p1 == p0:
                nodes = max(NODES.hold, pressure_nodes // 2)
            inside = 1e-9 * (t1 - t0)  # a jump at the end belongs to the next piece
            self._pieces.append(_Place(t0 + inside, t1 - inside, nodes, True))
        self.nodes = np.concatenate([piece.nodes for piece in self._pieces])
        self.width = 2 * len(self.nodes)

    def row(self, respond: Respond) -> Array:
        """Return a skin's curve on the nodes and its slopes by the pressure, end to end."""
        t = self.nodes
        on_path, probe = self._path(t), _PROBE_SHARE * self._high_mbar
        rise = respond(self._path, t, on_path + probe) - respond(self._path, t, on_path - probe)
        return np.concatenate([respond(self._path, t, on_path), rise / (2 * probe)])

    def covered(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) follow the program; none after it was left.

        Raises:
            NotTrustworthyError: the curve is of another program.
        """
        since = curve.time_s - curve.time_s[0]
        allowed = max(READINGS.off_mbar, READINGS.off_share * self._high_mbar)
        near = np.abs(curve.pressure_mbar - self._path(since)) <= allowed
        near &= since <= self._path.time_s[-1] + _LATE_S
        away = np.convolve(~near, np.ones(READINGS.stray), "valid") > READINGS.stray - 0.5
        if away.any():
            near[int(np.argmax(away)) :] = False
        if near.sum() < SAMPLES.fewest:
            raise NotTrustworthyError(
                f"{curve.name}: the pressure does not follow the database's program "
                f"{self._program}, which the model's effects depend on"
            )
        return np.asarray(near)

    def along(self, pressure_mbar: Array, time_s: Array | None) -> Array:
        """Return what of pressures and times (u,) the curves run along."""
        del pressure_mbar
        if time_s is None:
            raise NotTrustworthyError(
                f"this database holds along its program {self._program} only, and needs times"
            )
        return time_s

    def operator(self, pressure_mbar: Array, time_s: Array | None) -> Array:
        """Return the matrix (u, width) that takes rows to samples."""
        t = self.along(pressure_mbar, time_s)
        spread = np.zeros((len(t), len(self.nodes)))
        ends = np.array([piece.nodes[-1] for piece in self._pieces])
        which = np.clip(np.searchsorted(ends, t - _LATE_S), 0, len(self._pieces) - 1)
        begin = 0
        for k, piece in enumerate(self._pieces):
            end = begin + len(piece.nodes)
            here = which == k
            spread[here, begin:end] = piece.matrix(t[here])
            begin = end
        off = pressure_mbar - self._path(t)
        return np.hstack([spread, off[:, None] * spread])


Abscissa = PressureAbscissa | ProgramAbscissa


class _Place:
    """Nodes of one smooth piece, and the cubic spline through them."""

    def __init__(self, low: float, high: float, nodes: int, denser_at_ends: bool) -> None:
        self._low, self._high, self._cosine = low, high, denser_at_ends
        even = np.linspace(0.0, 1.0, nodes)
        share = 0.5 - 0.5 * np.cos(np.pi * even) if denser_at_ends else even
        self.nodes = low + (high - low) * share
        self._even = even

    def matrix(self, at: Array) -> Array:
        """Return the matrix (u, nodes) that takes nodal values to points (u,), ends held."""
        share = np.clip((at - self._low) / (self._high - self._low), 0.0, 1.0)
        if self._cosine:
            share = np.arccos(1.0 - 2.0 * share) / np.pi
        return basis(self._even, share) @ inverse(len(self._even))
