"""From displacements to residual and banded tangent, all elements at once.

Total Lagrangian: the gradients of the shape functions are those of the reference configuration and
are computed once. A point's deformation gradient has five components, in the order
(F_rr, F_rz, F_zr, F_zz, F_θθ). The energy W is a function of a = F_rr² + F_rz² + F_zr² + F_zz²,
j = F_rr F_zz − F_rz F_zr and f = F_θθ alone, since I1 = a + f², I2 = j² + a f², J = j f.

Elements with dilatation modes see, in place of J, its projection J̄ on the constants or the linear
functions of the element (Nagtegaal, Parks and Rice 1974; Simo, Taylor and Pister 1985). The stored
energy is ∫ W(F) − U(J) + U(J̄), with U(J) the law's energy of a pure dilatation F = J^(1/3) 1, so
that any law can be used; for W = W_iso + U it is ∫ W_iso(F) + U(J̄).

All of it but the dilatation modes is also in `kernel.c`, which is used where it was compiled.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem import kernel
from skinlab.mechanics.fem.banded import Banded, KernelBanded, LapackBanded
from skinlab.mechanics.fem.element import (
    Element,
    dilatation_basis,
    line_shape,
    quadrature,
    shape_at_points,
)
from skinlab.mechanics.fem.mesh import Mesh
from skinlab.mechanics.materials.base import HasPotential

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_EDGE_POINTS = np.polynomial.legendre.leggauss(3)  # exact: the integrand is of degree 5


@dataclass(frozen=True, slots=True)
class State:
    """What one evaluation gives: MPa, mm, N (per full turn, 2π)."""

    stored: Callable[[], float]  # energy, N mm
    residual: Array  # (dofs,) internal minus external force
    matrix: Banded  # the tangent's symmetric part
    load: Array  # (dofs,) external force per MPa of suction
    volume: float  # under the dome, mm³: the pressure's work is the integral of p dV
    j_min: float  # smallest and largest det F at a quadrature point
    j_max: float
    skew: tuple[Array, float] | None  # see `Assembly._rim_terms`; None where the rim is held
    deformation: Array  # (5, m, q) deformation gradients
    least_acoustic: Callable[[], float]  # least `ellipticity` over the points, MPa

    @property
    def energy(self) -> float:
        """Stored energy, N mm: few ask."""
        return self.stored()

    @property
    def tangent(self) -> Array:
        """(dofs, band + 1): column j holds K[j:j+band+1, j], LAPACK's lower band storage."""
        return self.matrix.lower


