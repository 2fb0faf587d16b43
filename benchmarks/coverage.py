"""Do the intervals contain the truth? Skins by finite elements alone, errors as they are in life.

What `python benchmarks/identification.py coverage` runs. The errors are drawn here, by other code
than the error models under test; sizes are those of docs/intervals.md.
"""

from __future__ import annotations

import hashlib
import json
import statistics
import time
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from prior_skins import CACHE, KINDS, OTHER_PROGRAM, PAIR_MM, Skin, fill, other_program, skins
from scipy.signal import lfilter
from scipy.special import log_ndtr
from scipy.stats import beta, binom

from skinlab import inference
from skinlab.curves.curve import Curve
from skinlab.inference.covariance import Covariance, OnKept, OrnsteinUhlenbeck
from skinlab.inference.identify import Identifier
from skinlab.inference.intervals import at_an_end
from skinlab.inference.intervals import summary as summary_of
from skinlab.inference.noise import locking_shapes, mesh_error_shapes, pressure_error_mm
from skinlab.inference.posterior import sample
from skinlab.inference.result import Identification
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.store import shipped_table

Array = NDArray[np.float64]
Rng = np.random.Generator

LASTS_S, TOP_MBAR = 5.0, 100.0
PLACED_MBAR = 70.0  # where placements differ: a soft one is as at more
ZERO_UM = 4.0  # of a placement
_BESIDE = 0.85  # correlation of neighbouring samples in the rows of the other program's curves
SEED = 20290401  # of skins and errors; nothing was chosen by looking at these
ORACLES = 40  # curves of a row, at most: a width's median needs no more, and exact ones are slow
AT_ONCE = 20  # curves of a row before it is the next one's turn
RESULT = Path(__file__).parent / "results" / "identification_coverage.jsonl"
_OF_THE_SKIN = ("at_bound", "not_identifiable")  # flags that say nothing of the errors
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "ranks.svg"
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
    jump: float = 0.0  # in the middle of the curve, and for good: the probe slipped
    walk: float = 0.0  # µm per root second: the zero wanders

    @property
    def sd_um(self) -> float:
        """Standard deviation of one sample, as one would state it."""
        squares = self.white**2 + self.ou**2 + 3.0 * self.student**2
        return float(np.sqrt(squares + 0.5 * (self.breathing**2 + self.pulse**2)))


@dataclass(frozen=True, eq=False)
class Measured:
    """A curve with errors, and what an oracle knows of them."""

    curve: Curve
    off: NDArray[np.bool_]  # (u,) samples that were hit by a spike or a glitch
    waves_hz: tuple[float, ...]


