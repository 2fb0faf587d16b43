"""The compiled inner loops, `kernel.c`, where an installation has them.

They are built when the package is installed where there is a C compiler (`hatch_build.py`).
Without them `assembly.py` computes the same with numpy, in some eight times the time.
"""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Sequence
from copy import copy
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.materials.base import Potential

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_FOLDER = Path(__file__).parent
LIBRARY = _FOLDER / "_kernel.so"
SOURCE = _FOLDER / "kernel.c"
_PADDING = 16  # zeros behind each column of the band: BLOCK + TILE of the source
_BLOCK = 8
_SPARES = 2
_POINTER, _INTEGER, _REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
_addressof, _from_buffer = ctypes.addressof, ctypes.c_char.from_buffer


@cache
def library() -> ctypes.CDLL | None:
    """Return this installation's library, loaded once; None where there is none to use."""
    return load(LIBRARY, SOURCE)


def load(path: Path, source: Path) -> ctypes.CDLL | None:
    """Return the library; None where there is none, or one that is not of this source."""
    try:
        found = ctypes.CDLL(str(path))
        found.skinlab_source.restype = ctypes.c_char_p
        if found.skinlab_source().decode() != hashlib.sha256(source.read_bytes()).hexdigest():
            return None
    except (OSError, AttributeError):
        return None
    found.skinlab_strain.argtypes = [_POINTER] * 3
    found.skinlab_potential.argtypes = [*[_POINTER] * 3, _INTEGER, _POINTER]
    found.skinlab_work.argtypes = [
        *[_POINTER] * 3, _INTEGER, _POINTER, _INTEGER, _INTEGER, _POINTER,
    ]  # fmt: skip
    found.skinlab_assemble.argtypes = [*[_POINTER] * 5, _REAL, *[_POINTER] * 3]
    found.skinlab_rates.argtypes = [_POINTER] * 6
    found.skinlab_ellipticity.argtypes = [_POINTER] * 4
    found.skinlab_factorise.argtypes = [_INTEGER, _INTEGER, _POINTER, _POINTER]
    found.skinlab_solve.argtypes = [
        _INTEGER, _INTEGER, _POINTER, _POINTER, _INTEGER, _INTEGER, _POINTER,
    ]  # fmt: skip
    found.skinlab_tridiagonal.argtypes = [_INTEGER, _POINTER, _POINTER]
    found.skinlab_tridiagonal.restype = _INTEGER
    found.skinlab_bidiagonal.argtypes = [_INTEGER, _INTEGER, _POINTER, _INTEGER, _POINTER]
    found.skinlab_bidiagonal.restype = None
    found.skinlab_grams.argtypes = [
        *[_INTEGER] * 3, _POINTER, *[_INTEGER] * 2, *[_POINTER] * 8, _INTEGER, *[_POINTER] * 2,
    ]  # fmt: skip
    found.skinlab_grams.restype = _INTEGER
    found.skinlab_spline.argtypes = [
        _INTEGER, _INTEGER, *[_POINTER] * 4, _INTEGER, _POINTER, _INTEGER, _POINTER,
    ]  # fmt: skip
    found.skinlab_spline.restype = _INTEGER
    found.skinlab_splines.argtypes = [*[_INTEGER] * 3, *[_POINTER] * 4]
    found.skinlab_domes.argtypes = [*[_INTEGER] * 5, *[_POINTER] * 7]
    found.skinlab_splines.restype = found.skinlab_domes.restype = None
    found.skinlab_strain.restype = found.skinlab_rates.restype = found.skinlab_solve.restype = None
    found.skinlab_potential.restype = found.skinlab_work.restype = None
    found.skinlab_assemble.restype = found.skinlab_ellipticity.restype = _REAL
    found.skinlab_factorise.restype = _INTEGER
    return found


class _Mesh(ctypes.Structure):
    _fields_ = [
        *(
            (name, _INTEGER)
            for name in ("elements", "points", "nodes", "unknowns", "width", "edges")
        ),
        *(
            (name, _POINTER)
            for name in (
                "gradients", "by_node", "volumes", "start", "element", "equations", "slots",
                "edge_form", "edge_place", "edge", "edge_equations",
            )
        ),
    ]  # fmt: skip


