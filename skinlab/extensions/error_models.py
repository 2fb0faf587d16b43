"""Rules of error models."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from skinlab.extensions.rules import Kind, expect
from skinlab.inference.covariance import Covariance
from skinlab.inference.error_models import ERROR_MODELS
from skinlab.inference.error_models.base import ErrorModel, Look, Part
from skinlab.inference.error_models.checked import checked_part, own_look
from skinlab.inference.samples import Samples

_SIZES = (0.1, 1.0, 10.0)  # times a parameter's median


def it_says_what_it_is(model: ErrorModel) -> None:
    """It has a meaning and a prior."""
    expect(model.meaning.strip(), "meaning is empty")
    expect(model.prior.strip(), "prior is empty")


def what_it_returns_can_be_computed_with(model: ErrorModel) -> None:
    """Its part bears its name, has parameters that are its own, and returns numbers."""
    for _, part in _parts(model):
        names = [p.name for p in part.parameters]
        expect(all("_" in name for name in names), "a parameter's name ends with no unit")
        expect(part.always or part.why.strip(), "it says no why")
        other = set(re.findall(r"\{(.*?)\}", part.why)) - {*names, *part.stated}
        expect(not other, f"its why has {', '.join(sorted(other))} in braces; expected parameters")
        values = [[size * p.median for p in part.parameters] for size in _SIZES]
        for each in values:
            part.terms(each)
            if part.size_um is not None:
                part.size_um(each)
        if part.variances is not None:
            part.variances(np.array(values))


def a_part_is_a_covariance(model: ErrorModel) -> None:
    """What it adds is a covariance of the samples, at all sizes of its parameters."""
    for look, part in _parts(model):
        n = len(look.samples)
        for size in _SIZES:
            terms = part.terms([size * p.median for p in part.parameters])
            columns = np.zeros((n, 0)) if terms.deviations_mm is None else terms.deviations_mm
            variance = np.broadcast_to(terms.variance_mm2, (n,))
            stretch = 1.0 if terms.stretch is None else terms.stretch
            whole = Covariance(
                (variance + 1e-6) * stretch, columns, look.samples.ends, terms.ou,
                look.samples.time_s,
            )  # fmt: skip
            finite = np.isfinite(whole.log_density(look.residual_mm))
            expect(finite, "the residuals have no density under it")


def a_larger_one_is_larger(model: ErrorModel) -> None:
    """Its errors grow where the parameters that are sizes do."""
    for _, part in _parts(model):
        sizes = [p.name.endswith(("_um", "_share", "_mbar", "_scatter")) for p in part.parameters]
        if any(sizes):
            small, large = (
                _size(part, [p.median * (k if s else 1) for p, s in _zip(part, sizes)])
                for k in (1.0, 3.0)
            )
            expect(large > small, f"threefold parameters make {large:g} mm² of {small:g} mm²")


def the_same_look_the_same_part(model: ErrorModel) -> None:
    """The same samples have the same part."""
    for look in _looks():
        one, other = model.part(own_look(look)), model.part(own_look(look))
        expect((one is None) == (other is None), "it is there, and then not")
        if one is not None and other is not None:
            expect([*one.parameters] == [*other.parameters], "its parameters change")
            expect(one.log_odds == other.log_odds, "its odds change")


def _zip(part: Part, sizes: list[bool]) -> Iterator[tuple[Any, bool]]:
    return zip(part.parameters, sizes, strict=True)


def _size(part: Part, values: list[float]) -> float:
    """Return the mean variance."""
    terms = part.terms(values)
    total = float(np.mean(terms.variance_mm2))
    if terms.deviations_mm is not None:
        total += float(np.square(terms.deviations_mm).sum(axis=1).mean())
    return total + (0.0 if terms.ou is None else terms.ou.size_mm**2)


def _parts(model: ErrorModel) -> Iterator[tuple[Look, Part]]:
    """Yield its parts, checked as they are at work."""
    for look in _looks():
        part: object = model.part(own_look(look))
        if part is not None:
            yield look, checked_part(model.name, part, len(look.samples))


def _looks() -> Iterator[Look]:
    """Return samples: few or many, of one or several curves, at even times or not."""
    rng = np.random.default_rng(0)
    for count, curves, rate_hz in ((3, 1, 20), (101, 1, 20), (120, 3, 20), (600, 1, 100)):
        t = np.arange(count // curves) / rate_hz
        for times in (t, t + rng.uniform(0, 0.5 / rate_hz, len(t))):
            wave = sum(np.sin(2 * np.pi * f * times + f) for f in (0.3, 1.2))
            walk = np.cumsum(rng.standard_normal(len(t))) / np.sqrt(rate_hz)
            for error in (0 * t, rng.standard_t(2, len(t)), walk, 3 * wave + 0.1 * walk):
                yield _look(np.tile(times, curves), curves, np.tile(1e-3 * error, curves))


def _look(time_s: Any, curves: int, residual_mm: Any) -> Look:
    count = len(time_s)
    x = time_s / max(time_s.max(), 1e-9)
    number = np.repeat(np.arange(curves), count // curves)
    fitted = 0.5 * np.sqrt(x + 0.01)
    measured = np.round(fitted + residual_mm, 3)
    samples = Samples(
        time_s, 100 * x, measured, np.full(count, "load"), number, number,
        np.zeros(count, dtype=np.intp), np.ones(count),
    )  # fmt: skip
    square = np.square(residual_mm) / max(float(np.mean(np.square(residual_mm))), 1e-12)
    slope = 0.0025 / np.sqrt(x + 0.01)
    return Look(
        samples, fitted, slope, measured - fitted,
        np.column_stack([fitted, fitted * x, fitted * x**2]), None, np.full(count, 0.05),
        0.05 * slope, None, None, square,
    )  # fmt: skip


def _row(model: ErrorModel) -> tuple[str, ...]:
    return f"`{model.name}`", model.meaning, model.prior


KIND: Kind[Any] = Kind(
    ERROR_MODELS,
    (
        it_says_what_it_is,
        what_it_returns_can_be_computed_with,
        a_part_is_a_covariance,
        a_larger_one_is_larger,
        the_same_look_the_same_part,
    ),
    ("kind", "what it is", "before the data (median; a standard deviation of the logarithm)"),
    _row,
)
