"""Rules of error models."""

from __future__ import annotations

from typing import Any

from skinlab.extensions.rules import Kind, expect
from skinlab.inference.error_models import ERROR_MODELS


def it_says_what_it_is(model: Any) -> None:
    """It says what it is."""
    expect(str(getattr(model, "meaning", "")).strip(), "it has no meaning, or an empty one")


def _row(model: Any) -> tuple[str, ...]:
    return f"`{model.name}`", str(model.meaning)


KIND: Kind[Any] = Kind(ERROR_MODELS, (it_says_what_it_is,), ("name", "what it is"), _row)
