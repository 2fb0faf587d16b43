"""Do the intervals contain the truth? Skins by finite elements alone, errors as they are in life.

What `python benchmarks/identification.py coverage` runs. The errors are drawn here, by other code
than the error models under test; sizes are those of docs/intervals.md.
"""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from prior_skins import Skin, skins
from scipy.signal import lfilter
from scipy.stats import binom

from skinlab.curves.curve import Curve
from skinlab.inference.identify import Identifier
from skinlab.inference.uncertainty import Sensor
from skinlab.tables.store import shipped_table

Array = NDArray[np.float64]
Rng = np.random.Generator

LASTS_S, TOP_MBAR = 5.0, 100.0
RESULT = Path(__file__).parent / "results" / "identification_coverage.jsonl"
NAMES = ("X1_MPa", "X2_MPa", "nu")


@dataclass(frozen=True)
class Errors:
    """What is added to a curve. Sizes in µm; 0 is without."""

    white: float = 0.0
    ou: float = 0.0
    ou_s: float = 0.3
    student: float = 0.0  # scale of a Student-t with 3 degrees of freedom
    spikes: float = 0.0  # share of the samples, off by 30 to 100 µm
    glitch: float = 0.0
    breathing: float = 0.0
    pulse: float = 0.0
    proportional: float = 0.0
    pressure_mbar: float = 0.0
    step: float = 0.0

    def measured(self, skin: Skin, rate_hz: float, rng: Rng) -> Curve:
        """Return a curve with these errors: a ramp to 100 mbar in 5 s."""
        n = round(LASTS_S * rate_hz) + 1
        t = np.arange(n) / rate_hz
        true = TOP_MBAR * t / LASTS_S
        w = 1e3 * skin.deflection(true)
        reading = true + self.pressure_mbar * rng.standard_normal(n)
        off = self.white * rng.standard_normal(n)
        if self.ou:
            rho = np.exp(-1.0 / (rate_hz * self.ou_s))
            start = rng.standard_normal()
            steps = np.sqrt(1 - rho**2) * rng.standard_normal(n)
            steps[0] = start
            off = off + self.ou * lfilter([1.0], [1.0, -rho], steps)
        if self.student:
            off = off + self.student * rng.standard_t(3.0, n)
        if self.spikes:
            hit = rng.random(n) < self.spikes
            off = off + hit * rng.uniform(30.0, 100.0, n) * rng.choice([-1.0, 1.0], n)
        if self.glitch:
            off[rng.integers(n)] += self.glitch * rng.choice([-1.0, 1.0])
        for size, low, high in ((self.breathing, 0.2, 0.4), (self.pulse, 1.0, 1.5)):
            if size:
                angle = 2 * np.pi * (rng.uniform(low, high) * t + rng.random())
                off = off + size * np.sin(angle)
        if self.proportional:
            off = off + self.proportional * w * rng.standard_normal(n)
        w = w + off
        if self.step:
            w = self.step * np.round(w / self.step)
        return Curve(f"skin{skin.number}", skin.setup, t, reading, 1e-3 * w)


