"""How much is computed: the paper's numbers by default, less in tests."""

from __future__ import annotations

from dataclasses import dataclass

from skinlab.inference.problem import Options
from skinlab.tables.grid_spec import published_axes

TOLERANCE_UM = 1e-5  # C
BEST = 20  # N_b


@dataclass(frozen=True)
class Study:
    """Sizes and the seed of everything random. Same study, same bits."""

    seed: int = 0
    samples: tuple[int, ...] = (100, 1000, 10_000)  # N of the tables and of Figure 11
    repeats: int = 50  # random cases of Figures 11 and 12
    # N_b of Figures 7 and 8, and how many random cases behind each point of 7 and 8a.
    best: tuple[int, ...] = (2, 3, 4, 5, 10, 20, 30, 40, 50, 75, 100, 150, 200)
    sweep_repeats: int = 10
    sweep_samples: int = 1000
    ratio_samples: tuple[int, ...] = (100, 250, 500, 750, 1000, 2500, 5000, 7500, 10_000)
    curves: int = 300  # of Figure 13
    X1_MPa: tuple[float, ...] = dict(published_axes())["X1_MPa"]  # of Figure 4a
    nu: tuple[float, ...] = dict(published_axes())["nu"]
    passes: int = 100  # of recursive least squares
    noise_draws: int = 50  # redraws of the stand-in's noise, for Gauss-Newton

    def sto(self, samples: int = 1000, best: int = BEST) -> Options:
        """Return the options of the stochastic algorithm."""
        return Options(samples=samples, best=best, tolerance_um=TOLERANCE_UM)

    def blind_repeats(self, samples: int) -> int:
        """Return how many random cases the blind test gets: fewer where each is dear."""
        return self.repeats if samples <= 1000 else max(2, self.repeats // 5)

    def ratio_repeats(self, samples: int) -> int:
        """Return how many random cases are behind each point of Figure 8b."""
        return 5 if samples <= 1000 else 1
