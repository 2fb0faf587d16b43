"""The errors of a campaign's samples, and residuals made independent of one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.records import Record, by_geometry
from skinlab.inference.noise import (
    MESH_REST,
    legendre,
    slope_mm_per_mbar,
)

Array = NDArray[np.float64]

# Relative deviation of the mesh of record from a fine one, by orders of shifted Legendre
# polynomials of p/p_max: what the openings of one skin have in common, and each one's own, root
# mean squares (`python benchmarks/model_error.py --openings`).
MESH_COMMON = (3.4e-4, 2.1e-4, 1.3e-4, 6.1e-5, 4.4e-5, 2.9e-5, 1.9e-5, 1.3e-5)
MESH_OWN = (6.0e-4, 1.7e-4, 8.8e-5, 4.9e-5, 2.9e-5, 2.3e-5, 1.8e-5, 1.2e-5)
# Another program deviates more, but at all openings alike: at the tops of eleven skins 0.15 % in
# common and 0.025 % apart, where a fine mesh of ours does 0.063 and 0.073 % (the same command).
COMMON_FACTOR = 2.4
OWN_FACTOR = 0.5


@dataclass(frozen=True, eq=False)
class Errors:
    """Σ = diag(σ²) + V Vᵀ over all samples of a campaign, end to end."""

    sigma_mm: Array  # (u,)
    q: Array  # (u, m) orthonormal, of the whitened shapes
    s: Array  # (m,)
    ends: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.sigma_mm)

    def whiten(self, residuals_mm: Array) -> Array:
        """Return W r (u, …): independent, of variance 1."""
        flat = residuals_mm.reshape(self.count, -1) / self.sigma_mm[:, None]
        shrink = 1.0 / np.sqrt(1.0 + self.s**2) - 1.0
        flat = flat + self.q @ (shrink[:, None] * (self.q.T @ flat))
        return np.asarray(flat.reshape(residuals_mm.shape))

    def colour(self, whitened: Array) -> Array:
        """Return what `whiten` made these (u, …) from, mm."""
        flat = whitened.reshape(self.count, -1)
        stretch = np.sqrt(1.0 + self.s**2) - 1.0
        flat = flat + self.q @ (stretch[:, None] * (self.q.T @ flat))
        return np.asarray((flat * self.sigma_mm[:, None]).reshape(whitened.shape))

    def without_mesh(self, residuals_mm: Array) -> Array:
        """Return residuals (u,) in standard deviations, less what the mesh probably did."""
        z = residuals_mm / self.sigma_mm
        share = self.s**2 / (1.0 + self.s**2)
        return np.asarray(z - self.q @ (share * (self.q.T @ z)))

    def expected_product(self, apart: int) -> float:
        """Return what noise and mesh alone let the products of `without_mesh` sum up to.

        Of values so many samples apart in the same record: taking the mesh off leaves some less
        than none, Cov = 1 − Q s²/(1+s²) Qᵀ.
        """
        share = self.s**2 / (1.0 + self.s**2)
        return -sum(
            float(np.einsum("um,um,m->", q[apart:], q[:-apart], share)) for q in self.split(self.q)
        )

    def only(self, kept: NDArray[np.bool_]) -> Errors:
        """Return the errors of some of the samples (u,) alone, as one piece."""
        q, s, _ = np.linalg.svd((self.q * self.s)[kept], full_matrices=False)
        return Errors(self.sigma_mm[kept], q, s, (int(kept.sum()),))

    def split(self, values: Array) -> list[Array]:
        """Return values (u, …) by record."""
        return np.split(values, self.ends[:-1])


def errors_of(records: Sequence[Record]) -> Errors:
    """Return the errors: noise, pressure noise through dw/dp, and the discretisation's shapes."""
    sigma, blocks, at = [], [], 0
    starts = np.cumsum([0, *(len(r.curve) for r in records)])
    total = int(starts[-1])
    for record in records:
        w, p = record.curve.deflection_mm, record.pressure_mbar
        slope = slope_mm_per_mbar(p, w) if record.pressure_sd_mbar > 0 else np.zeros(len(w))
        sigma.append(
            np.sqrt(
                (1e-3 * record.noise_um) ** 2
                + (slope * record.pressure_sd_mbar) ** 2
                + (MESH_REST * w) ** 2
            )
        )
        at += len(w)
    orders = len(MESH_OWN)
    common = np.zeros((total, orders))
    for members in by_geometry(records):
        block = np.zeros((total, orders))
        top = max(1e-9, *(float(records[i].pressure_mbar.max()) for i in members))
        for i in members:
            x = np.clip(records[i].pressure_mbar / top, 0.0, 1.0)
            w = records[i].curve.deflection_mm
            shapes = legendre(x, orders) * w[:, None]
            here = slice(starts[i], starts[i + 1])
            block[here] = OWN_FACTOR * np.array(MESH_OWN) * shapes
            common[here] = COMMON_FACTOR * np.array(MESH_COMMON) * shapes
        blocks.append(block)
    blocks.append(common)
    sigma_all = np.concatenate(sigma)
    q, s, _ = np.linalg.svd(np.hstack(blocks) / sigma_all[:, None], full_matrices=False)
    return Errors(sigma_all, q, s, tuple(int(v) for v in starts[1:]))
