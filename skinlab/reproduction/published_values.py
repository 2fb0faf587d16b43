"""The paper's own numbers, as printed."""

from __future__ import annotations

from dataclasses import dataclass

from skinlab.mechanics.materials import get_law

_BOX = get_law().published_space
assert _BOX is not None
PAPER_BOX = _BOX
"""The paper's section 2.3: where its stochastic algorithm searches."""


@dataclass(frozen=True)
class Row:
    """A row of Table 1 or 2; `digits` are the units of the last digits printed."""

    X1_MPa: float
    X2_MPa: float
    nu: float
    cpu_s: float
    error_um: float
    digits: tuple[float, float, float] = (0.001, 0.01, 0.01)

    @property
    def parameters(self) -> tuple[float, float, float]:
        """X1, X2 and ν."""
        return self.X1_MPa, self.X2_MPa, self.nu


TABLE_1_GN = Row(0.03, 1.0, 0.32, 3.1, 0.0)
TABLE_1_RLS = Row(0.03, 1.0, 0.32, 10.5, 0.0)
TABLE_1_STO = {
    100: Row(0.029, 0.93, 0.34, 2.5, 0.09),
    1000: Row(0.03, 1.05, 0.30, 11.1, 0.011),
    10_000: Row(0.03, 1.01, 0.32, 58.0, 0.002),
}
TABLE_2_GN = Row(0.016, 0.1, 0.48, 3.2, 43.0)
TABLE_2_STO = {
    100: Row(0.025, 2.95, 0.28, 2.3, 2.0),
    1000: Row(0.026, 3.1, 0.26, 1.4, 2.0),
    10_000: Row(0.025, 3.06, 0.26, 15.2, 2.0),
}
FIGURE_13_MEAN_UM, FIGURE_13_SD_UM = 1.6, 1.1