def measured(
    errors: Errors, skin: Skin, rate_hz: float, rng: Rng, top_mbar: float = TOP_MBAR,
    softer: float = 0.0, zero_um: float = 0.0, lasts_s: float = LASTS_S,
) -> Measured:  # fmt: skip
    """Return a curve with these errors: a ramp, of a placement this much softer (a log)."""
    n = round(lasts_s * rate_hz) + 1
    t = np.arange(n) / rate_hz
    true = top_mbar * t / lasts_s
    w = 1e3 * skin.deflection(true * np.exp(softer))
    reading = true + errors.pressure_mbar * rng.standard_normal(n)
    added = errors.white * rng.standard_normal(n)
    if errors.ou:
        rho = np.exp(-1.0 / (rate_hz * errors.ou_s))
        start = rng.standard_normal()
        steps = np.sqrt(1 - rho**2) * rng.standard_normal(n)
        steps[0] = start
        added = added + errors.ou * lfilter([1.0], [1.0, -rho], steps)
    if errors.student:
        added = added + errors.student * rng.standard_t(3.0, n)
    off = np.zeros(n, dtype=bool)
    if errors.spikes:
        off = rng.random(n) < errors.spikes
        added = added + off * rng.uniform(30.0, 100.0, n) * rng.choice([-1.0, 1.0], n)
    if errors.glitch:
        hit = rng.integers(n)
        added[hit] += errors.glitch * rng.choice([-1.0, 1.0])
        off[hit] = True
    waves = []
    for size, low, high in ((errors.breathing, 0.2, 0.4), (errors.pulse, 1.0, 1.5)):
        if size:
            waves.append(float(rng.uniform(low, high)))
            added = added + size * np.sin(2 * np.pi * (waves[-1] * t + rng.random()))
    if errors.proportional:
        added = added + errors.proportional * w * rng.standard_normal(n)
    if errors.walk:
        steps = rng.standard_normal(n - 1) / np.sqrt(rate_hz)
        added[1:] += errors.walk * np.cumsum(steps)
    w = w + added + zero_um + errors.jump * (t > 0.5 * lasts_s)
    if errors.step:
        w = errors.step * np.round(w / errors.step)
    curve = Curve(f"skin{skin.number}", skin.setup, t, reading, 1e-3 * w)
    return Measured(curve, off, tuple(waves))


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
    kind: str = "any"  # of skins
    scatter: float | None = None  # between placements, of log stiffness; None: one curve alone
    placements: int = 1  # at each opening
    lasts_s: float = LASTS_S  # of one curve alone


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
    for name in list(found):
        found[f"{name}_stated"] = replace(found[name], stated_um=found[name].errors.sd_um)
    found["white_3_stated_as_6"] = Row(Errors(white=3.0), stated_um=6.0)
    found["glitch_50"] = Row(Errors(white=3.0, glitch=50.0))
    for rate in (10.0, 100.0):
        lasting = Errors(white=1.0, ou=3.0, ou_s=-1.0 / (rate * np.log(_BESIDE)))
        both = replace(lasting, step=10.0, glitch=100.0)
        for name, errors in (("ar", lasting), ("ar_steps_glitch", both)):
            found[f"other_{name}_{rate:g}hz"] = Row(errors, rate, kind=OTHER_PROGRAM)
    found["ends_white_3"] = Row(Errors(white=3.0), kind="ends")
    found["ends_everything"] = Row(EVERYTHING, kind="ends")
    found["jump"] = Row(Errors(white=3.0, jump=40.0))
    found["creased_white_3"] = Row(Errors(white=3.0), kind="creased")
    for scatter in (0.0, 0.03, 0.06, 0.12):
        for count in (1, 2, 4):
            name = f"placed_{100 * scatter:g}_{count}"
            found[name] = Row(Errors(white=3.0), 10.0, None, "pairs", scatter, count)
    noisy = Errors(white=3.0, pressure_mbar=0.3)
    for count in (1, 4):
        found[f"placed_6_{count}_pressure"] = Row(noisy, 10.0, None, "pairs", 0.06, count)
    walking = Errors(white=2.0, walk=1.0)
    found["walk_5s"] = Row(walking)
    found["walk_20s"] = Row(walking, 10.0, lasts_s=20.0)
    return found


ROWS = _rows()


def errors_of(name: str, skin: Skin, seed: int) -> Rng:
    """Return the generator of a row's errors: rows share skins, but not what is added to them."""
    return np.random.default_rng([seed, zlib.crc32(name.encode()), skin.number])


def one(name: str, skin: Skin, seed: int, beside: bool = True) -> dict[str, Any]:
    """Return what becomes of one curve, if so asked beside who knows the errors' parameters."""
    row, rng = ROWS[name], errors_of(name, skin, seed)
    drawn = measured(row.errors, skin, row.rate_hz, rng, lasts_s=row.lasts_s)
    identifier = Identifier(
        shipped_table(), sensor=Sensor(row.stated_um, None), seed=skin.number, kappa=skin.kappa
    )
    began = time.process_time()
    result = identifier(drawn.curve)
    seconds = time.process_time() - began
    found = _judged(result, skin, seconds)
    if "failed" not in found and result.outliers is not None and result.uncertainty is not None:
        found["spikes"] = int(drawn.off.sum())
        found["spikes_found"] = int((drawn.off & result.outliers).sum())
        found["taken_for_spikes"] = int((~drawn.off & result.outliers).sum())
        if beside:
            # The whole curve of one that creases has no model.
            with suppress(ValueError):
                beside_it = np.random.default_rng(skin.number)
                found["oracle"] = oracle(row, skin, drawn, result, beside_it)
    return found


