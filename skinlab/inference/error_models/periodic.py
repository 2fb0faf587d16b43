"""A sine of a found frequency, its amplitude and phase unknown: what breathing and pulse share.

The frequency is looked for where sine and cosine, less what the skin's unknowns absorb, take most
off the residuals' squares (a Lomb-Scargle periodogram with the model's slopes as nuisance: Scargle
1982, Astrophys. J. 263:835). Sine and cosine are columns of the covariance, the model's size their
common standard deviation.

Of one curve the frequency is from there on a parameter like others, integrated out. Of several each
curve has its own, for nobody breathes alike in all: found by the best errors without a sine, and
paid for by what share of the band it might have been in (Laplace).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import block_diagonal
from skinlab.inference.error_models.base import Hyperparameter, Look, Part, Terms
from skinlab.inference.samples import Samples
from skinlab.inference.settings import KINDS

Array = NDArray[np.float64]

_NINE_TENTHS = 1.645
_ABSORBED = 0.02  # of a wave's square
_ROUNDING = 1e-9  # of columns of length 1
_KEPT = 160  # waves of frequencies: those of all settings of a combination, twice


class Sines:
    """Sines of each curve's frequencies, white by the errors, less what the unknowns absorb.

    By the covariance of the best errors so far, where one is known; else by white ones.
    """

    def __init__(self, look: Look, grids_hz: Sequence[Array]) -> None:
        self._samples, self._known = look.samples, look.covariance
        self._basis, self._left, self._variance = _white(look)
        self._place(grids_hz)

    def at(self, grids_hz: Sequence[Array]) -> Sines:
        """Return the same at other frequencies."""
        other = copy(self)
        other._place(grids_hz)
        return other

    def _place(self, grids_hz: Sequence[Array]) -> None:
        known = self._known
        # Of each curve the products of its waves (f, 2, 2), with the basis (r, f, 2), with what is
        # left (f, 2), and the first less what the basis takes: samples are not looked at again.
        self._products: list[tuple[Array, Array, Array, Array]] = []
        for grid, (begin, end) in zip(grids_hz, pairwise((0, *self._samples.ends)), strict=True):
            here = slice(begin, end)
            waves = _waves(self._samples.time_s[here], grid)
            if known is not None and begin < end:
                own = np.zeros(known.count, dtype=bool)
                own[here] = True
                waves = known.only(own).whiten_without_columns(waves)
            whole, taken = _squares(waves), np.tensordot(self._basis[here].T, waves, 1)
            product = np.tensordot(self._left[here], waves, 1)
            self._products.append((whole, taken, product, whole - _squares(taken)))
        # What each curve's sines gain (f,), and the squares of their amplitudes (f,).
        self._alone = [self._of_one(curve) for curve in range(len(self._products))]

    def gain(self, curve: int) -> Array:
        """Return what a sine gains in log likelihood: of a curve's frequencies (f,)."""
        return self._alone[curve][0]

    def _of_one(self, curve: int) -> tuple[Array, Array]:
        """Return the gains (f,) and the squares of the amplitudes (f,)."""
        whole, _, product, square = self._products[curve]
        # A wave that the unknowns absorb all of tells nothing.
        least = _ABSORBED * np.trace(whole, axis1=1, axis2=2)
        square = square + least[:, None, None] * np.eye(2)
        amplitude = self._solved(square, product)
        gain = 0.5 * (product * amplitude).sum(axis=1) / self._variance
        return gain, np.square(amplitude).sum(axis=1)

    @staticmethod
    def _solved(square: Array, product: Array) -> Array:
        if not square.any():  # a curve of which no sample is left
            return np.zeros_like(product)
        return np.asarray(np.linalg.solve(square, product[:, :, None])[:, :, 0])

    def of_each(self) -> tuple[list[int], Array]:
        """Return the best frequency's number of each curve, beside the others' sines, and its gain.

        Repeats tell errors by how they differ, so that a curve's sine is in what is left of the
        others as well: alone a weaker one was found where a stronger one is. Amplitudes have the
        size that was found alone: together these sines may do what the unknowns do, and no more
        is known of them than that.
        """
        best = [int(gain.argmax()) for gain, _ in self._alone]
        at_best = [(gain[i], a[i]) for (gain, a), i in zip(self._alone, best, strict=True)]
        top, amplitude_mm2 = np.array(at_best).T
        square_mm2 = float(amplitude_mm2.mean()) / 2.0
        if not square_mm2 > 0.0:
            return best, top
        order = [int(curve) for curve in np.argsort(-top)]
        seen: list[int] = []  # the strongest first: a weak one beside a wrong one is wrong, too
        for _ in range(KINDS.sine_sweeps):
            before = list(best)
            for curve in order:
                seen = seen if curve in seen else [*seen, curve]
                others = [(i, best[i]) for i in seen if i != curve]
                best[curve], top[curve] = self._beside(others, curve, square_mm2)
            if best == before:
                break
        return best, top

    def _beside(
        self, known: Sequence[tuple[int, int]], curve: int, square_mm2: float
    ) -> tuple[int, float]:
        """Return the best frequency's number of a curve beside other curves' known sines.

        Their amplitudes have this variance, mm², and so has its own (Woodbury).
        """
        ratio = self._variance / square_mm2
        each = [(at, *self._products[i][:3]) for i, at in known]
        taken = np.hstack([self._basis[:0].T, *(v[:, at] for at, _, v, _ in each)])
        inner = block_diagonal([v[at] for at, v, _, _ in each]) - taken.T @ taken
        root = np.linalg.cholesky(inner + np.eye(len(inner)) * ratio)
        left = np.linalg.solve(root, np.concatenate([[], *(v[at] for at, _, _, v in each)]))
        # Waves of two curves have nothing in common but what is taken off both.
        _, own, product, square = self._products[curve]
        cross = np.tensordot(np.linalg.solve(root, taken.T), own, 1)
        square = square - _squares(cross) + np.eye(2) * ratio
        product = product + np.tensordot(left, cross, 1)
        gain = 0.5 * (product * self._solved(square, product)).sum(axis=1) / self._variance
        least = 0.5 * np.linalg.slogdet(square * (square_mm2 / self._variance))[1]
        at = int((gain - least).argmax())
        return at, float(gain[at])


