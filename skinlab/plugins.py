"""Extensions found by looking: one file each, in the folder of their kind."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import Any


def find(package: ModuleType, attribute: str) -> Iterator[Any]:
    """Yield what the modules of this package call `attribute`; their import errors come through."""
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        if hasattr(module, attribute):
            yield getattr(module, attribute)