class Assembly:
    """The discrete suction problem of one mesh and law: evaluates a State at given unknowns."""

    def __init__(
        self,
        mesh: Mesh,
        element: Element,
        law: HasPotential,
        fixed: Index,
        *,
        compiled: bool = True,
    ) -> None:
        """Prepare gradients and the sparsity pattern.

        `fixed` are the degrees of freedom (2 node + direction) that do not move. The compiled inner
        loops are used where they are there, unless `compiled` is False.
        """
        self.mesh, self.element, self.law = mesh, element, law
        n_dofs = 2 * len(mesh.nodes)
        free = np.ones(n_dofs, dtype=bool)
        free[fixed] = False
        self.n = int(free.sum())
        equation = np.full(n_dofs, self.n, dtype=np.intp)  # the fixed share a dustbin at the end
        equation[free] = np.arange(self.n)
        self.equation = equation
        self._start = np.ones((3, 1, 1))  # F_rr, F_zz, F_θθ where nothing has moved
        self._set_gradients()
        self._set_edges()
        self._set_pattern()
        library = kernel.library() if compiled and not element.dilatation_modes else None
        self._kernel = None if library is None else self._prepared_kernel(library)

    @property
    def compiled(self) -> bool:
        """Whether the compiled inner loops are used."""
        return self._kernel is not None

    # ---- preparation ----

    def _prepared_kernel(self, library: ctypes.CDLL) -> kernel.Kernel:
        m, q = self.volumes.shape
        return kernel.Kernel(
            library,
            gradients=self._scalar_gradients.reshape(m, 3, q, -1),
            volumes=self.volumes,
            start=np.broadcast_to(self._start[..., 0], (3, m)),
            element=self.mesh.elements,
            equations=self.equation[self.dofs],
            unknowns=self.n,
            band=self.band,
            edge_form=self._edge_form,
            edge_place=self._edge_x,
            edge=self.mesh.loaded_edges,
            edge_equations=self.equation[self._edge_dofs],
        )

    def _set_gradients(self) -> None:
        at, weights = quadrature(self.element.points_1d)
        values, slopes = shape_at_points(self.element.nodes, self.element.points_1d)
        r, z = np.moveaxis(self.mesh.nodes[self.mesh.elements], 2, 0)  # (m, a) each
        by_xi, by_eta = slopes[..., 0], slopes[..., 1]  # (q, a)
        r_xi, r_eta, z_xi, z_eta = (
            (x @ by.T)[..., None] for x in (r, z) for by in (by_xi, by_eta)
        )  # (m, q, 1)
        det, radius = r_xi * z_eta - r_eta * z_xi, (r @ values.T)[..., None]
        # F takes half of the products when u_r and u_z are kept apart: rows ∂N/∂r, ∂N/∂z, N/r.
        m, q = len(r), len(weights)
        rows = np.empty((m, 3, q, r.shape[1]))
        by_r, by_z, hoop = rows[:, 0], rows[:, 1], rows[:, 2]
        np.multiply(z_eta / det, by_xi, out=by_r)
        by_r -= z_xi / det * by_eta
        np.multiply(r_xi / det, by_eta, out=by_z)
        by_z -= r_eta / det * by_xi
        np.divide(values, radius, out=hoop)
        self._scalar_gradients = rows.reshape(m, 3 * q, -1)
        self.volumes = 2 * np.pi * (radius * det)[..., 0] * weights  # (m, q)
        self.dofs = np.stack([2 * self.mesh.elements, 2 * self.mesh.elements + 1], -1).reshape(
            m, -1
        )
        # J̄ = projection @ J, by weights, on the element's dilatation modes: (m, q, q)
        if self.element.dilatation_modes:
            basis = dilatation_basis(self.element.dilatation_modes, at)
            weighted = basis.T * self.volumes[:, None]
            self._projection = basis @ np.linalg.solve(weighted @ basis, weighted)

    @cached_property
    def _gradients(self) -> Array:
        """∂F/∂u (m, q, 5, 2 a)."""
        m, q = self.volumes.shape
        by_r, by_z, hoop = np.moveaxis(self._scalar_gradients.reshape(m, 3, q, -1), 1, 0)
        g = np.zeros((m, q, 5, 2 * by_r.shape[-1]))
        g[:, :, 0, 0::2] = g[:, :, 2, 1::2] = by_r
        g[:, :, 1, 0::2] = g[:, :, 3, 1::2] = by_z
        g[:, :, 4, 0::2] = hoop
        return g

    @cached_property
    def _gradients_t(self) -> Array:
        m, q, _, dofs = self._gradients.shape
        by_dof = self._gradients.reshape(m, q * 5, dofs).transpose(0, 2, 1)
        return np.ascontiguousarray(by_dof)

    def prestrained(self, stretches: Array, factor: Array) -> Assembly:
        """Return the same problem for tissue that was strained before.

        `stretches` (2, m) are those in the plane and through the thickness, F0 = diag(s, λ, s), of
        each element: the energy per volume of this mesh is W(F F0)/det F0. `factor` (m,) multiplies
        it.
        """
        new = copy(self)
        plane, through = stretches[:, :, None, None]
        for known in ("_gradients", "_gradients_t"):
            new.__dict__.pop(known, None)
        m, q = self.volumes.shape
        new._scalar_gradients = self._scalar_gradients * np.repeat(
            np.stack([plane, through, plane], axis=1)[..., 0, 0], q, axis=1
        )[..., None]  # fmt: skip
        new._start = np.stack([plane, through, plane])[..., 0]
        det = (plane**2 * through)[..., 0]
        new.volumes = self.volumes * factor[:, None] / det
        if self._kernel is not None:
            new._kernel = self._kernel.of_tissue(
                new._scalar_gradients.reshape(m, 3, q, -1), new.volumes, new._start[..., 0]
            )
        return new

    def _set_edges(self) -> None:
        edges = self.mesh.loaded_edges
        self._edge_dofs = np.stack([2 * edges, 2 * edges + 1], -1).reshape(-1, 6)
        self._edge_x = self.mesh.nodes[edges]  # (k, 3, 2)
        self._edge_form = np.tile(_edge_form(1.0), (len(edges), 1, 1, 1))
        self._rim: tuple[Array, Array] | None = None
        if not len(edges):
            return
        end = _where(self._edge_x[-1, :, 0], self.mesh.loaded_to_mm)
        if end < 1.0:  # the load ends within the last one
            self._edge_form[-1] = _edge_form(end)
        values = line_shape(np.array([end]))[0][0]
        equations = self.equation[self._edge_dofs[-1]].reshape(3, 2)
        moves = (equations < self.n) & (np.abs(values) > 1e-12)[:, None]
        if moves.any(axis=0).all():
            e = np.zeros((2, self.n + 1))
            np.add.at(e[0], equations[:, 0], values)
            np.add.at(e[1], equations[:, 1], values)
            self._rim = values, e[:, :-1]

    def _set_pattern(self) -> None:
        equations = self.equation[self.dofs]
        edge_equations = self.equation[self._edge_dofs]
        span = equations.max(axis=1, where=equations < self.n, initial=0) - equations.min(axis=1)
        self.band = int(span.max())
        self._equations, self._edge_equations = equations.ravel(), edge_equations.ravel()

    @cached_property
    def _pattern(self) -> tuple[Index, Index, Index]:
        """Which entries of elements' and edges' matrices count, and where they go in the band."""
        rows, cols, picks = [], [], []
        for dofs in (self.dofs, self._edge_dofs):
            eqs = self.equation[dofs]
            i = np.repeat(eqs[:, :, None], eqs.shape[1], axis=2)
            j = i.transpose(0, 2, 1)
            pick = np.flatnonzero((i >= j) & (i < self.n) & (j < self.n))
            rows.append(i.ravel()[pick])
            cols.append(j.ravel()[pick])
            picks.append(pick)
        row, col = np.concatenate(rows), np.concatenate(cols)
        return picks[0], picks[1], col * (self.band + 1) + (row - col)

    # ---- evaluation ----

    def full(self, unknowns: Array) -> Array:
        """Return displacements (2 nodes,) in mm, the fixed ones zero."""
        with_fixed = np.zeros(self.n + 1)
        with_fixed[:-1] = unknowns
        return with_fixed[self.equation]

    def deformation_gradients(self, displacements: Array) -> Array:
        """Return F (5, m, q) at the quadrature points."""
        if self._kernel is not None:
            return self._kernel.strain(displacements).f
        m, q = self.volumes.shape
        u = displacements.reshape(-1, 2)[self.mesh.elements]  # (m, a, 2)
        parts = np.matmul(self._scalar_gradients, u).reshape(m, 3, q, 2)
        f = np.empty((5, m, q))
        f[0], f[1], f[4] = parts[:, 0, :, 0], parts[:, 1, :, 0], parts[:, 2, :, 0]
        f[2], f[3] = parts[:, 0, :, 1], parts[:, 1, :, 1]
        f[[0, 3, 4]] += self._start
        return f

    def evaluate(
        self,
        unknowns: Array,
        pressure_mpa: float,
        parameters: Mapping[str, Any],
        stress_2pk: Array | None = None,
    ) -> State | None:
        """Return the State at these unknowns, or None where an element is turned inside out.

        `stress_2pk` (4, m, q), in the order rr, rz, zz, θθ and in MPa, is a second Piola-Kirchhoff
        stress that is there besides the law's (what relaxation has left); the energy has its part
        ½ S : C.
        """
        u = self.full(unknowns)
        if self._kernel is not None:
            return self._evaluate_compiled(self._kernel, u, pressure_mpa, parameters, stress_2pk)
        f = self.deformation_gradients(u)
        energy, stress, moduli, det = stress_and_tangent(f, self.law, parameters)
        if stress_2pk is not None:
            energy = energy + _add_stress(f, stress_2pk, stress, moduli)
        j_min, j_max = float(det.min()), float(det.max())
        if not j_min > 0.0:
            return None
        w = self.volumes
        m, q = w.shape
        consistent = moduli
        if self.element.dilatation_modes:
            projected = self._project(f, det, stress, moduli, parameters)
            if projected is None:
                return None
            stored, stress, consistent, rank = projected
            energy = energy + stored
        weighted = np.ascontiguousarray((w * consistent).reshape(25, -1).T).reshape(m, q, 5, 5)
        products = np.matmul(weighted, self._gradients).reshape(m, q * 5, -1)
        stiffness = np.matmul(self._gradients_t, products)
        if self.element.dilatation_modes:
            stiffness += rank
        forces = np.ascontiguousarray((w * stress).reshape(5, -1).T).reshape(m, -1, 1)
        force = np.matmul(self._gradients_t, forces)
        load, load_stiffness, volume = self._suction(u)
        internal = _gather(self._equations, force, self.n + 1)[:-1]
        external = _gather(self._edge_equations, load, self.n + 1)[:-1]
        bulk, edge, slot = self._pattern
        entries = np.concatenate(
            [
                stiffness.ravel()[bulk],
                -pressure_mpa * load_stiffness.ravel()[edge],
            ]
        )
        band = _gather(slot, entries, self.n * (self.band + 1))
        return State(
            skew=self._rim_terms(u),
            stored=lambda: float((energy * w).sum()),
            residual=internal - pressure_mpa * external,
            matrix=LapackBanded(band.reshape(self.n, self.band + 1)),
            load=external,
            volume=volume,
            j_min=j_min,
            j_max=j_max,
            deformation=f,
            least_acoustic=lambda: float(ellipticity(moduli).min()),
        )

    def _evaluate_compiled(
        self,
        compiled: kernel.Kernel,
        u: Array,
        pressure_mpa: float,
        parameters: Mapping[str, Any],
        stress_2pk: Array | None,
    ) -> State | None:
        strain = compiled.strain(u)
        if not strain.j_min > 0.0:
            return None
        form = self.law.form(parameters)
        if form is None:
            i1, i2, det = strain.invariants
            potential = self.law.potential(i1, i2, det, parameters)
            energy = kernel.Energy.of(potential, self.volumes.shape)
        else:
            energy = compiled.potential(strain, form)
        f = strain.f

        def stored() -> float:
            found = energy.stored(self.volumes)
            if stress_2pk is not None:
                work = 0.5 * (first_stress(f, stress_2pk) * f).sum(axis=0)
                found += float(np.vdot(self.volumes, work))
            return found

        band, internal, external, volume = compiled.assemble(
            u, strain, energy, stress_2pk, pressure_mpa
        )
        return State(
            skew=self._rim_terms(u),
            stored=stored,
            residual=internal - pressure_mpa * external,
            matrix=KernelBanded(compiled, band),
            load=external,
            volume=volume,
            j_min=strain.j_min,
            j_max=strain.j_max,
            deformation=f,
            least_acoustic=lambda: compiled.ellipticity(strain, energy, stress_2pk),
        )

    def virtual_work(
        self,
        unknowns: Array,
        direction: Array,
        pressure_mpa: float,
        sums: Sequence[Sequence[tuple[float, Mapping[str, Any]]]],
    ) -> Array | None:
        """Return the residual's work (k,) along a direction (dofs,), N mm per mm of it.

        Of each of `sums`: internal forces, a factor and the energy's parameters of each, less the
        suction's. With the compiled loops parameters may be arrays (k, 1, 1), or those of k forms:
        then a sum is k of them. None where an element is turned inside out.
        """
        if self._kernel is None:
            found = np.zeros(len(sums))
            for k, terms in enumerate(sums):
                load = np.zeros(self.n)
                for factor, parameters in terms:
                    state = self.evaluate(unknowns, 0.0, parameters)
                    if state is None:
                        return None
                    found[k] += factor * (state.residual @ direction)
                    load = state.load
                found[k] -= pressure_mpa * (load @ direction)
            return found
        u = self.full(unknowns)
        strain = self._kernel.strain(u)
        if not strain.j_min > 0.0:
            return None
        changes, load = self._kernel.rates(u, strain, self.full(direction))
        work = []
        for terms in sums:
            total: Any = -pressure_mpa * (load @ direction)
            for factor, parameters in terms:
                form = self.law.form(parameters)
                if form is not None:
                    total = total + factor * self._kernel.work(strain, changes, form)
                    continue
                i1, i2, det = strain.invariants
                by_invariants = self.law.first_derivatives(i1, i2, det, parameters)
                for slope, change in zip(by_invariants, changes, strict=True):
                    if np.shape(slope) == change.shape:
                        total = total + factor * np.vdot(slope, change)
                    else:  # several, or a constant
                        total = total + factor * (slope * change).sum(axis=(-2, -1))
            work.append(np.atleast_1d(total))
        return np.concatenate(work)

    def forces(self, f: Array, stress_2pk: Array) -> Array:
        """Return the internal forces (dofs,) of a second Piola-Kirchhoff stress (4, m, q), in N."""
        m = len(self.mesh.elements)
        stress = self.volumes * first_stress(f, stress_2pk)
        columns = np.ascontiguousarray(stress.reshape(5, -1).T).reshape(m, -1, 1)
        return _gather(self._equations, np.matmul(self._gradients_t, columns), self.n + 1)[:-1]

    def _project(
        self, f: Array, det: Array, stress: Array, moduli: Array, parameters: Mapping[str, Any]
    ) -> tuple[Array, Array, Array, Array] | None:
        """Put J̄ in place of J in the energy of dilatation.

        Return what that adds to the energy (m, q), the new stress and moduli, and the part of the
        element stiffness (m, 2 a, 2 a) that couples the points of an element; None where J̄ ≤ 0.
        """
        mean = np.matmul(self._projection, det[..., None])[..., 0]
        if not mean.min() > 0.0:
            return None
        here, d_here, dd_here = dilatation(self.law, det, parameters)
        there, d_there, dd_there = dilatation(self.law, mean, parameters)
        weights = self.volumes
        # The projection is its own transpose under the weights.
        pressure = np.matmul(self._projection, d_there[..., None])[..., 0] - d_here
        hoop = f[4]
        by_f = np.stack([f[3] * hoop, -f[2] * hoop, -f[1] * hoop, f[0] * hoop, det / hoop])
        stress = stress + pressure * by_f
        moduli = moduli - dd_here * by_f[:, None] * by_f
        for i, k, second in (
            (0, 3, hoop),
            (1, 2, -hoop),
            (0, 4, f[3]),
            (1, 4, -f[2]),
            (2, 4, -f[1]),
            (3, 4, f[0]),
        ):
            moduli[i, k] += pressure * second
            moduli[k, i] += pressure * second
        by_u = np.einsum("imq,mqik->mqk", by_f, self._gradients)
        rows = np.matmul(self._projection, by_u)
        rank = np.matmul(rows.transpose(0, 2, 1), (weights * dd_there)[..., None] * rows)
        return there - here, stress, moduli, rank

    def _suction(self, displacements: Array) -> tuple[Array, Array, float]:
        """Return load (k, 6), its symmetrised derivative (k, 6, 6) per MPa, and the dome's volume.

        The traction of the follower pressure is p n da on the deformed surface; for suction it
        points out of the skin: f_z = ∫ N 2π r r' ds, f_r = −∫ N 2π r z' ds.
        """
        x = self._edge_x + displacements[self._edge_dofs].reshape(-1, 3, 2)
        r, z = x[..., 0], x[..., 1]
        t = self._edge_form
        t_r = np.einsum("kabc,kb->kac", t, r)  # ∂f/∂x_c
        t_dr = np.einsum("kabc,kc->kab", t, r)  # ∂f/∂r_b through r'
        t_dz = np.einsum("kabc,kc->kab", t, z)
        k = len(r)
        load = np.empty((k, 3, 2))
        load[..., 1] = np.einsum("kac,kc->ka", t_r, r)
        load[..., 0] = -np.einsum("kac,kc->ka", t_r, z)
        stiffness = np.zeros((k, 3, 2, 3, 2))
        stiffness[:, :, 1, :, 0] = t_r + t_dr
        stiffness[:, :, 0, :, 1] = -t_r
        stiffness[:, :, 0, :, 0] = -t_dz
        form = stiffness.reshape(k, 6, 6)
        # One edge's form is not symmetric; the sum over the closed surface with a held rim is,
        # and with a rim that moves the rest is `_rim_terms`.
        symmetric = 0.5 * (form + form.transpose(0, 2, 1))
        volume = float(np.einsum("ka,ka->", load[..., 1], z))
        return load.reshape(k, 6), symmetric, volume

    def _rim_terms(self, displacements: Array) -> tuple[Array, float] | None:
        """Return (e_r, e_z) and π r: the load's derivative has the part π r (e_z e_rᵀ − e_r e_zᵀ).

        Where the load ends on a surface that is free to move, at radius r, its work is no longer
        p times a volume, 2π ∫ r z r' ds: it lacks 2π r z dr there, the form whose derivative is
        2π r dz ∧ dr. e_r and e_z, (2, n), pick the rim's motion out of the unknowns.
        """
        if self._rim is None:
            return None
        values, e = self._rim
        x = self._edge_x[-1, :, 0] + displacements[self._edge_dofs[-1, ::2]]
        return e, float(np.pi * (values @ x))


