"""What an installed error model returns, checked before anything is computed from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import fields, replace
from typing import Any

import numpy as np

from skinlab.inference.covariance import OrnsteinUhlenbeck
from skinlab.inference.error_models import ERROR_MODELS
from skinlab.inference.error_models.base import Array, Hyperparameter, Look, Part, Terms
from skinlab.plugins import above_zero, finite, texts, zero_or_more

_HUGE = 1e9  # mm²: squares overflow far above
_WIDEST = 10.0  # of a prior, in logarithms: nine decades in two standard deviations
_SAME = 1e-6  # share by which the quick variances may differ: what rounding does
# Names of what is built in that do not begin with their model's.
_OLDER = {"step_um": "quantised", "freedom": "heavy_tails"}

Shape = tuple[int, ...]


def own_look(look: Look) -> Look:
    """Return a look whose arrays an installed model may change in place."""
    return replace(look, samples=replace(look.samples, **_copies(look.samples)), **_copies(look))


def _copies(one: Any) -> dict[str, Any]:
    """Return copies of the arrays of a dataclass, by field."""
    each = {field.name: getattr(one, field.name) for field in fields(one)}
    return {name: value.copy() for name, value in each.items() if isinstance(value, np.ndarray)}


def checked_part(name: str, part: object, count: int) -> Part:
    """Return what the error model of this name returned for so many samples.

    It is asked for its terms at the medians of its parameters. What it is asked later is checked
    then, by what it returns here. What it is given are copies.

    Raises:
        TypeError, ValueError: it is no part, or its functions return what cannot be computed with;
            so do these, later on. Says what is wrong, and what was expected.
    """
    if not isinstance(part, Part):
        raise TypeError(f"it returned a {type(part).__name__}; expected a Part or None")
    texts(part, "name", "why")
    if part.name != name:
        raise ValueError(f"its part is called {part.name!r}; expected {name!r}")
    for field in ("always", "lasting"):
        if not isinstance(getattr(part, field), bool | np.bool_):
            raise TypeError(f"its {field} is {getattr(part, field)!r}; expected True or False")
    for field, kind in (("parameters", tuple | list), ("stated", Mapping)):
        given: object = getattr(part, field)
        if not isinstance(given, kind):
            raise TypeError(
                f"its {field} is a {type(given).__name__}; expected a "
                f"{'mapping' if kind is Mapping else 'tuple'}"
            )
    for one in part.parameters:
        _check_prior(one)
    _check_names(name, [*(p.name for p in part.parameters), *part.stated])
    finite("log_odds", part.log_odds)
    above_zero("spread", part.spread)
    above_zero("tails", part.tails)
    _check_numbers("bound", part.bound, ((), (count,)))
    if part.again is not None and part.parameters:
        raise ValueError("it is a scale mixture with parameters; expected none beside its stretch")
    checked = replace(
        part,
        stated={key: finite(f"its {key}", value) for key, value in part.stated.items()},
        terms=lambda values: _checked_terms(part.terms(copy(values)), count),
        variances=_variances(part.variances, count),
        size_um=_size(part.size_um),
        again=_again(name, part.again, count),
    )
    return _at_medians(checked, count)


def _at_medians(part: Part, count: int) -> Part:
    """Return a part whose functions agree at the medians, and whose terms keep their shapes."""
    medians = [p.median for p in part.parameters]
    first = part.terms(medians)
    shapes = _shapes(first)
    if part.again is not None and first.stretch is None:
        raise TypeError("it is a scale mixture without a stretch; expected one")
    if part.variances is not None:
        if shapes.keys() - {"variance_mm2"}:
            raise ValueError("it gives variances, and has more than these")
        quick = np.broadcast_to(part.variances(np.array([medians])), (1, count))
        if not np.allclose(quick, first.variance_mm2, rtol=_SAME, atol=0.0):
            raise ValueError("its variances are not those of its terms")
    if part.size_um is not None:
        part.size_um(medians)

    def terms(values: Sequence[float]) -> Terms:
        found = part.terms(values)
        if (other := _shapes(found)) != shapes:
            raise ValueError(
                f"its terms have the shapes {other} at {list(values)}; expected {shapes}"
            )
        return found

    return replace(part, terms=terms)


def _variances(
    given: Callable[[Array], Array] | None, count: int
) -> Callable[[Array], Array] | None:
    if given is None:
        return None

    def variances(values: Array) -> Array:
        found = given(values.copy())
        _check_numbers("variances", found, ((count,), (len(values), 1), (len(values), count)))
        if np.min(found) < 0.0:
            raise TypeError("variances are below 0")
        return found

    return variances


def _size(
    given: Callable[[Sequence[float]], float] | None,
) -> Callable[[Sequence[float]], float] | None:
    return None if given is None else lambda values: zero_or_more("size_um", given(copy(values)))


def _again(
    name: str, given: Callable[[Array], Part] | None, count: int
) -> Callable[[Array], Part] | None:
    if given is None:
        return None

    def again(square: Array) -> Part:
        found = checked_part(name, given(square.copy()), count)
        if found.again is None:
            raise TypeError("again returned a part without again")
        return found

    return again


def _check_names(name: str, names: Sequence[object]) -> None:
    """Check that a model's parameters, and what it states, are not called as another's are.

    Raises:
        TypeError, ValueError: one is; or it is no name.
    """
    for one in names:
        if not isinstance(one, str) or not one.isidentifier():
            raise TypeError(f"its parameter {one!r}: expected a name of letters, digits and _")
        if one.startswith(f"{name}_"):
            continue
        others = [m for m in ERROR_MODELS.names() if m != name and f"{one}_".startswith(f"{m}_")]
        other = _OLDER.get(one) or max(others, key=len, default=name)
        if other != name:
            raise ValueError(
                f"its parameter {one} is called as those of {other} are; expected a name that "
                f"begins with {name}_"
            )
    if len(set(names)) != len(names):
        raise ValueError(f"two of its parameters have one name: {', '.join(map(str, names))}")


def _check_prior(one: object) -> None:
    """Check one parameter.

    Raises:
        TypeError: its prior has no density.
    """
    if not isinstance(one, Hyperparameter):
        raise TypeError(f"its parameters hold a {type(one).__name__}; expected a Hyperparameter")
    where = f"the prior of {one.name}: "
    above_zero(f"{where}median", one.median)
    for field in ("start", "scale", "log_sd", "outlying_sd", "log_sd_above"):
        value: object = getattr(one, field)
        if value is None and field in ("start", "log_sd_above"):
            continue
        most = _WIDEST if "log_sd" in field or field == "outlying_sd" else math.inf
        above_zero(f"{where}{field}", value, most)
    for field in ("outlying", "absent"):
        if not 0.0 <= finite(f"{where}{field}", getattr(one, field)) < 1.0:
            raise TypeError(f"{where}{field} is {getattr(one, field)}; expected a share below 1")
    if one.reach != math.inf:
        above_zero(f"{where}reach", one.reach)


def _checked_terms(terms: object, count: int) -> Terms:
    """Return what a part adds to the errors of so many samples.

    Raises:
        TypeError: it is none.
    """
    if not isinstance(terms, Terms):
        raise TypeError(f"terms returned a {type(terms).__name__}; expected Terms")
    wide = () if terms.columns_mm is None else np.shape(terms.columns_mm)[1:]
    if terms.columns_mm is not None and (len(wide) != 1 or len(terms.columns_mm) != count):
        raise TypeError(
            f"columns_mm has the shape {np.shape(terms.columns_mm)}; expected ({count}, m), a row "
            "a sample"
        )
    wanted = {
        "variance_mm2": (terms.variance_mm2, ((), (count,))),
        "stretch": (terms.stretch, ((count,),)),
        "columns_mm": (terms.columns_mm, ((count, *wide),)),
        "sizes": (None if terms.columns_mm is None else terms.sizes, (wide,)),
    }
    for name, (value, shapes) in wanted.items():
        _check_numbers(name, value, shapes)
    if np.min(terms.variance_mm2, initial=0.0) < 0.0:
        raise TypeError("variance_mm2 is below 0")
    if terms.stretch is not None and not np.min(terms.stretch, initial=math.inf) > 0.0:
        raise TypeError("stretch is not above 0")
    ou: object = terms.ou
    if ou is not None:
        if not isinstance(ou, OrnsteinUhlenbeck):
            raise TypeError(f"ou is a {type(ou).__name__}; expected an OrnsteinUhlenbeck")
        zero_or_more("size_mm of ou", ou.size_mm)
        above_zero("time_s of ou", ou.time_s)
    return terms


def _shapes(terms: Terms) -> dict[str, Shape]:
    """Return the shape of each term that is there: no other setting may change it."""
    each = {
        "variance_mm2": terms.variance_mm2,
        "columns_mm": terms.columns_mm,
        "stretch": terms.stretch,
        "ou": None if terms.ou is None else 0.0,
    }
    return {name: np.shape(value) for name, value in each.items() if value is not None}


def _check_numbers(name: str, value: Any, shapes: Sequence[Shape]) -> None:
    """Check an array; None is not there.

    Raises:
        TypeError: it is none of these shapes, or holds what is no number of a usual size.
    """
    if value is None:
        return
    array = np.asarray(value)
    if array.shape not in shapes:
        raise TypeError(f"{name} has the shape {array.shape}; expected {shapes[-1]}")
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} is of the type {array.dtype}; expected numbers")
    if not np.isfinite(array).all():
        raise TypeError(f"{name} is not finite")
    if np.max(np.abs(array), initial=0.0) > _HUGE:
        raise TypeError(f"{name} is beyond {_HUGE:g}")
