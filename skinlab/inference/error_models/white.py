"""The sensor's own noise: independent from sample to sample. It is estimated even where stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.error_models.base import Array, Hyperparameter, Look, Part, Terms
from skinlab.inference.settings import KINDS, NOISE


@dataclass(frozen=True)
class White:
    """Independent Gaussian errors of one size."""

    name: str = "white"
    meaning: str = "independent from sample to sample; estimated even where it is stated"
    prior: str = "3 µm; 1.5. Stated: the statement; 6 %, and one in ten statements is wrong"

    def part(self, look: Look) -> Part:
        """Return its part: there is always one."""
        size = Hyperparameter("white_um", KINDS.white_um, KINDS.white_sd)
        if look.noise_um is not None:
            size = Hyperparameter(
                "white_um", look.noise_um, KINDS.stated_sd, outlying=KINDS.stated_wrong
            )
        least = NOISE.least_mm**2
        relative = np.square(look.samples.relative_noise)

        def variances(values: Array) -> Array:
            return np.asarray((1e-3 * values[..., :1]) ** 2 * relative + least)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(variances(np.array(values)))

        return Part("white", (size,), terms, always=True, variances=variances)


ERROR_MODEL = White()
