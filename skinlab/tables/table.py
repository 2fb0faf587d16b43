"""A table of precomputed curves: what was computed of what, and the numbers.

There is one kind of table. What differs is the spec: the paper's grid (`grid_spec.py`), the
dimensionless table (`dimensionless_spec.py`), a custom table: a law with effects
(`custom_spec.py`). A spec says which entries there are and how to compute one, how far it speaks,
and along which coordinates its values run; nothing else asks which spec it is.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_file import Model
from skinlab.parameters import Space
from skinlab.tables.any_geometry import AnyGeometry
from skinlab.tables.evaluator import Evaluator

Array = NDArray[np.float64]

NOT_MEASURED = (
    "how far it is off between the nodes was not measured, and is in no interval: a dimensionless "
    "table, or one of a SPEC.toml, that is built now knows it"
)


@dataclass(frozen=True)
class Dataset:
    """One array as a file holds it."""

    name: str
    values: NDArray[Any]
    unit: str = ""
    axes: str = ""
    compression: int | None = None


@dataclass(frozen=True, eq=False)
class Asked:
    """What a table is asked for: see `Table.model`."""

    geometry: Geometry
    pressure_mbar: Array  # (u,)
    kappa: KappaConvention
    thickness_sd_mm: float
    time_s: Array | None  # (u,)


class Spec(Protocol):
    """What is computed, and what the numbers mean."""

    kind: ClassVar[str]  # how a file calls it

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        ...

    @property
    def mesh_name(self) -> str:
        """Name of the discretisation."""
        ...

    @property
    def model(self) -> Model | None:
        """The model that it is of, its effects and convention; None: the law itself, any."""
        ...

    @property
    def fixed_geometry(self) -> Geometry | None:
        """The only opening and thickness that it speaks of; None: a range."""
        ...

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes along each axis."""
        ...

    @property
    def entries(self) -> int:
        """Number of curves."""
        ...

    # ---- build ----

    @property
    def identity(self) -> str:
        """All that the numbers depend on but the solver's version, in words."""
        ...

    @property
    def rows(self) -> tuple[int, int]:
        """Number of rows to compute and numbers in each; those behind the entries are checks."""
        ...

    def row(self, entry: int) -> Array:
        """Return one row, by finite elements."""
        ...

    def table(self, rows: Array, solver_version: str, versions: dict[str, str]) -> Table:
        """Return the table made of all rows."""
        ...

    def difference(self, table: Table, entry: int) -> str:
        """Compute an entry again; return how it differs from the table's in a sentence, or ''."""
        ...

    # ---- use ----

    def space(self, table: Table, kappa: KappaConvention) -> Space:
        """Return where it holds at all."""
        ...

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: it does not speak of such a curve at all; says why.
        """
        ...

    def point(self, base: Mapping[str, float], effects: Effects) -> Array:
        """Return the parameters (p,) of the law's by name and effects' values.

        Raises:
            InputError: a value is none of this table's; says which.
        """
        ...

    def evaluator(self, table: Table, asked: Asked) -> Evaluator:
        """See `Table.model`."""
        ...

    def describe(self, table: Table) -> list[str]:
        """Return what is in it, in a few lines."""
        ...

    def between(self, table: Table) -> str | None:
        """Return how far it is off between its nodes, in words; '' where nothing is to be said.

        None where it was not measured.
        """
        ...

    # ---- files ----

    def head(self, table: Table) -> str:
        """Return what the content hash begins with."""
        ...

    def attributes(self, table: Table) -> dict[str, Any]:
        """Return what a file says besides the arrays."""
        ...

    def datasets(self, table: Table) -> list[Dataset]:
        """Return the arrays of a file; those under `axes/` are for readers."""
        ...


@runtime_checkable
class OfAnyGeometry(Protocol):
    """A spec whose tables speak of a range of openings and thicknesses."""

    def any_geometry(self, table: Table, kappa: KappaConvention) -> AnyGeometry:
        """See `Table.any_geometry`."""
        ...


@dataclass(frozen=True, eq=False)
class Table:
    """What was built of a spec.

    `values` (axes…, width) is a row for every entry; `holds_to` (axes…) how far it is an answer,
    along what the spec holds its curves. Beyond, a row supports the interpolation of neighbours.
    `extra` are further arrays and `facts` further numbers, by name, that the spec keeps.
    """

    spec: Spec
    values: NDArray[Any]
    holds_to: Array
    mesh_name: str
    solver_version: str
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)
    path: Path | None = None  # the user's file that it is from

    @cached_property
    def content_hash(self) -> str:
        """`sha256:…` over what was computed from what, and the numbers."""
        digest = hashlib.sha256(self.spec.head(self).encode())
        for array in (self.values, self.holds_to, *self.extra.values()):
            digest.update(np.ascontiguousarray(array).tobytes())
        return f"sha256:{digest.hexdigest()}"

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        return self.spec.law

    @property
    def fixed_geometry(self) -> Geometry | None:
        """The only opening and thickness that it speaks of; None: a range."""
        return self.spec.fixed_geometry

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of, its small extensions included.

        Raises:
            NotTrustworthyError: it does not speak of such a curve at all; says why.
        """
        return self.spec.covers(curve)

    def model(
        self,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
        thickness_sd_mm: float = 0.0,
        time_s: Array | None = None,
    ) -> Evaluator:
        """Return the table at this geometry and these pressures (u,).

        `time_s` (u,) are the times since the curve began, for tables that depend on them. With a
        standard deviation of the thickness, its ratio to the stated one is one more parameter at
        the end, `thickness_ratio`.

        Raises:
            NotTrustworthyError: it does not speak of this geometry, uncertainty or convention.
        """
        times = None if time_s is None else _bytes(time_s)
        return _evaluator(self, geometry, _bytes(pressure_mbar), kappa, thickness_sd_mm, times)

    def any_geometry(self, kappa: KappaConvention = "paper") -> AnyGeometry:
        """Return the table as a function of thickness and opening too, without any set-up.

        Raises:
            NotTrustworthyError: it is of one geometry only.
        """
        return _any_geometry(self, kappa)


@lru_cache(maxsize=4)  # a fit asks thousands of times
def _any_geometry(table: Table, kappa: KappaConvention) -> AnyGeometry:
    if not isinstance(table.spec, OfAnyGeometry):
        raise NotTrustworthyError(f"a table of kind {table.spec.kind!r} is of one geometry only")
    return table.spec.any_geometry(table, kappa)


def _bytes(values: Array) -> bytes:
    return np.asarray(values, dtype=np.float64).tobytes()


# The same curve is asked for again: with other errors, another method, in a report
@lru_cache(maxsize=8)
def _evaluator(
    table: Table,
    geometry: Geometry,
    pressure: bytes,
    kappa: KappaConvention,
    thickness_sd_mm: float,
    times: bytes | None,
) -> Evaluator:
    pressure_mbar = np.frombuffer(pressure)
    time_s = None if times is None else np.frombuffer(times)
    asked = Asked(geometry, pressure_mbar, kappa, thickness_sd_mm, time_s)
    return table.spec.evaluator(table, asked)


def plain_point(law: str, base: Mapping[str, float], effects: Effects) -> Array:
    """Return the parameters (p,) of a table without effects.

    Raises:
        InputError: there are effects, or a value that the law does not have.
    """
    if effects:
        raise InputError("this database knows no effects; build one of the model")
    return np.array(get_law(law).ordered(base))