def placed(name: str, pair: tuple[Skin, ...], seed: int) -> dict[str, Any]:
    """Return what becomes of a skin that is measured at two openings, with several placements."""
    row, rng = ROWS[name], errors_of(name, pair[0], seed)
    assert row.scatter is not None
    zero = ZERO_UM if row.scatter else 0.0
    curves = [
        measured(
            row.errors, skin, row.rate_hz, rng, PLACED_MBAR,
            row.scatter * rng.standard_normal(), zero * rng.standard_normal(),
        ).curve
        for skin in pair
        for _ in range(row.placements)
    ]  # fmt: skip
    sensor = Sensor(row.stated_um, None, placement_scatter=None)
    identifier = Identifier(shipped_table(), sensor=sensor, seed=pair[0].number)
    began = time.process_time()
    result = identifier.joint(curves)
    seconds = time.process_time() - began
    found = _judged(result, pair[0], seconds)
    if result.placement is not None:
        learned = result.placement.scatter
        found["scatter"] = learned["value"]
        found["scatter_held"] = learned["low"] <= row.scatter <= learned["high"]
    return found


def _judged(result: Identification, skin: Skin, seconds: float) -> dict[str, Any]:
    values = result.parameters or {}
    if result.error is not None or values[NAMES[0]].low is None:
        return {"failed": result.error or "no intervals", "seconds": seconds}
    assert result.uncertainty is not None
    draws = result.uncertainty.draws
    model = shipped_table().model(_geometry(skin), np.array([TOP_MBAR]), skin.kappa)
    return {
        "held": [
            bool(v.low <= t <= v.high) for v, t in zip(values.values(), skin.truth, strict=True)
        ],
        "width": [_width(n, v.low or 0.0, v.high or 0.0) for n, v in values.items()],
        "rank": [
            float(draws.weight[draws.parameters[:, i] < t].sum()) for i, t in enumerate(skin.truth)
        ],
        "off": [_off(n, v.value, t) for (n, v), t in zip(values.items(), skin.truth, strict=True)],
        "loose": [f"not_identifiable:{n}" in result.flags for n in NAMES],
        "model": result.error_model.name if result.error_model else "",
        "flags": [f.split(":")[0] for f in result.flags],
        "table_refuses": not bool(np.isfinite(model.deflection_mm(skin.truth[None])).all()),
        "noise_um": result.noise_um,
        "effective": draws.effective,
        "seconds": seconds,
    }


def _width(name: str, low: float, high: float) -> float:
    return float(np.log(high / low)) if name != "nu" else high - low


def _off(name: str, value: float, truth: float) -> float:
    return abs(float(np.log(value / truth)) if name != "nu" else value - truth)


def _student(off: Array, scale: float) -> tuple[Array, Array, Array]:
    """Return the logarithm of Student's t with 3 degrees at (n, u), its slope and information."""
    square = 3.0 * scale**2 + off**2
    log_density = -2.0 * np.log(square / (3.0 * scale**2))
    return log_density, -4.0 * off / square, np.full_like(off, 4.0 / (6.0 * scale**2))


def _rounded(off: Array, step: float, scale: Array) -> tuple[Array, Array, Array]:
    """Return the logarithm of the chance to be rounded to here, (n, u), its slope and curvature."""
    up, down = (off + 0.5 * step) / scale, (off - 0.5 * step) / scale
    upper, lower = np.where(down > 0, -down, up), np.where(down > 0, -up, down)
    chance = log_ndtr(upper) + np.log1p(-np.exp(log_ndtr(lower) - log_ndtr(upper)))
    at_up, at_down = (np.exp(-0.5 * (x**2 + np.log(2 * np.pi)) - chance) for x in (up, down))
    slope = (at_up - at_down) / scale
    return chance, slope, slope**2 + (up * at_up - down * at_down) / scale**2


def _over_columns(
    off: Array, columns: Array, density: Callable[[Array], tuple[Array, Array, Array]]
) -> Array:
    """Return the log likelihood (n,) of residuals (n, u) over errors along columns (u, m).

    Each has a standard deviation of 1; by Laplace's approximation.
    """
    size = np.zeros((len(off), columns.shape[1]))
    one = np.eye(columns.shape[1])
    for last in [False] * 8 + [True]:
        log_density, slope, weight = density(off - size @ columns.T)
        curvature = np.einsum("nu,um,uk->nmk", weight, columns, columns, optimize=True) + one
        if not last:
            fall = -slope @ columns - size
            size += np.linalg.solve(curvature, fall[..., None])[..., 0]
    spread = 0.5 * np.linalg.slogdet(curvature)[1]
    return np.asarray(log_density.sum(axis=1) - 0.5 * (size**2).sum(axis=1) - spread)


