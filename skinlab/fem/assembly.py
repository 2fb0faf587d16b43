"""From displacements to residual and banded tangent, all elements at once.

Total Lagrangian: the gradients of the shape functions are those of the reference configuration and
are computed once. A point's deformation gradient has five components, in the order
(F_rr, F_rz, F_zr, F_zz, F_θθ). The energy W is a function of a = F_rr² + F_rz² + F_zr² + F_zz²,
j = F_rr F_zz − F_rz F_zr and f = F_θθ alone, since I1 = a + f², I2 = j² + a f², J = j f.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.fem.element import Element, line_shape, quadrature, shape
from skinlab.fem.mesh import Mesh
from skinlab.materials.base import Law

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# ∂²j/∂F² for j = F_rr F_zz − F_rz F_zr
_D2J = np.zeros((4, 4))
_D2J[0, 3] = _D2J[3, 0] = 1.0
_D2J[1, 2] = _D2J[2, 1] = -1.0
_EYE4 = np.eye(4)


@dataclass(frozen=True, slots=True)
class State:
    """What one evaluation gives: MPa, mm, N (per full turn, 2π)."""

    energy: float  # stored energy, N mm
    residual: Array  # (dofs,) internal minus external force
    tangent: Array  # (dofs, band + 1): column j holds K[j:j+band+1, j], LAPACK's lower band storage
    load: Array  # (dofs,) external force per MPa of suction
    volume: float  # under the dome, mm³: the pressure's work is the integral of p dV
    j_min: float  # smallest and largest det F at a quadrature point
    j_max: float


class Assembly:
    """The discrete suction problem of one mesh and law: evaluates a State at given unknowns."""

    def __init__(self, mesh: Mesh, element: Element, law: Law, fixed: Index) -> None:
        """Prepare gradients and the sparsity pattern.

        `fixed` are the degrees of freedom (2 node + direction) that do not move.
        """
        self.mesh, self.element, self.law = mesh, element, law
        n_dofs = 2 * len(mesh.nodes)
        free = np.ones(n_dofs, dtype=bool)
        free[fixed] = False
        self.n = int(free.sum())
        equation = np.full(n_dofs, self.n, dtype=np.intp)  # the fixed share a dustbin at the end
        equation[free] = np.arange(self.n)
        self.equation = equation
        self._set_gradients()
        self._set_edges()
        self._set_pattern()

    # ---- preparation ----

    def _set_gradients(self) -> None:
        at, weights = quadrature(self.element.points_1d)
        values, slopes = shape(self.element.nodes, at)
        x = self.mesh.nodes[self.mesh.elements]  # (m, a, 2)
        jacobian = np.einsum("mad,qae->mqde", x, slopes)
        det = np.linalg.det(jacobian)
        gradient = np.einsum("qae,mqed->mqad", slopes, np.linalg.inv(jacobian))
        radius = np.einsum("qa,ma->mq", values, x[..., 0])
        m, q, a = gradient.shape[:3]
        g = np.zeros((m, q, 5, 2 * a))
        g[:, :, 0, 0::2] = gradient[..., 0]
        g[:, :, 1, 0::2] = gradient[..., 1]
        g[:, :, 2, 1::2] = gradient[..., 0]
        g[:, :, 3, 1::2] = gradient[..., 1]
        g[:, :, 4, 0::2] = values / radius[..., None]
        self.gradients = g.reshape(m, q * 5, 2 * a)
        self._gradients_t = np.ascontiguousarray(self.gradients.transpose(0, 2, 1))
        self.volumes = 2 * np.pi * radius * det * weights  # (m, q)
        self.dofs = np.stack([2 * self.mesh.elements, 2 * self.mesh.elements + 1], -1).reshape(
            m, -1
        )

    def _set_edges(self) -> None:
        at, weights = np.polynomial.legendre.leggauss(3)  # exact: the integrand is of degree 5
        n, dn = line_shape(at)
        edges = self.mesh.loaded_edges
        self._edge_dofs = np.stack([2 * edges, 2 * edges + 1], -1).reshape(len(edges), -1)
        self._edge_x = self.mesh.nodes[edges]  # (k, 3, 2)
        w = 2 * np.pi * weights
        # Load f_a = (−∫ N_a r z', ∫ N_a r r'), bilinear in the nodal r and z: f_a = T_abc r_b x_c.
        self._edge_form = np.einsum("q,qa,qb,qc->abc", w, n, n, dn)

    def _set_pattern(self) -> None:
        equations = self.equation[self.dofs]
        edge_equations = self.equation[self._edge_dofs]
        span = equations.max(axis=1, where=equations < self.n, initial=0) - equations.min(axis=1)
        self.band = int(span.max())
        rows, cols, picks = [], [], []
        for eqs in (equations, edge_equations):
            i = np.repeat(eqs[:, :, None], eqs.shape[1], axis=2)
            j = i.transpose(0, 2, 1)
            pick = np.flatnonzero((i >= j) & (i < self.n) & (j < self.n))
            rows.append(i.ravel()[pick])
            cols.append(j.ravel()[pick])
            picks.append(pick)
        self._pick_bulk, self._pick_edge = picks
        row, col = np.concatenate(rows), np.concatenate(cols)
        self._slot = col * (self.band + 1) + (row - col)
        self._equations, self._edge_equations = equations.ravel(), edge_equations.ravel()

    # ---- evaluation ----

    def full(self, unknowns: Array) -> Array:
        """Return displacements (2 nodes,) in mm, the fixed ones zero."""
        return np.asarray(np.append(unknowns, 0.0)[self.equation])

    def deformation_gradients(self, displacements: Array) -> Array:
        """Return F (m, q, 5) at the quadrature points."""
        u = displacements[self.dofs]
        f = np.matmul(self.gradients, u[..., None])[..., 0]
        points: Array = f.reshape(len(u), -1, 5)
        points[..., [0, 3, 4]] += 1.0
        return points

    def evaluate(
        self, unknowns: Array, pressure_mpa: float, parameters: Mapping[str, Any]
    ) -> State | None:
        """Return the State at these unknowns, or None where an element is turned inside out."""
        u = self.full(unknowns)
        f = self.deformation_gradients(u)
        energy, stress, tangent, det = stress_and_tangent(f, self.law, parameters)
        j_min, j_max = float(det.min()), float(det.max())
        if not j_min > 0.0:
            return None
        m = len(self.dofs)
        w = self.volumes
        stress *= w[..., None]
        tangent *= w[..., None, None]
        force = np.matmul(self._gradients_t, stress.reshape(m, -1, 1))[..., 0]
        g = self.gradients.reshape(m, -1, 5, self.dofs.shape[1])
        stiffness = np.matmul(
            self._gradients_t, np.matmul(tangent, g).reshape(m, w.shape[1] * 5, -1)
        )
        load, load_stiffness, volume = self._suction(u)
        internal = _gather(self._equations, force, self.n + 1)[:-1]
        external = _gather(self._edge_equations, load, self.n + 1)[:-1]
        entries = np.concatenate(
            [
                stiffness.ravel()[self._pick_bulk],
                -pressure_mpa * load_stiffness.ravel()[self._pick_edge],
            ]
        )
        band = _gather(self._slot, entries, self.n * (self.band + 1))
        return State(
            energy=float((energy * w).sum()),
            residual=internal - pressure_mpa * external,
            tangent=band.reshape(self.n, self.band + 1),
            load=external,
            volume=volume,
            j_min=j_min,
            j_max=j_max,
        )

    def _suction(self, displacements: Array) -> tuple[Array, Array, float]:
        """Return load (k, 6), its symmetrised derivative (k, 6, 6) per MPa, and the dome's volume.

        The traction of the follower pressure is p n da on the deformed surface; for suction it
        points out of the skin: f_z = ∫ N 2π r r' ds, f_r = −∫ N 2π r z' ds.
        """
        x = self._edge_x + displacements[self._edge_dofs].reshape(-1, 3, 2)
        r, z = x[..., 0], x[..., 1]
        t = self._edge_form
        t_r = np.einsum("abc,kb->kac", t, r)  # ∂f/∂x_c
        t_dr = np.einsum("abc,kc->kab", t, r)  # ∂f/∂r_b through r'
        t_dz = np.einsum("abc,kc->kab", t, z)
        k = len(r)
        load = np.empty((k, 3, 2))
        load[..., 1] = np.einsum("kac,kc->ka", t_r, r)
        load[..., 0] = -np.einsum("kac,kc->ka", t_r, z)
        stiffness = np.zeros((k, 3, 2, 3, 2))
        stiffness[:, :, 1, :, 0] = t_r + t_dr
        stiffness[:, :, 0, :, 1] = -t_r
        stiffness[:, :, 0, :, 0] = -t_dz
        form = stiffness.reshape(k, 6, 6)
        # One edge's form is not symmetric; the sum over the closed surface with a held rim is.
        symmetric = 0.5 * (form + form.transpose(0, 2, 1))
        volume = float(np.einsum("ka,ka->", load[..., 1], z))
        return load.reshape(k, 6), symmetric, volume


def _gather(slots: Index, values: Array, length: int) -> Array:
    """Return the sums (length,) of the values that fall into each slot."""
    return np.asarray(np.bincount(slots, values.ravel(), minlength=length), dtype=float)


def stress_and_tangent(
    f: Array, law: Law, parameters: Mapping[str, Any]
) -> tuple[Array, Array, Array, Array]:
    """Return energy (...), first Piola-Kirchhoff stress (..., 5), tangent (..., 5, 5) and det F.

    `f` has shape (..., 5); energy and stress in MPa. Where det F ≤ 0 the rest has no meaning.
    """
    plane, hoop = f[..., :4], f[..., 4]
    cof = np.stack([f[..., 3], -f[..., 2], -f[..., 1], f[..., 0]], axis=-1)
    a = np.einsum("...i,...i->...", plane, plane)
    j = f[..., 0] * f[..., 3] - f[..., 1] * f[..., 2]
    h2 = hoop * hoop
    det = j * hoop
    safe = det if det.min() > 0.0 else np.where(det > 0.0, det, 1.0)
    p = law.potential(a + h2, j * j + a * h2, safe, parameters)

    # First and second derivatives by (a, j, f), by the chain rule through I1, I2, J.
    w_a = p.d_i1 + h2 * p.d_i2
    w_j = 2 * j * p.d_i2 + hoop * p.d_j
    w_f = 2 * hoop * (p.d_i1 + a * p.d_i2) + j * p.d_j
    # ∂/∂(I1, I2, J) of w_a, w_j, w_f
    a1, a2, a3 = p.d_i1_i1 + h2 * p.d_i1_i2, p.d_i1_i2 + h2 * p.d_i2_i2, p.d_i1_j + h2 * p.d_i2_j
    j1, j2, j3 = (
        2 * j * p.d_i1_i2 + hoop * p.d_i1_j,
        2 * j * p.d_i2_i2 + hoop * p.d_i2_j,
        2 * j * p.d_i2_j + hoop * p.d_j_j,
    )
    f1, f2, f3 = (
        2 * hoop * (p.d_i1_i1 + a * p.d_i1_i2) + j * p.d_i1_j,
        2 * hoop * (p.d_i1_i2 + a * p.d_i2_i2) + j * p.d_i2_j,
        2 * hoop * (p.d_i1_j + a * p.d_i2_j) + j * p.d_j_j,
    )
    w_aa = a1 + h2 * a2
    w_aj = 2 * j * a2 + hoop * a3
    w_jj = 2 * p.d_i2 + 2 * j * j2 + hoop * j3
    w_af = 2 * hoop * p.d_i2 + 2 * hoop * (a1 + a * a2) + j * a3
    w_jf = p.d_j + 2 * hoop * (j1 + a * j2) + j * j3
    w_ff = 2 * (p.d_i1 + a * p.d_i2) + 2 * hoop * (f1 + a * f2) + j * f3

    stress = np.empty_like(f)
    stress[..., :4] = 2 * w_a[..., None] * plane + w_j[..., None] * cof
    stress[..., 4] = w_f
    tangent = np.empty((*f.shape, 5))
    # 4 w_aa F Fᵀ + 2 w_aj (F cofᵀ + cof Fᵀ) + w_jj cof cofᵀ as one sum of two outer products
    left = 4 * w_aa[..., None] * plane + 2 * w_aj[..., None] * cof
    right = 2 * w_aj[..., None] * plane + w_jj[..., None] * cof
    block = left[..., :, None] * plane[..., None, :]
    block += right[..., :, None] * cof[..., None, :]
    block += 2 * w_a[..., None, None] * _EYE4
    block += w_j[..., None, None] * _D2J
    tangent[..., :4, :4] = block
    coupling = 2 * w_af[..., None] * plane + w_jf[..., None] * cof
    tangent[..., :4, 4] = coupling
    tangent[..., 4, :4] = coupling
    tangent[..., 4, 4] = w_ff
    return p.energy, stress, tangent, det
