"""Quality gates, one a file, found by looking; a curve is judged while it grows and at its end.

A module that defines `GATE = Gate(…)` is a gate. Its `check` takes what is known of a curve
(`CurveSoFar`) and returns a Finding or None; it must not depend on anything else, so that a replay
finds the same.
"""

from __future__ import annotations

from drivers.breakdown import reason
from skinlab.plugins import Registry, texts, warn
from skinlab.quality.gates.base import CurveSoFar, Finding, Gate, check_gate

GATES: Registry[Gate] = Registry("gate", __name__, "GATE", "skinlab.gates", check_gate)

all_gates = GATES.all


def judge(gate: Gate, view: CurveSoFar) -> Finding | None:
    """Return what a gate finds; an installed one that breaks down finds nothing, and is told of."""
    who = GATES.who(gate.name)
    if who is None:
        return gate.check(view)
    try:
        found: object = gate.check(view)
        if found is None:
            return None
        if not isinstance(found, Finding):
            raise TypeError(f"it returned a {type(found).__name__}; expected a Finding or None")
        if found.gate != gate.name:  # it would be said again and again
            raise ValueError(f"it calls itself {found.gate!r} where it finds")
        texts(found, "sentence", "advice")
        if not (found.sentence.strip() and found.advice.strip()):
            raise ValueError("its finding has an empty sentence or advice; expected what to do")
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001 -- no plugin may end a measurement
        warn(f"{who}: broke down, and judges nothing: {reason(error)}")
        return None
    return found