def oracle(
    row: Row, skin: Skin, drawn: Measured, result: Identification, rng: Rng
) -> dict[str, Any]:
    """Return the intervals of who knows the errors' parameters, and which samples were hit.

    Rounding and Student's t by their exact likelihoods; the mesh's errors are as the estimate has
    them, at the true skin.
    """
    e, curve = row.errors, drawn.curve
    kept, t = ~drawn.off, curve.time_s
    model = shipped_table().model(_geometry(skin), curve.pressure_mbar, skin.kappa)
    true = skin.deflection(TOP_MBAR * t / row.lasts_s)
    variance = e.white**2 + (1e3 * e.proportional * true) ** 2 + 3.0 * e.student**2
    if e.pressure_mbar:
        sd = np.full(len(t), e.pressure_mbar)
        variance = variance + (1e3 * pressure_error_mm(curve.pressure_mbar, true, sd)) ** 2
    mesh = mesh_error_shapes(curve.pressure_mbar, true)
    locking = model.locking(skin.truth[None]) * locking_shapes(curve.pressure_mbar, true)
    columns = [1e3 * np.hstack([mesh, locking, model.error_shapes_mm(skin.truth)])]
    for size, hz in zip([s for s in (e.breathing, e.pulse) if s], drawn.waves_hz, strict=True):
        angle = 2 * np.pi * hz * t
        columns.append(size / np.sqrt(2.0) * np.column_stack([np.sin(angle), np.cos(angle)]))
    if e.walk:
        walk = np.zeros((len(t), len(t) - 1))
        walk[1:] = np.linalg.cholesky(np.minimum(t[1:, None], t[1:]))
        columns.append(e.walk * walk)
    covariance = Covariance(
        1e-6 * (variance + e.step**2 / 12.0 + np.zeros(len(t)))[kept],
        1e-3 * np.hstack(columns)[kept],
        (int(kept.sum()),),
        OrnsteinUhlenbeck(1e-3 * e.ou, e.ou_s) if e.ou else None,
        t[kept],
    )
    misfit = model.misfit(curve.deflection_mm, OnKept(kept, covariance))

    def exact(parameters: Array) -> Array:
        off = 1e3 * (curve.deflection_mm - model.deflection_mm(parameters))
        total = np.full(len(off), -np.inf)
        there = np.isfinite(off).all(axis=1)
        density = (
            (lambda u: _student(u, e.student))
            if e.student
            else (lambda u: _rounded(u, e.step, np.sqrt(variance)))
        )
        total[there] = _over_columns(off[there], np.hstack(columns), density)
        return total

    narrow = e.step > 2.0 * e.white and not e.ou
    assert result.uncertainty is not None
    space = result.uncertainty.space
    starts = [space.to_unit(np.array([(result.optimum or {})[n] for n in NAMES]))]
    starts.append(np.clip(space.to_unit(skin.truth), 0.0, 1.0))
    draws = sample(
        space, misfit, np.array(starts), rng, log_density=exact if e.student or narrow else None
    )
    ends = [
        summary_of(
            draws.parameters[:, i], draws.weight, draws.log_target,
            (float(space.bounds[0][i]), float(space.bounds[1][i])), logarithmic=name != "nu",
            at_end=at_an_end(draws.unit),
        )
        for i, name in enumerate(NAMES)
    ]  # fmt: skip
    return {
        "held": [
            bool(low <= x <= high) for (_, low, high), x in zip(ends, skin.truth, strict=True)
        ],
        "width": [_width(n, low, high) for n, (_, low, high) in zip(NAMES, ends, strict=True)],
    }


def _geometry(skin: Skin) -> Geometry:
    return Geometry(skin.setup.aperture_mm, skin.setup.thickness_mm)