@lru_cache(maxsize=64)
def _edge_form(end: float) -> Array:
    """Return T (3, 3, 3) of the load on an edge from −1 to `end`, f_a = T_abc r_b x_c.

    That is (−∫ N_a r z', ∫ N_a r r'), bilinear in the nodal r and z.
    """
    gauss, weights = _EDGE_POINTS
    share = 0.5 * (end + 1)
    n, dn = line_shape(-1 + share * (gauss + 1))
    return np.asarray(np.einsum("q,qa,qb,qc->abc", 2 * np.pi * share * weights, n, n, dn))


def _where(r: Array, radius_mm: float) -> float:
    """Return the coordinate in [−1, 1] of an edge (ends, middle) at this radius; 1 if beyond."""
    if r[1] <= radius_mm * (1 + 1e-9):
        return 1.0
    # r(ξ) = r_mid + ξ (r1 − r0)/2 + ξ² ((r0 + r1)/2 − r_mid), and it grows
    a, b, c = 0.5 * (r[0] + r[1]) - r[2], 0.5 * (r[1] - r[0]), r[2] - radius_mm
    return float(-2 * c / (b + np.sqrt(b * b - 4 * a * c)))


def first_stress(f: Array, s: Array) -> Array:
    """Return P = F S (5, ...) of a second Piola-Kirchhoff stress (4, ...): rr, rz, zz, θθ."""
    return np.stack(
        [
            f[0] * s[0] + f[1] * s[1],
            f[0] * s[1] + f[1] * s[2],
            f[2] * s[0] + f[3] * s[1],
            f[2] * s[1] + f[3] * s[2],
            f[4] * s[3],
        ]
    )


