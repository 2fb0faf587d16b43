"""A database of one's own: a law with effects on the axes of a SPEC.toml, a curve in every node."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects.model import Effects
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.parameters import AxisSpace
from skinlab.tables.abscissa import Course, course_of
from skinlab.tables.axes import Interpolant
from skinlab.tables.model_spec import ModelSpec

if TYPE_CHECKING:
    from skinlab.tables.tensor_model import TensorModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModelDatabase:
    """What was built of a spec.

    `curves` (axes…, width) are the rows of the course; `holds_to` (axes…) is the pressure in mbar,
    or the time in s, to which an entry holds, -inf where it does not at all. Beyond it a curve
    supports the interpolation of neighbours, and is no answer in itself. `errors` (m, width) is
    what interpolation errs by at `check_points`; zero where there is nothing to compare.
    """

    spec: ModelSpec
    curves: Array
    holds_to: Array
    errors: Array
    solver_version: str
    versions: dict[str, str]  # what it was built with; not part of its content

    @cached_property
    def content_hash(self) -> str:
        """`sha256:…` over what is computed from what, and the numbers themselves."""
        digest = hashlib.sha256(f"{self.spec.to_json()} {self.solver_version}".encode())
        for array in (self.curves, self.holds_to, self.errors):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return f"sha256:{digest.hexdigest()}"

    @property
    def law(self) -> str:
        """Name of the constitutive law."""
        return self.spec.model.model.law

    @property
    def mesh_name(self) -> str:
        """Name of the discretisation that computed it."""
        return self.spec.mesh.name

    @cached_property
    def course(self) -> Course:
        """Along what it holds its curves."""
        return course_of(self.spec)

    @cached_property
    def interpolants(self) -> tuple[Interpolant, ...]:
        """How its curves run along each axis."""
        kappa = self.spec.model.model.kappa
        return tuple(
            Interpolant(axis, kappa=kappa if name == "nu" else None)
            for name, axis in self.spec.axis.items()
        )

    @cached_property
    def space(self) -> AxisSpace:
        """Where it holds at all: even as the model's priors say, else as the axes are spaced."""
        axes, model = self.spec.axis, self.spec.model
        priors = {name: own.prior for name, own in model.parameters.items()}
        logarithmic = tuple(
            axis.low > 0 and priors.get(name, _AS_SPACED[axis.spacing]) == "log-uniform"
            for name, axis in axes.items()
        )
        low, high = (tuple(getattr(a, end) for a in axes.values()) for end in ("low", "high"))
        return AxisSpace(tuple(axes), low, high, logarithmic)

    def point(self, base: Mapping[str, float], effects: Effects) -> Array:
        """Return the parameters (k,) of X1, X2 and ν, by name, and effects' values.

        What `effects` do not give is the model's own value.

        Raises:
            InputError: a value is none of this database's; says which.
        """
        at = dict(base)
        own = self.spec.model.values
        for effect, values in effects.items():
            for parameter, value in values.items():
                name = f"{effect}.{parameter}"
                if name not in self.spec.axis and own.get(effect, {}).get(parameter) != value:
                    raise InputError(f"{name} {value:g} is none of this database's")
        for name, axis in self.spec.axis.items():
            effect, _, parameter = name.rpartition(".")
            if effect:
                at[name] = effects.get(effect, {}).get(parameter, own[effect][parameter])
            if not axis.low <= at[name] <= axis.high:
                raise InputError(
                    f"{name} {at[name]:g} is outside the database ({axis.low:g}–{axis.high:g})"
                )
        return np.array([at[name] for name in self.spec.axis])

    def covers(self, curve: Curve) -> NDArray[np.bool_]:
        """Return which samples (n,) of a curve it speaks of.

        Raises:
            NotTrustworthyError: it does not speak of such a curve at all; says why.
        """
        setup, own = curve.setup, self.spec.measurement
        try:
            geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
            self._check(geometry, setup.thickness_sd_mm or 0.0)
        except NotTrustworthyError as error:
            raise NotTrustworthyError(f"{curve.name}: {error}") from None
        if self.spec.has_history and setup.cycle != own.cycle:
            raise NotTrustworthyError(
                f"{curve.name}: cycle {setup.cycle}, and this database holds for cycle "
                f"{own.cycle} only"
            )
        return self.course.covered(curve)

    def model(
        self,
        geometry: Geometry,
        pressure_mbar: Array,
        kappa: KappaConvention = "paper",
        thickness_sd_mm: float = 0.0,
        time_s: Array | None = None,
    ) -> TensorModel:
        """Return it at these pressures (u,) and times since the program's start (u,).

        Raises:
            NotTrustworthyError: it does not speak of this geometry, uncertainty or convention.
        """
        from skinlab.tables.tensor_model import TensorModel

        self._check(geometry, thickness_sd_mm)
        stated = self.spec.model.model.kappa
        if kappa != stated:
            raise NotTrustworthyError(f"kappa {kappa!r}, and this database holds for {stated!r}")
        return TensorModel(self, pressure_mbar, time_s)

    def _check(self, geometry: Geometry, thickness_sd_mm: float) -> None:
        own = self.spec.geometry
        for name in ("aperture_mm", "thickness_mm"):
            asked, stored = getattr(geometry, name), getattr(own, name)
            if not math.isclose(asked, stored, rel_tol=1e-9):
                raise NotTrustworthyError(
                    f"{name} {asked:g}, and this database holds for {stored:g} only"
                )
        if thickness_sd_mm > 0.0:
            raise NotTrustworthyError(
                "this database holds one thickness: give no thickness_sd_mm, or build one with the "
                "axis thickness_error.ratio"
            )


_AS_SPACED = {"log": "log-uniform", "linear": "uniform", "chebyshev": "uniform"}
