"""Error models, one a file, found by looking: every module here that defines ERROR_MODEL."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinlab.plugins import Registry, needs

if TYPE_CHECKING:
    from skinlab.inference.error_models.base import ErrorModel


def check_error_model(one: object) -> None:
    """Check that an extension is an error model.

    Raises:
        TypeError: it is not.
    """
    needs(one, "meaning", "prior", "part")


ERROR_MODELS: Registry[ErrorModel] = Registry(
    "error model", __name__, "ERROR_MODEL", "skinlab.error_models", check_error_model
)
