"""The pulse: a sine of 1 to 1.5 Hz."""

from __future__ import annotations

from skinlab.inference.error_models.periodic import Periodic

ERROR_MODEL = Periodic("pulse", 0.9, 1.6, 1.5, "a pulse")