def summary(name: str, found: list[dict[str, Any]], seed: int) -> dict[str, Any]:
    """Return a line of the table."""
    good = [f for f in found if "held" in f]
    held = np.array([f["held"] for f in good])
    inside = np.array([not f["table_refuses"] for f in good])
    flags = sorted({flag for f in good for flag in f["flags"]})
    widths = np.array([f["width"] for f in good])
    ranks = np.array([f["rank"] for f in good])
    models: dict[str, int] = {}
    for f in good:
        models[f["model"]] = models.get(f["model"], 0) + 1
    low, high = binom.interval(0.95, len(good), 0.9)
    line = {
        "row": name,
        "curves": len(found),
        "seed": seed,
        "database": shipped_table().content_hash.removeprefix("sha256:")[:12],
        "coverage": _percent(held),
        "coverage_where_the_table_answers": _percent(held[inside]),
        "refused_by_the_table": int((~inside).sum()),
        "expected_at_90": [round(100 * low / len(good), 1), round(100 * high / len(good), 1)],
        "median_width": np.median(widths, axis=0).round(4).tolist(),
        "ranks": {
            n: np.histogram(ranks[:, i], 10, (0.0, 1.0))[0].tolist() for i, n in enumerate(NAMES)
        },
        "flags": {f: round(sum(f in g["flags"] for g in good) / len(good), 3) for f in flags},
        "models": dict(sorted(models.items(), key=lambda item: -item[1])[:6]),
        "noise_um": round(statistics.median(f["noise_um"] for f in good), 2),
        "least_effective": round(min(f["effective"] for f in good), 1),
        "median_cpu_ms": round(1e3 * statistics.median(f["seconds"] for f in found), 1),
        "failed": len(found) - len(good),
    }
    if known := [f for f in good if "oracle" in f]:
        ratio = np.array([f["width"] for f in known]) / [f["oracle"]["width"] for f in known]
        line["oracle_held"] = _percent(np.array([f["oracle"]["held"] for f in known]))
        line["width_over_oracle"] = np.median(ratio, axis=0).round(3).tolist()
    if alone := [f for f in good if "spikes" in f]:
        line["spikes"] = {
            key: sum(f[key] for f in alone)
            for key in ("spikes", "spikes_found", "taken_for_spikes")
        }
    learned = [f for f in good if "scatter" in f]
    if learned:
        line["scatter"] = round(statistics.median(f["scatter"] for f in learned), 4)
        line["scatter_held"] = round(100 * statistics.mean(f["scatter_held"] for f in learned), 1)
    return line


def _percent(held: Array) -> dict[str, float]:
    if not len(held):
        return {}
    return dict(zip(NAMES, (100 * held.mean(axis=0)).round(1).tolist(), strict=True))


def run(
    names: list[str],
    curves: int,
    seed: int,
    *,
    result: Path = RESULT,
    processes: int = 1,
    say: Callable[[str], None] = print,
) -> None:
    """Run rows by turns, some curves of each at a time, and save their lines after every turn.

    Every curve's outcome is kept in benchmarks/cache, by the inference's sources and the database,
    so that a row of more curves goes on where one of fewer ended. Its line replaces the older one.
    """
    with ExitStack() as stack:
        each: Callable[..., Any] = map
        if processes > 1:
            each = stack.enter_context(ProcessPoolExecutor(processes)).map
        for goal in [*range(AT_ONCE, curves, AT_ONCE), curves]:
            # Skins that rows share are there before two processes could both draw them.
            for kind in sorted({ROWS[name].kind for name in names} & set(KINDS)):
                fill(goal, seed=seed, kind=kind, each=each)
            for line in each(partial(_line, curves=goal, seed=seed), names):
                say(json.dumps(line))
                same = ("row", "seed", "database")
                lines = [json.loads(one) for one in _lines(result)]
                lines = [old for old in lines if any(old[key] != line[key] for key in same)]
                result.write_text("".join(json.dumps(one) + "\n" for one in [*lines, line]))


def _line(name: str, *, curves: int, seed: int) -> dict[str, Any]:
    return summary(name, _outcomes(name, curves, seed), seed)


def _outcomes(name: str, curves: int, seed: int) -> list[dict[str, Any]]:
    """Return what becomes of at least the first curves of a row, from the cache if it is there."""
    row = ROWS[name]
    CACHE.mkdir(exist_ok=True)
    kept = _kept(name, seed)
    found = [json.loads(line) for line in _lines(kept)]
    if len(found) >= curves:
        return found
    if row.kind == OTHER_PROGRAM:
        drawn = other_program(curves)
    else:
        drawn = skins(curves, seed=seed, kind=row.kind)
    pairs = zip(*[drawn] * (len(PAIR_MM) if row.scatter is not None else 1), strict=True)
    for skin in islice(pairs, len(found), None):
        beside = len(found) < ORACLES and not row.errors.jump
        found.append(
            one(name, skin[0], seed, beside) if row.scatter is None else placed(name, skin, seed)
        )
        with kept.open("a") as stream:
            stream.write(json.dumps(found[-1]) + "\n")
    return found