@lru_cache(maxsize=1)  # breathing and pulse are looked for below the same errors
def _white(look: Look) -> tuple[Array, Array, float]:
    """Return the span (u, r) of what may be something else, what is left (u,) and its variance."""
    known = look.covariance
    every = np.column_stack([look.residual_mm, look.slopes])
    if known is not None:
        every = known.whiten_without_columns(np.column_stack([every, known.columns_mm]))
    basis = _span(every[:, 1:])
    left = every[:, 0] - basis @ (basis.T @ every[:, 0])
    if known is not None:
        return basis, left, 1.0
    freedom = max(len(left) - basis.shape[1], 1)
    return basis, left, max(float(left @ left) / freedom, 1e-300)


def _squares(values: Array) -> Array:
    """Return sums of products (f, 2, 2) of values (n, f, 2)."""
    return np.asarray(np.einsum("nfi,nfj->fij", values, values))


def _span(values: Array) -> Array:
    """Return an orthonormal basis (u, r) of columns (u, m).

    Of columns that are the same but for rounding (polynomials, and zeros of each curve) it has none
    that are rounding alone: these took up another part of the waves on every machine.
    """
    length = np.sqrt(np.square(values).sum(axis=0))
    q, s, _ = np.linalg.svd(values / np.where(length > 0.0, length, 1.0), full_matrices=False)
    return np.asarray(q[:, s > _ROUNDING])


def columns(samples: Samples, frequency_hz: float) -> Array:
    """Return sine and cosine (u, 2 × curves), of each curve alone: it has a phase of its own."""
    if samples.curves == 1:
        return _waves(samples.time_s, frequency_hz)
    times = np.split(samples.time_s, samples.ends[:-1])
    return block_diagonal([_waves(t, frequency_hz) for t in times])


def _waves(time_s: Array, frequencies_hz: Array | float) -> Array:
    """Return sine and cosine (n, ..., 2)."""
    angle = 2.0 * np.pi * np.multiply.outer(time_s, frequencies_hz)
    both = np.empty((*angle.shape, 2))
    np.sin(angle, out=both[..., 0])
    np.cos(angle, out=both[..., 1])
    return both


