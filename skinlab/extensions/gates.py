"""Rules of quality gates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.extensions.rules import Kind, expect
from skinlab.mechanics.fem.suction import Geometry
from skinlab.quality.gates import GATES
from skinlab.quality.gates.base import CurveSoFar, Finding, Gate, beginnings
from skinlab.tables.store import shipped_table

_PROGRAMS = ("ramp:100@20,ramp:0@20", "ramp:80@40,hold:3,ramp:0@40", "ramp:100@10")
_RATE_HZ = 20.0
_ODD = 300


def _views(text: str, seed: int) -> Iterator[CurveSoFar]:
    """Yield a clean curve while it grows, and whole; as a sensor reads it."""
    program = parse_program(text)
    rng = np.random.default_rng(seed)
    time_s = np.arange(int(program.duration_s * _RATE_HZ + 1e-9) + 1) / _RATE_HZ
    asked = program.pressure_mbar(time_s)
    model = shipped_table().model(Geometry(6.0, 1.0), asked, "paper")
    dome_mm = model.deflection_mm(np.array([[0.03, 1.5, 0.3]]))[0]
    curve = Curve(
        "curve 1",
        Setup(6.0, 1.0, program),
        time_s,
        np.round(asked + rng.normal(0.0, 0.2, len(time_s)), 1),
        np.round(dome_mm + rng.normal(0.0, 3e-3, len(time_s)), 3),
        np.minimum(program.segment_at(time_s), len(program.segments) - 1),
    )
    whole = CurveSoFar(
        curve.setup,
        curve.time_s,
        curve.pressure_mbar,
        curve.deflection_mm,
        curve.segment,
        beginnings(curve),
        rate_hz=_RATE_HZ,
    )
    assert curve.segment is not None
    for n in range(0, len(curve), 5):
        yield replace(
            whole,
            time_s=curve.time_s[:n],
            pressure_mbar=curve.pressure_mbar[:n],
            deflection_mm=curve.deflection_mm[:n],
            segment=curve.segment[:n],
            began_s=tuple(b for b in whole.began_s if n and b[1] <= curve.time_s[n - 1]),
            complete=False,
        )
    yield whole


def _odd_views() -> Iterator[CurveSoFar]:
    """Yield curves as nobody measures them: empty, of one sample, huge, without a program."""
    rng = np.random.default_rng(1)
    for number in range(_ODD):
        n = int(rng.choice([0, 1, 2, 3, 5, 6, 10, 60]))
        text = _PROGRAMS[number % len(_PROGRAMS)]
        setup = Setup(
            float(rng.choice([2.0, 8.0])),
            float(rng.choice([0.1, 1.0, 10.0])),
            None if number % 4 == 0 else parse_program(text),
            cycle=int(rng.integers(1, 3)),
        )
        scale = float(rng.choice([0.0, 1e-9, 1.0, 1e6]))
        segment = np.sort(rng.integers(0, 9, n)) if number % 3 else None
        time_s = np.cumsum(rng.uniform(1e-6, 1.0, n))
        pressure_mbar = scale * rng.normal(size=n)
        deflection_mm = scale * rng.normal(size=n) if number % 2 else np.zeros(n)
        for array in (time_s, pressure_mbar, deflection_mm):
            array.flags.writeable = False
        earlier = (Curve("c", setup, np.arange(6.0), np.zeros(6), np.zeros(6)),) if n >= 6 else ()
        yield CurveSoFar(
            setup,
            time_s,
            pressure_mbar,
            deflection_mm,
            segment,
            () if segment is None else tuple(zip(segment.tolist(), time_s.tolist(), strict=True)),
            complete=bool(rng.integers(2)),
            rate_hz=None if number % 5 else _RATE_HZ,
            lost_samples=int(rng.integers(3)),
            earlier=earlier,
        )


def it_says_what_it_is(gate: Gate) -> None:
    """It says where it fails, and which numbers decide, and why."""
    for name in ("meaning", "threshold"):
        text = getattr(gate, name)
        expect(text.strip() and not text.endswith("."), f"{name} is empty, or ends with a stop")


def a_clean_curve_passes(gate: Gate) -> None:
    """A clean curve passes, while it grows and whole."""
    for seed, text in enumerate(_PROGRAMS):
        for view in _views(text, seed):
            found = gate.check(view)
            state = "whole" if view.complete else f"of {len(view.time_s)} samples"
            expect(found is None, f"a clean curve, {state}, fails it: {found}")


def no_curve_makes_it_raise(gate: Gate) -> None:
    """No curve makes it raise; what it finds has a sentence and advice; twice it finds the same."""
    for view in _odd_views():
        found = gate.check(view)
        expect(found == gate.check(view), "asked twice about one curve it finds another thing")
        if found is not None:
            expect(isinstance(found, Finding), f"it finds a {type(found).__name__}, no Finding")
            expect(found.gate == gate.name, f"it calls itself {found.gate!r} where it finds")
            for text in (found.sentence, found.advice):
                good = text.strip() and not text.endswith(".")
                expect(good, f"{text!r} is empty, or ends with a full stop")


def _row(gate: Gate) -> tuple[str, ...]:
    return f"`{gate.name}`", gate.meaning, gate.threshold


KIND = Kind(
    GATES,
    (it_says_what_it_is, a_clean_curve_passes, no_curve_makes_it_raise),
    ("gate", "fails where", "threshold, and why"),
    _row,
)
