"""The sensor's own noise: independent from sample to sample. It is estimated even where stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinlab.inference.error_models.base import Array, Hyperparameter, Look, Part, Terms

_MEDIAN_UM, _LOG_SD = 3.0, 1.5
_STATED_SD = 0.06  # a statement is good to some per cent, or wrong altogether
_WRONG = 0.1
_TABLE_UM = 0.01  # interpolation in the database, and the least noise there is


@dataclass(frozen=True)
class White:
    """Independent Gaussian errors of one size."""

    name: str = "white"
    meaning: str = "independent from sample to sample; estimated even where it is stated"
    prior: str = "3 µm; 1.5. Stated: the statement; 6 %, and one in ten statements is wrong"

    def part(self, look: Look) -> Part:
        """Return its part: there is always one."""
        size = Hyperparameter("white_um", _MEDIAN_UM, _LOG_SD)
        if look.noise_um is not None:
            size = Hyperparameter("white_um", look.noise_um, _STATED_SD, outlying=_WRONG)
        least = (1e-3 * _TABLE_UM) ** 2
        relative = np.square(look.samples.relative_noise)

        def variances(values: Array) -> Array:
            return np.asarray((1e-3 * values[..., :1]) ** 2 * relative + least)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(variances(np.array(values)))

        return Part("white", (size,), terms, always=True, variances=variances)


ERROR_MODEL = White()
