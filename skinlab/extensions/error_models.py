"""Rules of error models."""

from __future__ import annotations

from typing import Any

from skinlab.extensions.rules import Kind, expect, first_line
from skinlab.inference.error_models import ERROR_MODELS


def it_says_what_it_is(model: Any) -> None:
    """Its module says what it is, and its name can be part of a combination's."""
    expect(first_line(model), "its module has no docstring")
    expect("+" not in model.name, "its name has a + in it, which joins the names of combinations")


def _row(model: Any) -> tuple[str, ...]:
    return f"`{model.name}`", first_line(model)


KIND: Kind[Any] = Kind(ERROR_MODELS, (it_says_what_it_is,), ("name", "what it is"), _row)