def _kept(name: str, seed: int) -> Path:
    return CACHE / f"coverage_{seed}_{name}_{_version()}.jsonl"


def _lines(result: Path) -> list[str]:
    return result.read_text().splitlines() if result.exists() else []


@cache
def _version() -> str:
    """Return a hash of what decides the answers: the inference's sources, and the database."""
    hashed = hashlib.sha256(shipped_table().content_hash.encode())
    for path in sorted(Path(inference.__file__).parent.rglob("*.py")):
        hashed.update(path.read_bytes())
    return hashed.hexdigest()[:12]


# When a flag should come, and of which rows nobody can say: large errors of heavy tails are
# outliers as well, spikes are in some of a row's curves only, and what is stated of proportional
# errors leaves these out.
_SHOULD_COME: dict[str, Callable[[Row], bool]] = {
    "outliers": lambda row: row.errors.glitch > 0.0,
    "correlated_noise": lambda row: row.errors.ou + row.errors.breathing + row.errors.pulse > 0.0,
    "stated_noise_contradicted": lambda row: row is ROWS["white_3_stated_as_6"],
    "misfit_above_noise": lambda row: row.errors.jump > 0.0,
}
_CANNOT_SAY: dict[str, Callable[[Row], bool]] = {
    "outliers": lambda row: (
        row.errors.student + row.errors.jump > 0.0
        or (row.errors.spikes > 0.0 and not row.errors.glitch)
    ),
    # A walk of 1 µm per root second does not show in every curve.
    "correlated_noise": lambda row: row.errors.jump + row.errors.walk > 0.0,
    "stated_noise_contradicted": lambda row: row.stated_um is None or row.errors.proportional > 0.0,
    "misfit_above_noise": lambda row: row.stated_um is not None and (
        row.errors.proportional > 0.0 or row is ROWS["white_3_stated_as_6"]
    ),
}  # fmt: skip


