"""Error models, one a file, found by looking: every module here that defines ERROR_MODEL."""

from __future__ import annotations

from typing import Any

from skinlab.plugins import Registry, needs

ERROR_MODELS: Registry[Any] = Registry(
    "error model", __name__, "ERROR_MODEL", "skinlab.error_models", needs
)
