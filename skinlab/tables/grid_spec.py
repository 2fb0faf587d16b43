"""A grid of a law's parameters at one geometry, as the paper's: Lagrange between its nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.fem.admissibility import NO_LIMITS
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.suction import (
    EXTENSION_ABOVE,
    EXTENSION_BELOW_MBAR,
    MESH_OF_RECORD,
    Geometry,
    assembly_for,
    solve,
)
from skinlab.mechanics.materials import DEFAULT_LAW, get_law
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio, nu_from_ratio
from skinlab.mechanics.model_file import Model
from skinlab.parameters import Space
from skinlab.tables.axes import Coordinate, TableAxis
from skinlab.tables.evaluator import Evaluator
from skinlab.tables.lagrange import TensorLagrange, matrix
from skinlab.tables.settings import INTERPOLATION, VERIFY
from skinlab.tables.table import NOT_MEASURED, Asked, Dataset, Table, plain_point

Array = NDArray[np.float64]
Axes = tuple[tuple[str, tuple[float, ...]], ...]

_ITERATIONS = "newton_iterations"


def published_axes(law: str = DEFAULT_LAW) -> Axes:
    """Return the nodes of the grid that a law's source has.

    Raises:
        InputError: it has none.
    """
    parameters = get_law(law).parameters
    if not all(p.published for p in parameters):
        raise InputError(f"law {law!r} has no published grid")
    return tuple((p.name, p.published) for p in parameters)


@dataclass(frozen=True)
class GridSpec:
    """What is computed. The defaults are the paper's section 2.3."""

    law: str = DEFAULT_LAW
    kappa: KappaConvention = "paper"
    geometry: Geometry = field(default_factory=lambda: Geometry(6.0, 1.0))
    axis: Axes = field(default_factory=published_axes)
    pressure_mbar: tuple[float, ...] = tuple(2.0 * i for i in range(51))

    kind: ClassVar[str] = "grid"
    mesh_name: ClassVar[str] = MESH_OF_RECORD.name
    model: ClassVar[Model | None] = None

    @property
    def fixed_geometry(self) -> Geometry:
        """The opening and thickness; similar ones are answered too."""
        return self.geometry

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes: the law's parameters."""
        return tuple(name for name, _ in self.axis)

    @property
    def nodes(self) -> tuple[Array, ...]:
        """Nodes along each axis."""
        return tuple(np.array(nodes) for _, nodes in self.axis)

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes along each axis."""
        return tuple(len(nodes) for _, nodes in self.axis)

    @property
    def entries(self) -> int:
        """Number of curves."""
        return int(np.prod(self.shape))

    def parameters(self, entry: int) -> tuple[float, ...]:
        """Return the law's parameters of the entry with this flat number."""
        at = np.unravel_index(entry, self.shape)
        return tuple(nodes[int(i)] for (_, nodes), i in zip(self.axis, at, strict=True))

    # ---- build ----

    @property
    def identity(self) -> str:
        """All that the numbers depend on but the solver's version."""
        return f"{self._text} {self.mesh_name}"

    @property
    def rows(self) -> tuple[int, int]:
        """Rows, and numbers in each: deflections, to which mbar it holds, iterations."""
        return self.entries, len(self.pressure_mbar) + 2

    def row(self, entry: int) -> Array:
        """Return one entry: its curve (p,), to which mbar it holds, Newton's iterations.

        Where the skin creases before the last pressure, the curve goes on along the creased branch:
        it supports the interpolation of neighbours that hold. Where it does not, it is followed a
        little beyond the last pressure, so that the limit of what lies between is known too.
        """
        law = get_law(self.law)
        parameters = law.coefficients(law.named(self.parameters(entry)), self.kappa)
        law.check_small_strains(parameters)
        top = max(self.pressure_mbar)
        curve = held = solve(self.geometry, parameters, top, law=self.law)
        if held.stopped:
            unchecked = StepSettings(limits=NO_LIMITS)
            curve = solve(self.geometry, parameters, top, law=self.law, settings=unchecked)
        else:
            further = INTERPOLATION.followed * top
            held = solve(self.geometry, parameters, further, law=self.law, after=curve)
            if held.stopped:  # where exactly depends a little on the steps: on those from zero
                held = solve(self.geometry, parameters, further, law=self.law)
        deflection = curve(np.array(self.pressure_mbar))
        return np.append(deflection, [held.holds_to_mbar, curve.iterations])

    def table(self, rows: Array, solver_version: str, versions: dict[str, str]) -> Table:
        """Return the table made of all rows."""
        del versions
        assembly, _ = assembly_for(self.geometry, MESH_OF_RECORD, self.law)
        return Table(
            self,
            np.ascontiguousarray(rows[:, :-2]).reshape(*self.shape, -1),
            np.ascontiguousarray(rows[:, -2]).reshape(self.shape),
            self.mesh_name,
            solver_version,
            {_ITERATIONS: rows[:, -1].astype(np.int32).reshape(self.shape)},
            {"degrees_of_freedom": assembly.n},
        )

    def difference(self, table: Table, entry: int) -> str:
        """Compute an entry again; return how it differs in a sentence, or ''."""
        row = self.row(entry)
        curve, holds_to = row[:-2], row[-2]
        at = np.unravel_index(entry, self.shape)
        stored = table.values[at]
        same = np.allclose(curve, stored, rtol=0, atol=VERIFY.mm, equal_nan=True)
        if same and abs(holds_to - table.holds_to[at]) <= 0.5:
            return ""
        worst = float(np.nanmax(np.abs(curve - stored)))
        named = zip(self.names, self.parameters(entry), strict=True)
        return f"entry {', '.join(f'{n} {v:g}' for n, v in named)} differs by {worst:.3g} mm"

    # ---- use ----

    def space(self, table: Table, kappa: KappaConvention) -> Space:
        """Return the box between the outermost nodes."""
        del table
        low, high = [n[0] for _, n in self.axis], [n[-1] for _, n in self.axis]
        poisson = get_law(self.law).poisson
        if poisson is not None:
            i = self.names.index(poisson)
            low[i], high[i] = (
                float(nu_from_ratio(kappa_ratio(nu, self.kappa), kappa)) for nu in (low[i], high[i])
            )
        return Space.box(self.names, low, high)

    def covered(self, pressure_mbar: Array) -> NDArray[np.bool_]:
        """Return which pressures (n,) the grid speaks of, its small extensions included."""
        low = min(self.pressure_mbar) - EXTENSION_BELOW_MBAR
        high = max(self.pressure_mbar) * (1 + EXTENSION_ABOVE)
        return np.asarray((pressure_mbar >= low) & (pressure_mbar <= high))

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: the thickness is uncertain.
        """
        _check_sd(curve.setup.thickness_sd_mm or 0.0)
        return self.covered(curve.pressure_mbar)

    def point(self, base: Mapping[str, float], effects: Effects) -> Array:
        """Return the parameters (p,).

        Raises:
            InputError: there are effects.
        """
        return plain_point(self.law, base, effects)

    def evaluator(self, table: Table, asked: Asked) -> Evaluator:
        """Return the grid at these pressures.

        Raises:
            NotTrustworthyError: it does not speak of this geometry or uncertainty.
        """
        _check_sd(asked.thickness_sd_mm)
        own, geometry, kappa = self.geometry, asked.geometry, asked.kappa
        stored, other = own.thickness_mm / own.radius_mm, geometry.thickness_mm / geometry.radius_mm
        if abs(other / stored - 1) > 1e-9:
            raise NotTrustworthyError(
                f"thickness/radius is {other:.4g}, and this database holds for {stored:.4g} only "
                f"(a {own.aperture_mm:g} mm opening on {own.thickness_mm:g} mm of skin)"
            )
        # By dimensional analysis a similar geometry only scales the deflection.
        scale = geometry.radius_mm / own.radius_mm
        coordinates, shared = _components(table)
        at_points = scale * shared @ matrix(self.pressure_mbar, asked.pressure_mbar).T
        q, r = np.linalg.qr(at_points.T)
        poisson = get_law(self.law).poisson
        axes = [
            TableAxis(
                Coordinate("poisson", kappa, self.kappa)
                if name == poisson
                else Coordinate("linear"),
                np.array(nodes),
            )
            for name, nodes in self.axis
        ]
        return Evaluator(
            self.space(table, kappa),
            axes,
            TensorLagrange(self.nodes, (coordinates @ r.T).reshape(*self.shape, -1)),
            q,
            table.holds_to,
            np.minimum(asked.pressure_mbar, max(self.pressure_mbar)),
            # The creased branch, within 1.4 % of a blunter edge's curve, is as good as that.
            goes_on_to=np.where(
                np.isfinite(table.values).all(axis=-1), max(self.pressure_mbar), table.holds_to
            ),
        )

    def between(self, table: Table) -> None:
        """Return None: the paper's grid is as the paper's, and is not compared."""
        del table

    def describe(self, table: Table) -> list[str]:
        """Return what is in it."""
        top = max(self.pressure_mbar)
        short = int((table.holds_to < top).sum())
        lines = [
            f"grid: {self.geometry.aperture_mm:g} mm opening, {self.geometry.thickness_mm:g} mm "
            f"skin, kappa {self.kappa}"
        ]
        for name, axis in (*self.axis, ("pressure_mbar", self.pressure_mbar)):
            lines.append(f"  {name:<22}{axis[0]:g} to {axis[-1]:g}, {len(axis)} nodes")
        lines.append(f"{self.entries} curves, {short} of them hold to less than {top:g} mbar")
        return [*lines, NOT_MEASURED]

    # ---- files ----

    @property
    def _text(self) -> str:
        axes = "".join(f"{name}={nodes!r}, " for name, nodes in self.axis)
        return (
            f"GridSpec(law={self.law!r}, kappa={self.kappa!r}, geometry={self.geometry!r}, "
            f"{axes}pressure_mbar={self.pressure_mbar!r})"
        )

    def head(self, table: Table) -> str:
        """Return what the content hash begins with."""
        facts = (table.mesh_name, table.solver_version, table.facts["degrees_of_freedom"])
        return f"({self._text}, {', '.join(map(repr, facts))})"

    def attributes(self, table: Table) -> dict[str, Any]:
        """Return what a file says besides the arrays."""
        return {
            "law": self.law,
            "kappa": self.kappa,
            "aperture_mm": self.geometry.aperture_mm,
            "thickness_mm": self.geometry.thickness_mm,
            "mesh": table.mesh_name,
            **table.facts,
        }

    def datasets(self, table: Table) -> list[Dataset]:
        """Return the arrays of a file."""
        units = {p.name: p.unit or "1" for p in get_law(self.law).parameters}
        names = (*self.names, "pressure_mbar")
        return [
            *(Dataset(f"axes/{n}", np.array(nodes), units[n]) for n, nodes in self.axis),
            Dataset("axes/pressure_mbar", np.array(self.pressure_mbar), "mbar"),
            Dataset("deflection_mm", table.values, "mm", ", ".join(names), compression=9),
            Dataset("holds_to_mbar", table.holds_to, "mbar"),
            Dataset(_ITERATIONS, table.extra[_ITERATIONS]),
        ]

    @classmethod
    def read(cls, file: Any) -> Table:
        """Return the table in an HDF5 file."""
        law = str(file.attrs["law"])

        def axis(name: str) -> tuple[float, ...]:
            return tuple(map(float, file[f"axes/{name}"][:]))

        spec = cls(
            law,
            "consistent" if file.attrs["kappa"] == "consistent" else "paper",
            Geometry(float(file.attrs["aperture_mm"]), float(file.attrs["thickness_mm"])),
            tuple((name, axis(name)) for name in get_law(law).names),
            axis("pressure_mbar"),
        )
        return Table(
            spec,
            file["deflection_mm"][:],
            file["holds_to_mbar"][:],
            str(file.attrs["mesh"]),
            str(file.attrs["solver_version"]),
            {_ITERATIONS: file[_ITERATIONS][:]},
            {"degrees_of_freedom": int(file.attrs["degrees_of_freedom"])},
        )


def _check_sd(thickness_sd_mm: float) -> None:
    if thickness_sd_mm > 0.0:
        raise NotTrustworthyError("this database holds one thickness, and knows no other")


@lru_cache(maxsize=4)
def _components(table: Table) -> tuple[Array, Array]:
    """Return coordinates (entries, k) and basis (k, p) of all curves on the grid's pressures."""
    curves = table.values.reshape(-1, table.values.shape[-1])
    holds = np.isfinite(curves).all(axis=1)
    _, s, vt = np.linalg.svd(curves[holds], full_matrices=False)
    k = int((s > INTERPOLATION.kept_mm).sum())
    coordinates = np.full((len(curves), k), np.nan)
    coordinates[holds] = curves[holds] @ vt[:k].T
    return coordinates, vt[:k]
