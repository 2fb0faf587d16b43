"""Quality gates, one a file, found by looking; a curve is judged while it grows and at its end.

A module that defines `GATE = Gate(…)` is a gate. Its `check` takes what is known of a curve
(`CurveSoFar`) and returns a Finding or None; it must not depend on anything else, so that a replay
finds the same.
"""

from __future__ import annotations

from skinlab.plugins import Registry, warn
from skinlab.quality.gates.base import CurveSoFar, Finding, Gate, check_gate

GATES: Registry[Gate] = Registry("gate", __name__, "GATE", "skinlab.gates", check_gate)

all_gates = GATES.all


def judge(gate: Gate, view: CurveSoFar) -> Finding | None:
    """Return what a gate finds; an installed one that breaks down finds nothing, and is told of."""
    origin = GATES.origin(gate.name)
    if origin is None:
        return gate.check(view)
    try:
        return gate.check(view)
    except Exception as error:  # noqa: BLE001 -- no plugin may end a measurement
        warn(
            f"plugin {origin.distribution}, gate {gate.name!r}: broke down, and judges nothing: "
            f"{type(error).__name__}: {error}"
        )
        return None