def _add_stress(f: Array, s: Array, stress: Array, moduli: Array) -> Array:
    """Add the second Piola-Kirchhoff stress `s` to P and to its moduli; return ½ S : C."""
    part = first_stress(f, s)
    stress += part
    for i, k, component in ((0, 0, 0), (0, 1, 1), (1, 1, 2), (2, 2, 0), (2, 3, 1), (3, 3, 2)):
        moduli[i, k] += s[component]
        if i != k:
            moduli[k, i] += s[component]
    moduli[4, 4] += s[3]
    return np.asarray(0.5 * (part * f).sum(axis=0))


def _gather(slots: Index, values: Array, length: int) -> Array:
    """Return the sums (length,) of the values that fall into each slot."""
    return np.asarray(np.bincount(slots, values.ravel(), minlength=length), dtype=float)


def dilatation(
    law: HasPotential, j: Array, parameters: Mapping[str, Any]
) -> tuple[Array, Array, Array]:
    """Return U(J), the law's energy at F = J^(1/3) 1, and its first and second derivative."""
    third = np.cbrt(j)
    p = law.potential(3 * third**2, 3 * third**4, j, parameters)
    x, y = 2 / third, 4 * third  # dI1/dJ, dI2/dJ
    first = p.d_i1 * x + p.d_i2 * y + p.d_j
    second = (
        p.d_i1_i1 * x * x
        + p.d_i2_i2 * y * y
        + p.d_j_j
        + 2 * (p.d_i1_i2 * x * y + p.d_i1_j * x + p.d_i2_j * y)
        + (p.d_i2 * y - p.d_i1 * x) / (3 * j)
    )
    return p.energy, first, second


