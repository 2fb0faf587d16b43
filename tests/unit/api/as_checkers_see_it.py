"""A script as a user writes it, for mypy alone: `make check` reads it, nobody runs it.

What it may not accept is marked, and a mark that nothing needs is an error.
"""

from typing import assert_type

import skinlab
from skinlab.api.results import Curve

assert_type(skinlab.read_curve("c.csv", aperture_mm=6, thickness_mm=1), Curve)
skinlab.read_curve(1, aperture_mm=6, thickness_mm=1)  # type: ignore[arg-type]
