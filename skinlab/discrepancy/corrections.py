"""What the finite elements correct at an anchor, and how it goes on around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BENT = 0.1  # an anchor nearer than that tells of the mesh, not of the bend
_TREND = 5  # nodes from which a correction goes on beyond
_LITTLE = 0.05  # of the most that relaxes in a curve: of less no share is taken


@dataclass(eq=False)
class Learnt:
    """A correction at the anchor, and how it changes with the unknowns."""

    value: Array  # (m,)
    slopes: Array  # (m, k)
    bend: tuple[Array, Array] | None = None  # (k,) along which, and by how much (m,)

    def at(self, off: Array) -> Array:
        """Return the corrections (n, m) off the anchor by (n, k)."""
        found = np.asarray(self.value + off @ self.slopes.T)
        if self.bend is not None:
            along, much = self.bend
            found += np.square(off @ along)[:, None] * much
        return found

    def bends(self, value: Array, off: Array) -> None:
        """Take a value off the anchor by (k,): along the way there it is a parabola.

        A second order of one direction is what follows a valley that turns (Schnabel and Frank
        1984, SIAM J. Numer. Anal. 21:815).
        """
        length = float(off @ off)
        if length > _BENT**2:
            self.bend = off / length, value - self.at(off[None])[0]

    def move(self, value: Array, off: Array) -> None:
        """Take the next anchor, and learn from it how the correction changes (Broyden 1965)."""
        length = float(off @ off)
        if length > 1e-12:
            self.slopes = self.slopes + np.outer((value - self.at(off)) / length, off)
        self.value = value


@dataclass(frozen=True, eq=False)
class Course:
    """What the finite elements add to a curve that relaxes."""

    share: Learnt  # (n,) of what the table takes for relaxation: more of that, more of this
    rest_mm: Array  # (n,) what is no share of it, where it is next to nothing


def share_and_rest(added_mm: Array, memory_mm: Array) -> tuple[Array, Array]:
    """Return what is added (n,) to a curve as a share (n,) of what relaxes (n,), and the rest."""
    small = _LITTLE * np.abs(memory_mm).max()
    if small == 0.0:  # a relaxation that came to nothing
        return np.zeros_like(added_mm), added_mm
    share = added_mm * memory_mm / (np.square(memory_mm) + small**2)
    return share, added_mm - share * memory_mm


def going_on(exact_mm: Array, rough_mm: Array) -> Array:
    """Return a dome (n,) in time that goes on as a rough one does, where it has ended.

    A crease at the tape's edge may end a curve for one millibar, and with it all of the unloading:
    that is as good as any.
    """
    both = np.flatnonzero(np.isfinite(exact_mm) & np.isfinite(rough_mm))
    if not len(both) or rough_mm[both[-1]] == 0.0:
        return exact_mm
    ratio = exact_mm[both[-1]] / rough_mm[both[-1]]
    return np.where(np.isfinite(exact_mm), exact_mm, rough_mm * ratio)


def between(nodes: Array, values: Array, at: Array) -> Array:
    """Return values (n, k) at nodes (k,), at (n, m) or (1, m): linear, constant beyond."""
    rows = np.broadcast_to(at, (len(values), at.shape[1]))
    each = zip(rows, values, strict=True)
    return np.array([np.interp(x, nodes, own) for x, own in each]).reshape(rows.shape)


def read_on(nodes: Array, values: Array, held: NDArray[np.bool_]) -> Array:
    """Return values (m,) that go on straight beyond where they are held.

    Where a skin creases differs between two good meshes by a tenth and more; what the dome does on
    the way there tells more than where it ends.
    """
    beyond = ~held
    if not beyond.any():
        return values
    x, y = nodes[held][-_TREND:], values[held][-_TREND:]
    slope = np.polyfit(x, y, 1)[0] if len(x) > 1 else 0.0
    return np.where(held, values, y[-1] + slope * (nodes - x[-1]))