class Kernel:
    """One mesh, prepared for the library."""

    def __init__(
        self,
        found: ctypes.CDLL,
        *,
        gradients: Array,  # (m, 3, q, a): ∂N/∂r, ∂N/∂z, N/r
        volumes: Array,  # (m, q)
        start: Array,  # (3, m)
        element: Index,  # (m, a) nodes
        equations: Index,  # (m, 2 a)
        unknowns: int,
        band: int,
        edge_form: Array,
        edge_place: Array,
        edge: Index,
        edge_equations: Index,
    ) -> None:
        """Keep copies in the layout that the library wants."""
        self.library = found
        self.shape, self.unknowns, self.band = volumes.shape, unknowns, band
        self.width = band + 1 + _PADDING
        self._columns = _whole_blocks(unknowns)
        nodes, places = (np.ascontiguousarray(x, dtype=np.int32) for x in (element, equations))
        self._rest: list[NDArray[Any]] = [
            nodes, places, _slots(places.tobytes(), len(places), unknowns, self.width),
            *(np.ascontiguousarray(x, dtype=np.float64) for x in (edge_form, edge_place)),
            *(np.ascontiguousarray(x, dtype=np.int32) for x in (edge, edge_equations)),
        ]  # fmt: skip
        self._set_tissue(gradients, volumes, start)

    def of_tissue(self, gradients: Array, volumes: Array, start: Array) -> Kernel:
        """Return the same mesh of other tissue: see `Assembly.prestrained`."""
        new = copy(self)
        new._set_tissue(gradients, volumes, start)
        return new

    def _set_tissue(self, gradients: Array, volumes: Array, start: Array) -> None:
        real = (gradients, gradients.transpose(0, 1, 3, 2), volumes, start)
        parts = [*(np.ascontiguousarray(x, dtype=np.float64) for x in real), *self._rest]
        self._spare: list[Array] = []
        self._parts = parts  # kept alive: the structure holds addresses only
        m, _, q, a = gradients.shape
        self._mesh = _Mesh(
            m, q, a, self.unknowns, self.width, len(self._rest[-1]), *map(_address, parts)
        )
        self._at = ctypes.addressof(self._mesh)

    def strain(self, displacements: Array) -> Strain:
        """Return the deformation at the points."""
        strain = Strain(self.shape)
        self.library.skinlab_strain(self._at, _address(displacements), strain.at)
        return strain

    def potential(self, strain: Strain, form: Array) -> Energy:
        """Return the energy, and its derivatives, of `materials.energy.TERMS` times a form."""
        energy = Energy(np.empty((len(Potential.__slots__), *self.shape)))
        _, apart = _strides(form)
        self.library.skinlab_potential(self._at, strain.at, _address(form), apart, energy.at)
        return energy

    def assemble(
        self,
        displacements: Array,
        strain: Strain,
        energy: Energy,
        stress_2pk: Array | None,
        pressure_mpa: float,
    ) -> tuple[Array, Array, Array, float]:
        """Return the band as the library has it, internal forces, load (dofs,), and the volume."""
        band = self._spare.pop() if self._spare else np.empty(self._columns * self.width + 1)
        forces = np.zeros((2, self.unknowns + 1))
        extra = None if stress_2pk is None else np.ascontiguousarray(stress_2pk)
        volume = self.library.skinlab_assemble(
            self._at, _address(displacements), strain.at, energy.at, _address(extra),
            pressure_mpa, _address(band), _address(forces[0]), _address(forces[1]),
        )  # fmt: skip
        return band, forces[0, :-1], forces[1, :-1], float(volume)

    def lower(self, band: Array) -> Array:
        """Return the band (dofs, band + 1) without the padding, a copy."""
        columns = band[:-1].reshape(self._columns, self.width)
        return columns[: self.unknowns, : self.band + 1].copy()

    def give_back(self, band: Array) -> None:
        """Keep the memory of a band that is no longer needed: new pages are slow."""
        if len(self._spare) < _SPARES:
            self._spare.append(band)

    def rates(self, displacements: Array, strain: Strain, direction: Array) -> tuple[Array, Array]:
        """Return how I1, I2 and det F change along a direction, and the load per MPa (dofs,).

        The changes (3, m, q) are times the points' volumes.
        """
        changes, load = np.empty((3, *self.shape)), np.zeros(self.unknowns + 1)
        self.library.skinlab_rates(
            self._at, _address(displacements), strain.at, _address(direction), _address(changes),
            _address(load),
        )  # fmt: skip
        return changes, load[:-1]

    def work(self, strain: Strain, changes: Array, form: Array) -> Array:
        """Return how the energies of forms (k, …) or of one change, (k,), with these `rates`."""
        found = np.empty(len(form) if form.ndim == 3 else 1)
        self.library.skinlab_work(
            self._at, strain.at, _address(changes), len(found), _address(form), *_strides(form),
            _address(found),
        )  # fmt: skip
        return found

    def ellipticity(self, strain: Strain, energy: Energy, stress_2pk: Array | None) -> float:
        """Return the least of `admissibility.ellipticity` over all points."""
        extra = None if stress_2pk is None else np.ascontiguousarray(stress_2pk)
        return float(
            self.library.skinlab_ellipticity(self._at, strain.at, energy.at, _address(extra))
        )

    def factorise(self, band: Array) -> Array | None:
        """Turn the band into its Cholesky factor; return 1 / its diagonal, None: there is none."""
        inverse = np.empty(self._columns)
        failed = self.library.skinlab_factorise(
            self.unknowns, self.width, _address(band), _address(inverse)
        )
        return None if failed else inverse

    def solve(self, factor: Array, inverse: Array, right: Array) -> Array:
        """Return solutions (k, dofs) of right sides (k, dofs)."""
        k, n = right.shape
        padded = np.zeros((k, n + self.width))
        padded[:, :n] = right
        self.library.skinlab_solve(
            n, self.width, _address(factor), _address(inverse), k, padded.shape[1], _address(padded)
        )
        return padded[:, :n]


