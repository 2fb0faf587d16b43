"""Quality gates: one file each, found by looking; a curve is judged while it grows and at its end.

A module that defines `GATE = Gate(name, check)` is a gate. `check` takes what is known of a curve
(`CurveSoFar`) and returns a Finding or None; it must not depend on anything else, so that a replay
finds the same.
"""
