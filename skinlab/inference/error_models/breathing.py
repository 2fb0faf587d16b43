"""Breathing: a sine of 0.2 to 0.4 Hz."""

from __future__ import annotations

from skinlab.inference.error_models.periodic import Periodic

ERROR_MODEL = Periodic(
    "breathing", 0.2, 0.4, 2.5,
    "breathing: a sine whose frequency is looked for in 0.2–0.4 Hz", "breathing",
)  # fmt: skip