EVERYTHING = Errors(
    white=2.0, ou=2.0, ou_s=0.3, spikes=0.01, breathing=3.0, pulse=2.0, proportional=0.005,
    pressure_mbar=0.3, step=1.0,
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    errors: Errors
    rate_hz: float = 20.0
    stated_um: float | None = None
    ends: bool = False


def _rows() -> dict[str, Row]:
    found = {f"white_{s:g}": Row(Errors(white=s)) for s in (1.0, 3.0, 10.0)}
    found |= {f"ou_{s:g}s": Row(Errors(white=1.0, ou=3.0, ou_s=s)) for s in (0.1, 0.3, 1.0)}
    found |= {
        "steps_10": Row(Errors(white=1.0, step=10.0)),
        "student_3": Row(Errors(student=3.0)),
        "spikes": Row(Errors(white=3.0, spikes=0.01)),
        "glitch": Row(Errors(white=3.0, glitch=300.0)),
        "periodic": Row(Errors(white=2.0, breathing=5.0, pulse=3.0)),
        "proportional": Row(Errors(white=1.0, proportional=0.02)),
        "pressure": Row(Errors(white=3.0, pressure_mbar=1.0)),
        "everything": Row(EVERYTHING),
    }
    for name in ("white_3", "ou_0.3s", "everything"):
        for rate in (100.0, 200.0):
            found[f"{name}_{rate:g}hz"] = Row(found[name].errors, rate)
    for name in ("white_1", "white_3", "white_10"):
        found[f"{name}_stated"] = Row(found[name].errors, stated_um=found[name].errors.white)
    found["ou_0.3s_stated"] = Row(found["ou_0.3s"].errors, stated_um=10.0**0.5)
    found["ends_white_3"] = Row(Errors(white=3.0), ends=True)
    found["ends_everything"] = Row(EVERYTHING, ends=True)
    return found


ROWS = _rows()


def one(row: Row, skin: Skin, seed: int) -> dict[str, Any]:
    """Return what becomes of one curve."""
    rng = np.random.default_rng([seed, skin.number])
    curve = row.errors.measured(skin, row.rate_hz, rng)
    identifier = Identifier(shipped_table(), sensor=Sensor(row.stated_um, None), seed=skin.number)
    began = time.perf_counter()
    result = identifier(curve)
    seconds = time.perf_counter() - began
    values = result.parameters or {}
    if result.error is not None or values[NAMES[0]].low is None:
        return {"failed": result.error or "no intervals", "seconds": seconds}
    model = shipped_table().model(_geometry(skin), np.array([TOP_MBAR]))
    return {
        "held": [v.low <= t <= v.high for v, t in zip(values.values(), skin.truth, strict=True)],
        "width": [
            float(np.log(v.high / v.low)) if n != "nu" else v.high - v.low
            for n, v in values.items()
        ],
        "model": result.error_model.name if result.error_model else "",
        "flags": [f.split(":")[0] for f in result.flags],
        "table_refuses": not bool(np.isfinite(model.deflection_mm(skin.truth[None])).all()),
        "noise_um": result.noise_um,
        "effective": result.uncertainty.draws.effective if result.uncertainty else 0.0,
        "seconds": seconds,
    }


def _geometry(skin: Skin) -> Any:
    from skinlab.mechanics.fem.suction import Geometry

    return Geometry(skin.setup.aperture_mm, skin.setup.thickness_mm)


def summary(name: str, found: list[dict[str, Any]], seed: int) -> dict[str, Any]:
    """Return a line of the table."""
    good = [f for f in found if "held" in f]
    held = np.array([f["held"] for f in good])
    inside = np.array([not f["table_refuses"] for f in good])
    flags = sorted({flag for f in good for flag in f["flags"]})
    widths = np.array([f["width"] for f in good])
    models: dict[str, int] = {}
    for f in good:
        models[f["model"]] = models.get(f["model"], 0) + 1
    low, high = binom.interval(0.95, len(good), 0.9)
    return {
        "row": name,
        "curves": len(found),
        "seed": seed,
        "coverage": _percent(held),
        "coverage_where_the_table_answers": _percent(held[inside]),
        "refused_by_the_table": int((~inside).sum()),
        "expected_at_90": [round(100 * low / len(good), 1), round(100 * high / len(good), 1)],
        "median_width": np.median(widths, axis=0).round(4).tolist(),
        "flags": {f: round(sum(f in g["flags"] for g in good) / len(good), 3) for f in flags},
        "models": dict(sorted(models.items(), key=lambda item: -item[1])[:6]),
        "noise_um": round(statistics.median(f["noise_um"] for f in good), 2),
        "least_effective": round(min(f["effective"] for f in good), 1),
        "median_ms": round(1e3 * statistics.median(f["seconds"] for f in found), 1),
        "failed": len(found) - len(good),
    }


def _percent(held: Array) -> dict[str, float]:
    if not len(held):
        return {}
    return dict(zip(NAMES, (100 * held.mean(axis=0)).round(1).tolist(), strict=True))


def run(names: list[str], curves: int, seed: int, say: Callable[[str], None] = print) -> None:
    """Run rows, each saved as a line when it is done; rows that are saved already are left out."""
    done = set()
    if RESULT.exists():
        lines = [json.loads(line) for line in RESULT.read_text().splitlines()]
        done = {(r["row"], r["curves"], r["seed"]) for r in lines}
    for name in names:
        if (name, curves, seed) in done:
            continue
        row = ROWS[name]
        found = [one(row, skin, seed) for skin in skins(curves, ends=row.ends)]
        line = json.dumps(summary(name, found, seed))
        say(line)
        with RESULT.open("a") as stream:
            stream.write(line + "\n")