def stress_and_tangent(
    f: Array, law: HasPotential, parameters: Mapping[str, Any]
) -> tuple[Array, Array, Array, Array]:
    """Return energy (...), first Piola-Kirchhoff stress (5, ...), tangent (5, 5, ...) and det F.

    `f` has shape (5, ...), components first: then every operation runs over contiguous memory.
    Energy and stress in MPa. Where det F ≤ 0 the rest has no meaning.
    """
    plane, hoop = f[:4], f[4]
    cof = np.stack([f[3], -f[2], -f[1], f[0]])
    a = (plane * plane).sum(axis=0)
    j = f[0] * f[3] - f[1] * f[2]
    h2 = hoop * hoop
    det = j * hoop
    safe = det if det.min() > 0.0 else np.where(det > 0.0, det, 1.0)
    p = law.potential(a + h2, j * j + a * h2, safe, parameters)

    # First and second derivatives by (a, j, f), by the chain rule through I1, I2, J.
    twice_j, twice_hoop = 2 * j, 2 * hoop
    w_a = p.d_i1 + h2 * p.d_i2
    w_j = twice_j * p.d_i2 + hoop * p.d_j
    by_f = p.d_i1 + a * p.d_i2
    # ∂/∂(I1, I2, J) of w_a and w_j, and of by_f, of which w_f = 2 f by_f + j ∂W/∂J is made
    a1, a2, a3 = p.d_i1_i1 + h2 * p.d_i1_i2, p.d_i1_i2 + h2 * p.d_i2_i2, p.d_i1_j + h2 * p.d_i2_j
    j2 = twice_j * p.d_i2_i2 + hoop * p.d_i2_j
    j3 = twice_j * p.d_i2_j + hoop * p.d_j_j
    f1, f2, f3 = p.d_i1_i1 + a * p.d_i1_i2, p.d_i1_i2 + a * p.d_i2_i2, p.d_i1_j + a * p.d_i2_j
    w_aa = a1 + h2 * a2
    w_aj = twice_j * a2 + hoop * a3
    w_jj = 2 * p.d_i2 + twice_j * j2 + hoop * j3
    w_af = twice_hoop * (p.d_i2 + a1 + a * a2) + j * a3
    w_jf = p.d_j + twice_hoop * (twice_j * f2 + hoop * f3) + j * j3
    w_ff = 2 * by_f + twice_hoop * (twice_hoop * (f1 + a * f2) + 2 * j * f3) + j * j * p.d_j_j

    stress = np.empty_like(f)
    stress[:4] = 2 * w_a * plane + w_j * cof
    stress[4] = twice_hoop * by_f + j * p.d_j
    tangent = np.empty((5, *f.shape))
    # 4 w_aa F Fᵀ + 2 w_aj (F cofᵀ + cof Fᵀ) + w_jj cof cofᵀ as one sum of two outer products
    left = 4 * w_aa * plane + 2 * w_aj * cof
    right = 2 * w_aj * plane + w_jj * cof
    block = tangent[:4, :4]
    np.multiply(left[:, None], plane, out=block)
    block += right[:, None] * cof
    for i in range(4):
        block[i, i] += 2 * w_a
    for i, k in ((0, 3), (3, 0)):  # ∂²j/∂F²
        block[i, k] += w_j
    for i, k in ((1, 2), (2, 1)):
        block[i, k] -= w_j
    tangent[:4, 4] = tangent[4, :4] = 2 * w_af * plane + w_jf * cof
    tangent[4, 4] = w_ff
    return p.energy, stress, tangent, det


_ANGLES = np.arange(8) * np.pi / 8
_QUADRATIC_FORMS = np.column_stack(
    [np.cos(_ANGLES) ** 2, np.cos(_ANGLES) * np.sin(_ANGLES), np.sin(_ANGLES) ** 2]
)


def ellipticity(moduli: Array) -> Array:
    """Return the least eigenvalue of the acoustic tensor over directions in the r-z plane, MPa.

    `moduli` (5, 5, ...) are ∂²W/∂F²; the result has the shape of what follows. Legendre and
    Hadamard: where it is not positive, a band of intense shear can form inside the material.
    """
    a = moduli.reshape(5, 5, -1)
    rr = _QUADRATIC_FORMS @ np.stack([a[0, 0], 2 * a[0, 1], a[1, 1]])
    zz = _QUADRATIC_FORMS @ np.stack([a[2, 2], 2 * a[2, 3], a[3, 3]])
    rz = _QUADRATIC_FORMS @ np.stack([a[0, 2], a[0, 3] + a[1, 2], a[1, 3]])
    least = 0.5 * (rr + zz) - np.sqrt(0.25 * (rr - zz) ** 2 + rz * rz)
    return np.asarray(least.min(axis=0)).reshape(moduli.shape[2:])
