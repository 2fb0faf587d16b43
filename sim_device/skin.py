"""The skin under the simulated probe: finite elements, solved when a program is loaded.

Never the database, and not the mesh that built it: 9-node elements without quarter points, so that
a perfect score cannot come from fitting a model with itself.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from drivers.events import Load
from sim_device.device import Skin
from sim_device.files import SkinSection
from skinlab.fem.element import QUAD9_FULL
from skinlab.fem.suction import Discretisation, Geometry, solve
from skinlab.materials.compressibility import kappa_ratio

MESH = Discretisation("simulated-1", QUAD9_FULL, 0.01, 1.6, 0.125, 0.125, 0.25)

_OVERSHOOT = 1.1  # a pump overshoots a little, and the skin follows


class ElasticSkin:
    """A skin of the paper's law, without memory: its dome depends on the pressure alone."""

    def __init__(self, skin: SkinSection) -> None:
        self._thickness_mm = skin.thickness_mm
        self._parameters = {
            "X1_MPa": skin.X1_MPa,
            "X2_MPa": skin.X2_MPa,
            "kappa_MPa": skin.X1_MPa * float(kappa_ratio(skin.nu, skin.kappa)),
        }
        self._dome: CubicHermiteSpline | None = None
        self._solved: tuple[float, float] = (0.0, 0.0)

    def prepare(self, aperture_mm: float, load: Load) -> None:
        """Solve up to the program's highest suction.

        Raises:
            ValueError: the finite elements do not hold that far.
        """
        max_pressure_mbar = load.max_pressure_mbar
        if self._solved[0] == aperture_mm and self._solved[1] >= max_pressure_mbar:
            return
        geometry = Geometry(aperture_mm, self._thickness_mm)
        goal = max_pressure_mbar * _OVERSHOOT + 5.0
        curve = solve(geometry, self._parameters, goal, discretisation=MESH)
        if curve.holds_to_mbar < max_pressure_mbar:
            raise ValueError(
                f"the simulated skin holds to {curve.holds_to_mbar:.0f} mbar only, "
                f"and the program goes to {max_pressure_mbar:g}"
            )
        self._dome = CubicHermiteSpline(
            curve.pressure_mbar, curve.deflection_mm, curve.slope_mm_per_mbar
        )
        self._solved = (aperture_mm, max_pressure_mbar)

    def start(self) -> None:
        """Begin another loading; this skin does not remember any."""

    def deflection_mm(self, time_s: float, pressure_mbar: float) -> float:
        """Return the apex deflection; zero before anything was prepared."""
        return 0.0 if self._dome is None else float(self._dome(np.float64(pressure_mbar)))


def make_skin(skin: SkinSection, effects: dict[str, dict[str, float]]) -> Skin:
    """Return the skin that a SKIN.toml describes.

    Raises:
        ValueError: an effect that this skin cannot have.
    """
    if effects:
        raise ValueError(f"effects.{next(iter(effects))}: the simulated skin has no effects yet")
    return ElasticSkin(skin)
