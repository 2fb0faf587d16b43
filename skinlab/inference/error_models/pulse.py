"""The pulse: a sine of 0.9 to 1.6 Hz."""

from __future__ import annotations

from skinlab.inference.error_models.periodic import Periodic

ERROR_MODEL = Periodic(
    "pulse", 0.9, 1.6, 1.5,
    "the pulse: a sine whose frequency is looked for in 0.9–1.6 Hz", "a pulse",
)  # fmt: skip