def _whole_blocks(unknowns: int) -> int:
    return -(-unknowns // _BLOCK) * _BLOCK


@lru_cache(maxsize=16)  # what changes a skin seldom changes the numbers of its equations
def _slots(equations: bytes, elements: int, unknowns: int, width: int) -> NDArray[np.int32]:
    """Return where in the band rr, rz and zz of each pair of nodes go: (m, 3, a, a)."""
    both = np.frombuffer(equations, dtype=np.int32).reshape(elements, -1)
    r, z = both[:, 0::2, None], both[:, 1::2, None]
    rows = np.stack(np.broadcast_arrays(r, r, z), axis=1)
    columns = np.stack([x.transpose(0, 2, 1) for x in np.broadcast_arrays(r, z, z)], axis=1)
    low, high = np.minimum(rows, columns), np.maximum(rows, columns)
    outside = _whole_blocks(unknowns) * width  # what is fixed shares a dustbin at the end
    slots = np.where(high < unknowns, low * width + high - low, outside)
    return np.ascontiguousarray(slots, dtype=np.int32)


class Spline:
    """A spline along all axes of a grid, for the library."""

    def __init__(self, knots: Array, sizes: Index, degrees: Index, coefficients: Array) -> None:
        """`knots` of all axes end to end, `coefficients` (all, k), contiguous."""
        self._axes, self._k = len(sizes), coefficients.shape[1]
        self._kept = knots, sizes, degrees, coefficients  # alive as long as their addresses
        self._addresses = [_address(part) for part in self._kept]

    def __reduce__(self) -> tuple[type[Spline], tuple[Any, ...]]:
        return Spline, self._kept  # addresses are of this process

    def __call__(self, points: Array, *, slopes: bool) -> Array | None:
        """Return values (n, k) at points (n, d), or slopes along each axis (n, d, k).

        None where the library cannot.
        """
        found = library()
        if found is None:
            return None
        at = np.ascontiguousarray(points, dtype=np.float64)
        n, k = len(at), self._k
        out = np.empty((n, self._axes, k) if slopes else (n, k))
        knots, sizes, degrees, coefficients = self._addresses
        failed = found.skinlab_spline(
            n, self._axes, sizes, degrees, knots, _address(at), int(slopes), coefficients, k,
            _address(out),
        )  # fmt: skip
        return None if failed else out


def splines(knots: Array, coefficients: Array, at: Array) -> Array | None:
    """Return values (n, m) of n cubic splines (n, k) at points (n, m); None without a library."""
    found = library()
    if found is None:
        return None
    parts = [np.ascontiguousarray(x, dtype=np.float64) for x in (knots, coefficients, at)]
    out = np.empty(at.shape)
    found.skinlab_splines(*at.shape, coefficients.shape[1], *map(_address, parts), _address(out))
    return out


def domes(parts: tuple[Array, Array, Array, Array], at: Array, *, alike: bool) -> Array | None:
    """Return `skinlab.discrepancy.table_domes.Domes` at suctions (n or 1, m); None if it cannot."""
    found = library()
    if found is None:
        return None
    n, cells, _ = parts[0].shape
    every = [np.ascontiguousarray(x, dtype=np.float64) for x in (*parts, at)]
    room, out = np.empty((at.shape[1], 2)), np.empty((n, at.shape[1]))
    found.skinlab_domes(
        n, at.shape[1], cells, len(at), int(alike), *map(_address, every), _address(room),
        _address(out),
    )  # fmt: skip
    return out


def factorise_tridiagonal(diagonal: Array, beside: Array) -> tuple[Array, Array, int] | None:
    """Return d, e and where it fails, as LAPACK's dpttrf; None where there is no library."""
    found = library()
    if found is None:
        return None
    d, e = np.array(diagonal, dtype=np.float64), np.array(beside, dtype=np.float64)
    return d, e, int(found.skinlab_tridiagonal(len(d), _address(d), _address(e)))


def solve_bidiagonal(below: Array, right: Array, *, transposed: bool) -> Array | None:
    """Return the solutions (n, m), see `skinlab.inference.bidiagonal`; None without a library."""
    found = library()
    if found is None:
        return None
    x = np.array(right, dtype=np.float64, order="C")
    beside = np.ascontiguousarray(below, dtype=np.float64)
    found.skinlab_bidiagonal(len(x), x.shape[1], _address(beside), int(transposed), _address(x))
    return x


class Grams(NamedTuple):
    """Covariances of the same samples and the values to be multiplied by their inverses.

    Of `skinlab.inference.covariance.gram_matrices`.
    """

    values: Array  # (u, m1)
    ends: tuple[int, ...]  # of curves
    shapes: Sequence[Array]  # (d) of (u, m2)
    variance: Array  # (d, u)
    square: Array | None  # (d,) variances of processes, if any,
    decay: Array | None  # (d, u) and φ
    which: Index  # (n,) of these d each covariance has
    sizes: Array | None  # (n, m2) of its shapes, if any
    place: Index  # (m1 + m2,) of each column in the sums, -1: it is integrated out


def grams(parts: Grams, whole: Array, log_determinant: Array) -> bool | None:
    """Add what all curves say to the sums (n, w, w) and (n,), in place.

    Return whether all are positive definite; None where the library cannot.
    """
    found = library()
    if found is None:
        return None
    values, variance, square, decay, sizes, *shapes = (
        None if x is None else np.ascontiguousarray(x, dtype=np.float64)
        for x in (
            parts.values, parts.variance, parts.square, parts.decay, parts.sizes, *parts.shapes
        )
    )  # fmt: skip
    ends, which, place = (
        np.array(x, dtype=np.int64) for x in (parts.ends, parts.which, parts.place)
    )
    each = (_POINTER * len(shapes))(*map(_address, shapes))
    failed = found.skinlab_grams(
        len(whole), len(shapes), len(ends), _address(ends), parts.values.shape[1],
        parts.shapes[0].shape[1], _address(values), ctypes.addressof(each), _address(variance),
        _address(square), _address(decay), _address(which), _address(sizes), _address(place),
        whole.shape[1], _address(whole), _address(log_determinant),
    )  # fmt: skip
    return None if failed < 0 else not failed


class Strain:
    """The deformation at the points (m, q), and where the library finds it."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Take memory for it."""
        size = shape[0] * shape[1]
        self._block = np.empty(8 * size + 2)
        self._whole = self._block[:-2].reshape(8, *shape)
        self.at = _address(self._block)

    @property
    def f(self) -> Array:
        """Deformation gradients (5, m, q)."""
        return self._whole[:5]

    @property
    def invariants(self) -> tuple[Array, Array, Array]:
        """I1, I2 and det F (m, q)."""
        _, _, _, _, _, i1, i2, det = self._whole
        return i1, i2, det

    @property
    def j_min(self) -> float:
        """The least det F; not a number where one is not."""
        return float(self._block[-2])

    @property
    def j_max(self) -> float:
        """The largest det F."""
        return float(self._block[-1])


class Energy:
    """An energy and its derivatives (10, m, q), in the order of `Potential`."""

    def __init__(self, values: Array) -> None:
        """Take them as they are."""
        self._values = values  # alive as long as the address
        self.at = _address(values)

    @classmethod
    def of(cls, potential: Potential, shape: tuple[int, int]) -> Energy:
        """Return what a law says at points (m, q)."""
        values = np.empty((len(Potential.__slots__), *shape))
        for here, (_, each) in zip(values, potential.named(), strict=True):
            here[...] = each
        return cls(values)

    def stored(self, volumes: Array) -> float:
        """Return what is stored at points of these volumes, mm³: N mm."""
        return float(np.vdot(volumes, self._values[0]))


def _strides(form: Array) -> tuple[int, int]:
    """Return how far the next form of (k, m or 1, terms) begins, and that of the next element."""
    *_, m, terms = form.shape
    return m * terms, terms if m > 1 else 0


def _address(array: NDArray[np.generic] | None) -> int | None:
    if array is None:
        return None
    memory: Any = array
    try:
        return _addressof(_from_buffer(memory))  # four times as fast
    except (TypeError, ValueError):  # read only, or empty
        return int(array.__array_interface__["data"][0])
