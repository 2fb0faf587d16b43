"""Find the error models: every module of this folder that defines ERROR_MODEL."""

from __future__ import annotations

from functools import cache

import skinlab.inference.error_models as package
from skinlab.inference.error_models.base import ErrorModel
from skinlab.plugins import find


@cache
def error_models() -> dict[str, ErrorModel]:
    """Return all error models by name, in the order of their names."""
    found = sorted(find(package, "ERROR_MODEL"), key=lambda model: str(model.name))
    return {model.name: model for model in found}
