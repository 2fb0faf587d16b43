"""Error models together: the covariances of all their settings at once."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck
from skinlab.inference.error_models.base import Part, Terms

Array = NDArray[np.float64]

_KEPT = 4  # columns side by side: of the frequencies that a search has just looked at


@dataclass(frozen=True, eq=False)
class Combination:
    """Error models together."""

    parts: tuple[Part, ...]
    samples_time_s: Array
    ends: tuple[int, ...]
    fixed_mm: Array  # (u, m) columns that are there whatever the parameters
    fixed_mm2: Array  # (u,) variances, likewise
    _known: list[tuple[tuple[Array, ...], Array]] = field(
        default_factory=list, init=False, repr=False
    )

    @property
    def name(self) -> str:
        """Names of the parts."""
        return "+".join(part.name for part in self.parts)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the parts, in no order."""
        return frozenset(part.name for part in self.parts)

    @cached_property
    def scales(self) -> Array:
        """How far the parameters' logarithms (d,) go in one step of a search."""
        return np.array([p.scale for part in self.parts for p in part.parameters])

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for part in self.parts for p in part.parameters)

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Where the columns of each part that has any stand among those of a covariance."""
        at, found = self.fixed_mm.shape[1], {}
        for part in self.parts:
            own = part.terms([1.0] * len(part.parameters)).columns_mm
            if own is not None:
                found[part.name] = slice(at, at + own.shape[1])
                at += own.shape[1]
        return found

    @cached_property
    def lasting(self) -> frozenset[str]:
        """Names of the parts that are correlated in time."""
        return frozenset(part.name for part in self.parts if part.lasting)

    @property
    def log_odds(self) -> float:
        """Before the data, against the parts that are always there."""
        return sum(part.log_odds for part in self.parts)

    @cached_property
    def bound(self) -> Array:
        """What the parts that are scale mixtures add to the log evidence of each sample (u,)."""
        return np.zeros(len(self.fixed_mm2)) + sum(part.bound for part in self.parts)

    @property
    def is_mixture(self) -> bool:
        """Whether a part is a scale mixture."""
        return bool(self.bound.any())

    @property
    def unrounded(self) -> Combination | None:
        """The same before readings are rounded; None where they are not."""
        parts = tuple(part for part in self.parts if part.name != "quantised")
        return replace(self, parts=parts) if len(parts) < len(self.parts) else None

    def log_priors(self, log_values: Array) -> Array:
        """Return the log prior densities (n,) of the parameters' logarithms (n, d)."""
        each = [p for part in self.parts for p in part.parameters]
        found = np.zeros(len(log_values))
        for parameter, values in zip(each, log_values.T, strict=True):
            found += parameter.log_prior(values)
        return found

    def sizes_um(self, log_values: Array) -> dict[str, float]:
        """Return the root mean square over samples of each part's errors, µm, by its name.

        Where tails are heavy independent errors have these with them, and not their scale alone.
        """
        values, found = np.exp(log_values).tolist(), dict(self._constant_um)
        for part, own in zip(self.parts, self._own, strict=True):
            if part.size_um is not None:
                found[part.name] = part.size_um(values[own])
            elif part.parameters:
                found[part.name] = _size_um(part.terms(values[own]), self._tails)
        return found

    @cached_property
    def _constant_um(self) -> dict[str, float]:
        alone = [part for part in self.parts if not part.parameters]
        return {part.name: _size_um(part.terms(()), self._tails) for part in alone}

    @cached_property
    def _tails(self) -> float:
        return math.prod(part.tails for part in self.parts)

    def covariances(self, log_values: Array, *, spread: bool = True) -> list[Covariance]:
        """Return the covariances (n,) at logarithms (n, d)."""
        n, values = len(log_values), np.exp(log_values)
        variance, stretch = self.fixed_mm2, np.ones(1)
        processes: list[OrnsteinUhlenbeck | None] = [None] * n
        columns = [[self.fixed_mm] * n]
        sizes = [np.ones((n, self.fixed_mm.shape[1]))]
        for part, own in zip(self.parts, self._own, strict=True):
            if part.variances is not None:
                variance = variance + part.variances(values[:, own])
                continue
            settings = values[:, own].tolist() if part.parameters else [()]
            each = [part.terms(setting) for setting in settings]
            own_mm2 = np.array([terms.variance_mm2 for terms in each], dtype=float)
            variance = variance + own_mm2.reshape(len(each), -1)
            if len(each) < n:
                each = each * n  # it has no parameters
            processes = [terms.ou or ou for terms, ou in zip(each, processes, strict=True)]
            some = [terms.columns_mm for terms in each if terms.columns_mm is not None]
            if len(some) == n:
                columns.append(some)
                ones = np.ones(some[0].shape[1])
                sizes.append(np.array([ones if t.sizes is None else t.sizes for t in each]))
            if each[0].stretch is not None:
                stretched = [1.0 if terms.stretch is None else terms.stretch for terms in each]
                stretch = stretch * np.array(stretched) * (part.spread if spread else 1.0)
        variance = np.broadcast_to(variance * stretch, (n, len(self.fixed_mm2)))
        whole = columns[0] if len(columns) == 1 else self._side_by_side(columns)
        scale = np.hstack(sizes)
        return [
            Covariance(d, v, self.ends, ou, self.samples_time_s, own)
            for d, v, ou, own in zip(variance, whole, processes, scale, strict=True)
        ]

    def covariance(self, log_values: Array, *, spread: bool = True) -> Covariance:
        """Return the covariance at these logarithms (d,)."""
        return self.covariances(log_values[None], spread=spread)[0]

    @cached_property
    def _own(self) -> list[slice]:
        """Where each part's parameters are among all."""
        ends = np.cumsum([len(part.parameters) for part in self.parts]).tolist()
        return [slice(e - len(p.parameters), e) for e, p in zip(ends, self.parts, strict=True)]

    def _side_by_side(self, columns: list[list[Array]]) -> list[Array]:
        """Return columns (u, m) side by side; the same array where they are the same arrays."""
        known = {tuple(map(id, blocks)): whole for blocks, whole in self._known}
        found: list[Array] = []
        for blocks in zip(*columns, strict=True):
            key = tuple(map(id, blocks))
            if key not in known:
                known[key] = np.concatenate(blocks, axis=1)
                self._known[:] = [(blocks, known[key]), *self._known[: _KEPT - 1]]
            found.append(known[key])
        return found


def _size_um(terms: Terms, tails: float) -> float:
    """Return the root mean square over samples, µm."""
    variance = np.asarray(terms.variance_mm2)
    total = tails * float(np.add.reduce(variance, axis=None)) / variance.size
    if terms.ou is not None:
        total += terms.ou.size_mm**2
    columns = terms.deviations_mm
    if columns is not None and len(columns):
        total += float(columns.ravel() @ columns.ravel()) / len(columns)
    return 1e3 * math.sqrt(total)
