"""What the finite elements correct at an anchor, and how it goes on around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NOISE, _SLOPES_NOISE = 1e-6, 1e-4  # variances, of what a correction bends by in a length
_EXACT = 1e-6  # of these
_TREND = 5  # nodes from which a correction goes on beyond
_LITTLE = 0.05  # of the most that relaxes in a curve: of less no share is taken


@dataclass(frozen=True, eq=False)
class Points:
    """Where corrections are known: the anchor first, which is 0, with its slopes.

    Between them they are smooth: a Gaussian process of squared exponential kernel, with slopes
    (Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, ch. 9.4).
    """

    off: Array  # (p, k) the anchor, in lengths of the process
    lengths: Array  # (k,)
    sloped: bool  # whether slopes are known at the others, too

    @classmethod
    def anchor(cls, lengths: Array, *, sloped: bool) -> Points:
        """Return the anchor alone."""
        return cls(np.zeros((1, len(lengths))), lengths, sloped)

    def also(self, off: Array) -> Points:
        """Return these points, and others off the anchor by (n, k)."""
        return replace(self, off=np.vstack([self.off, off / self.lengths]))

    def doubt(self, off: Array) -> Array:
        """Return how little is known (n,) off the anchor by (n, k): 1 far off, 0 at a point."""
        known = self.covariance(off)
        return np.asarray(1.0 - np.einsum("ij,ji->i", known, np.linalg.solve(self._gram, known.T)))

    def weights(self, values: Array, slopes: Array) -> Array:
        """Return weights (d, m) of values (p, m) and their slopes (s, m, k); d = p + s k."""
        each = (slopes * self.lengths).transpose(2, 0, 1).reshape(-1, values.shape[1])
        return np.asarray(np.linalg.solve(self._gram, np.vstack([values, each])))

    @property
    def with_slopes(self) -> int:
        """At how many of them (s) slopes are known, the first ones."""
        return len(self.off) if self.sloped else 1

    def covariance(self, off: Array) -> Array:
        """Return covariances (n, d) of values off the anchor with what is known."""
        apart, kernel = self._kernel(off / self.lengths)
        some = slice(self.with_slopes)
        return np.hstack([kernel, *(apart * kernel[:, :, None])[:, some].transpose(2, 0, 1)])

    def _kernel(self, off: Array) -> tuple[Array, Array]:
        apart = off[:, None] - self.off
        return apart, np.exp(-0.5 * np.square(apart).sum(axis=2))

    @cached_property
    def _gram(self) -> Array:
        """The covariance (d, d) of what is known."""
        count, k = self.off.shape
        s = self.with_slopes
        apart, kernel = (each[:s] for each in self._kernel(self.off))
        rows = [self.covariance(self.off * self.lengths)]
        for i in range(k):
            row = -apart[:, :, i] * kernel
            each = [float(i == j) * kernel + row * apart[:, :, j] for j in range(k)]
            rows.append(np.hstack([row, *(one[:, :s] for one in each)]))
        # The anchor itself is exact: the others give way to it.
        own = np.append(_EXACT, np.ones(count - 1))
        noise = np.concatenate([_NOISE * own, np.tile(_SLOPES_NOISE * own[:s], k)])
        return np.vstack(rows) + np.diag(noise)


@dataclass(eq=False)
class Learnt:
    """A correction at the anchor, and how it changes with the unknowns."""

    value: Array  # (m,)
    slopes: Array  # (m, k)
    more: tuple[Points, Array] | None = field(default=None, init=False)  # with weights

    def at(self, off: Array) -> Array:
        """Return the corrections (n, m) off the anchor by (n, k)."""
        found = np.asarray(self.value + off @ self.slopes.T)
        if self.more is not None:
            points, weights = self.more
            found += points.covariance(off) @ weights
        return found

    def passes(self, points: Points, others: Sequence[Learnt]) -> None:
        """Take values, and slopes if they are known, at all points but the anchor, the first."""
        self.more = None
        beyond = np.zeros((len(points.off), len(self.value)))
        beyond[1:] = np.array([o.value for o in others])
        beyond[1:] -= self.at(points.off[1:] * points.lengths)
        turned = np.zeros((points.with_slopes, *self.slopes.shape))
        if points.sloped:
            turned[1:] = np.array([o.slopes for o in others]) - self.slopes
        self.more = points, points.weights(beyond, turned)

    def move(self, value: Array, off: Array) -> None:
        """Take the next anchor, and learn from it how the correction changes (Broyden 1965)."""
        length = float(off @ off)
        if length > 1e-12:
            self.slopes = self.slopes + np.outer((value - self.at(off)) / length, off)
        self.value, self.more = value, None


@dataclass(frozen=True, eq=False)
class Course:
    """What the finite elements add to a curve that relaxes."""

    share: Learnt  # (n,) of what the table takes for relaxation: more of that, more of this
    rest_mm: Learnt  # (n,) what is no share of it, where it is next to nothing


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
