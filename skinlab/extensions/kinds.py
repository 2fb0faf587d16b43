"""All kinds of extensions."""

from __future__ import annotations

from typing import Any

from skinlab.extensions import dialects, effects, error_models, gates, laws, methods
from skinlab.extensions.rules import Kind

KINDS: tuple[Kind[Any], ...] = (
    laws.KIND,
    effects.KIND,
    methods.KIND,
    error_models.KIND,
    gates.KIND,
    dialects.KIND,
)
