"""What a session stores of a curve's identification, decoded and checked."""

from __future__ import annotations

import json

import msgspec

from skinlab.errors import InputError
from skinlab.mechanics.materials import get_law, law_names

_DERIVED = dict.fromkeys(n for law in law_names() for n in get_law(law).derived_names)


class StoredValue(msgspec.Struct, frozen=True):
    """One parameter, with its 90 % interval where the method gave one."""

    value: float
    low: float | None = None
    high: float | None = None


class StoredErrors(msgspec.Struct, frozen=True):
    """What errors the samples have, with their numbers, and why these."""

    name: str
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    why: str = ""


class StoredResult(msgspec.Struct, frozen=True):
    """An entry of `curves` in `skinlab.identification/1`; unknown fields are left aside."""

    error: str | None = None
    points: int = 0
    fitted_points: int = 0
    phases: tuple[str, ...] = ()
    parameters: dict[str, StoredValue] | None = None
    optimum: dict[str, float] | None = None  # of results from before it was stored: the values
    order: tuple[str, ...] = ()
    correlation: tuple[tuple[float, ...], ...] | None = None
    error_um: float | None = None
    rms_um: float | None = None
    noise_um: float | None = None
    error_model: StoredErrors | None = None
    outliers: tuple[int, ...] = ()  # indices of samples that were left out
    iterations: int = 0
    evaluations: int = 0
    flags: tuple[str, ...] = ()
    derived: dict[str, float | None] = msgspec.field(default_factory=dict)  # by the law's names


def stored_result(number: int, result: object) -> StoredResult | None:
    """Return the result of curve `number`; None where nothing was identified.

    Raises:
        InputError: it is damaged; names the field.
    """
    damaged = f"the stored result of curve {number} is damaged"
    try:
        json.dumps(result, allow_nan=False)
    except (ValueError, RecursionError):
        raise InputError(f"{damaged}: a number is not finite") from None
    try:
        decoded = msgspec.convert(result, StoredResult | None)
        if decoded is not None and isinstance(result, dict):
            named = {name: result.get(name) for name in _DERIVED}
            derived = msgspec.convert(named, dict[str, float | None])
            decoded = msgspec.structs.replace(decoded, derived=derived)
    except msgspec.ValidationError as error:
        raise InputError(f"{damaged}: {error}") from None
    if decoded is not None and decoded.correlation is not None:
        size = len(decoded.order)
        if [len(row) for row in decoded.correlation] != [size] * size:
            raise InputError(f"{damaged}: expected a correlation of {size} × {size} values")
    return decoded