def pooled(seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Return the saved rows of seeds, each with the curves of all of them.

    Shares by numbers of curves; of medians of widths, which are of as many curves each, the mean.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for line in map(json.loads, _lines(RESULT)):
        if line["seed"] in seeds:
            found.setdefault(line["row"], []).append(line)
    return [parts[0] if len(parts) == 1 else _together(parts) for parts in found.values()]


def _together(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    judged = [part["curves"] - part["failed"] for part in parts]

    def shares(key: str, weights: Sequence[float] | None = None) -> dict[str, float]:
        names = dict.fromkeys(name for part in parts for name in part[key])
        each = {name: [part[key].get(name, 0.0) for part in parts] for name in names}
        return {name: float(np.average(x, weights=weights)) for name, x in each.items()}

    whole = {
        "row": parts[0]["row"],
        "curves": sum(part["curves"] for part in parts),
        "failed": sum(part["failed"] for part in parts),
        "coverage": shares("coverage", judged),
        "flags": shares("flags", judged),
        "ranks": {n: np.sum([part["ranks"][n] for part in parts], axis=0) for n in NAMES},
    }
    if all("oracle_held" in part for part in parts):
        whole["oracle_held"] = shares("oracle_held")
        ratios = [part["width_over_oracle"] for part in parts]
        whole["width_over_oracle"] = np.mean(ratios, axis=0).tolist()
    if all("scatter" in part for part in parts):
        for key in ("scatter", "scatter_held"):
            whole[key] = float(np.average([part[key] for part in parts], weights=judged))
    return whole


def power(seeds: Sequence[int] = (SEED,)) -> str:
    """Return how often flags came when they should, and when not, from the saved rows.

    Of values that cannot be identified from the outcomes, where these are kept.
    """
    came = {flag: {True: [0, 0], False: [0, 0]} for flag in _SHOULD_COME}
    for line in pooled(seeds):
        row = ROWS.get(line["row"])
        if row is None or row.kind not in ("any", "ends"):
            continue
        curves = line["curves"] - line["failed"]
        for flag, should in _SHOULD_COME.items():
            if not _CANNOT_SAY[flag](row):
                count = came[flag][should(row)]
                count[0] += curves
                count[1] += round(line["flags"].get(flag, 0.0) * curves)
    lines = ["| flag | curves where it should come | came | where not | came |"]
    lines.append("|---|---|---|---|---|")
    for flag, (yes, no) in ((f, (c[True], c[False])) for f, c in came.items()):
        lines.append(f"| `{flag}` | {yes[0]} | {yes[1]} | {no[0]} | {no[1]} |")
    return "\n".join([*lines, "", *_not_identifiable(seeds)])


def _not_identifiable(seeds: Sequence[int]) -> list[str]:
    off: dict[str, dict[bool, list[float]]] = {n: {True: [], False: []} for n in NAMES}
    for name, row in ROWS.items():
        if row.kind not in ("any", "ends"):
            continue
        kept = (line for seed in seeds for line in _lines(_kept(name, seed)))
        for outcome in map(json.loads, kept):
            for i, parameter in enumerate(NAMES if "held" in outcome else ()):
                off[parameter][outcome["loose"][i]].append(outcome["off"][i])
    lines = [
        "| `not_identifiable` | flagged: curves | off by | not flagged: curves | off by |",
        "|---|---|---|---|---|",
    ]
    for parameter, each in off.items():
        cells = [f"{len(each[k])} | {statistics.median(each[k] or [0]):.2f}" for k in (True, False)]
        lines.append(f"| {parameter} | {' | '.join(cells)} |")
    return lines


def draw_ranks(seeds: Sequence[int] = (SEED,)) -> None:
    """Draw how ranks of the truth among the draws spread, over all rows of single curves.

    Simulation-based calibration (Talts et al. 2018, arXiv:1804.06788): the skins are drawn from the
    prior, so that ranks are uniform where intervals of every level hold the truth as they say.
    """
    from matplotlib import pyplot as plt

    rows = [name for name, row in ROWS.items() if row.kind == "any" and not row.errors.jump]
    lines = [line for line in pooled(seeds) if line["row"] in rows]
    figure, axes = plt.subplots(1, 3, figsize=(7.5, 2.4), sharey=True, layout="constrained")
    for axis, name in zip(axes, NAMES, strict=True):
        counts = np.sum([r["ranks"][name] for r in lines], axis=0)
        axis.bar((np.arange(10) + 0.5) / 10, counts / counts.mean(), 0.09, color="0.6")
        axis.axhline(1.0, color="black", linewidth=0.8)
        axis.set_xlabel(f"rank of the true {name.replace('_', ', ')}")
    axes[0].set_ylabel("curves, by what is expected")
    figure.suptitle(f"{sum(r['curves'] for r in lines)} curves of {len(lines)} rows", fontsize=9)
    plt.rcParams["svg.hashsalt"] = "skinlab"
    figure.savefig(PICTURE, metadata={"Date": None})


def table(seeds: Sequence[int] = (SEED,)) -> str:
    """Return the saved rows of seeds as the table of docs/intervals.md."""
    head = ("errors", "curves", "X1", "X2", "ν", "oracle", "width", "flags")
    lines = [head, ("---",) * len(head)]
    for row in pooled(seeds):
        wanted = {k: v for k, v in row["flags"].items() if k not in _OF_THE_SKIN and v > 0.005}
        said = ", ".join(f"`{k}` {100 * v:.0f}" for k, v in wanted.items())
        if "scatter" in row:
            found = f"scatter {100 * row['scatter']:.1f} %, held {row['scatter_held']:.0f} %"
            said = f"{found}; {said}" if said else found
        ratio = ", ".join(f"{v:.2f}" for v in row.get("width_over_oracle", ()))
        judged = row["curves"] - row["failed"]
        held = [_with_interval(row["coverage"][name], judged) for name in NAMES]
        oracle = ", ".join(f"{v:.0f}" for v in row.get("oracle_held", {}).values())
        cells = (f"`{row['row']}`", row["curves"], *held, oracle or "–", ratio or "–", said or "–")
        lines.append(tuple(map(str, cells)))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _with_interval(percent: float, curves: int) -> str:
    """Return a share with its 90 % interval (Jeffreys: Brown, Cai and DasGupta 2001)."""
    held = round(0.01 * percent * curves)
    low, high = beta.ppf([0.05, 0.95], held + 0.5, curves - held + 0.5)
    return f"{percent:.0f} ({100 * low:.0f}–{100 * high:.0f})"