@dataclass(frozen=True)
class Periodic:
    """A sine within a band of frequencies."""

    name: str
    low_hz: float
    high_hz: float
    median_um: float
    meaning: str
    what: str

    @property
    def prior(self) -> str:
        """What is known before the data."""
        hz = self._frequency()
        return (
            f"{self.median_um:g} µm, {KINDS.sine_sd:g}; {hz.median:.2g} Hz, {hz.log_sd:.2g}; "
            f"odds 1 : {1 / KINDS.unusual_odds:g}"
        )

    def _frequency(
        self, start_hz: float | None = None, lasts_s: float | None = None
    ) -> Hyperparameter:
        """Return the frequency's prior, which ends with the band."""
        median = math.sqrt(self.low_hz * self.high_hz)
        reach = 0.5 * math.log(self.high_hz / self.low_hz)
        name = f"{self.name}_hz"
        scale = 1.0 if lasts_s is None else min(KINDS.sine_apart / (lasts_s * median), 1.0)
        sd = reach / _NINE_TENTHS
        return Hyperparameter(name, median, sd, start=start_hz, reach=reach, scale=scale)

    def part(self, look: Look) -> Part | None:
        """Return its part where the record lasts a period and a frequency stands out."""
        samples = look.samples
        if (samples.curves > 1) == (look.covariance is None):
            return None  # of several curves it is looked for below the other errors
        lasts = samples.longest_s
        spacing = lasts / max(len(samples) / max(samples.curves, 1) - 1, 1)
        sparse = spacing * self.low_hz * KINDS.sine_samples > 1.0
        if lasts * self.high_hz < KINDS.sine_periods or sparse:
            return None
        size = Hyperparameter(f"{self.name}_um", self.median_um, KINDS.sine_sd)
        if samples.curves > 1:
            return self._of_each(look, size)
        grid = self._grid_hz(lasts, KINDS.sine_most)
        gain = Sines(look, [grid]).gain(0)
        # White residuals: the largest of several, each of mean 1.
        if gain.max() < KINDS.sine_stands_out:
            return None
        frequency = float(grid[np.argmax(gain)])
        waves = lru_cache(maxsize=_KEPT)(partial(columns, samples))

        def terms(values: Sequence[float]) -> Terms:
            size_um, hz = values
            return Terms(columns_mm=waves(hz), sizes=np.full(2, 1e-3 * size_um))

        return Part(
            self.name,
            (size, self._frequency(frequency, lasts)),
            terms,
            math.log(KINDS.unusual_odds),
            lasting=True,
            why=f"{self.what} at {{{self.name}_hz}} Hz",  # as it is reported, not where it began
            size_um=itemgetter(0),  # sin² + cos² = 1
        )

    def _grid_hz(self, lasts_s: float, most: int) -> Array:
        """Return frequencies that a record so long tells apart."""
        steps = (self.high_hz - self.low_hz) * lasts_s / KINDS.sine_finest
        return np.linspace(self.low_hz, self.high_hz, int(np.clip(steps + 2, 3, most)))

    def _of_each(self, look: Look, size: Hyperparameter) -> Part | None:
        """Return the part of several curves, each with its own frequency, if these stand out."""
        samples = look.samples
        times = np.split(samples.time_s, samples.ends[:-1])
        lasts = np.array([max(np.ptp(t), 1e-9) if len(t) else 1e-9 for t in times])
        grids = [self._grid_hz(each, KINDS.sine_most_of_each) for each in lasts]
        sines = Sines(look, grids)
        stand_out = KINDS.sines_stand_out * samples.curves
        if sum(float(sines.gain(curve).max()) for curve in range(samples.curves)) < stand_out:
            return None
        at, top = sines.of_each()
        best = np.array([grid[i] for grid, i in zip(grids, at, strict=True)])
        # Between them: what is left of a strong sine beside its frequency looks like what lasts.
        near = np.linspace(-1.0, 1.0, KINDS.sine_between)
        grids = [
            np.clip(hz + near * (g[1] - g[0]), self.low_hz, self.high_hz)
            for hz, g in zip(best, grids, strict=True)
        ]
        at, top = sines.at(grids).of_each()
        best = np.array([grid[i] for grid, i in zip(grids, at, strict=True)])
        top = np.maximum(top, 1e-9)
        # About its best frequency a sine's gain falls by (πTΔf)²/3 of itself.
        spread = np.sqrt(1.5 / top) / (np.pi * lasts)
        share = np.minimum(math.sqrt(2.0 * math.pi) * spread / (self.high_hz - self.low_hz), 1.0)
        paid = float(np.log(share).sum())
        if top.sum() + paid < stand_out:
            return None
        waves = block_diagonal([_waves(t, hz) for t, hz in zip(times, best, strict=True)])

        def terms(values: Sequence[float]) -> Terms:
            return Terms(columns_mm=waves, sizes=np.full(waves.shape[1], 1e-3 * values[0]))

        middle = float(np.median(best))
        return Part(
            self.name,
            (size,),
            terms,
            math.log(KINDS.unusual_odds) + paid,
            stated={f"{self.name}_hz": middle},
            lasting=True,
            why=f"{self.what} at about {middle:.2g} Hz",
            size_um=itemgetter(0),
        )
