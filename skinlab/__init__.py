"""Measure human skin at the bedside: from a suction probe to stress parameters (docs/python.md).

Names below are loaded when they are first used, so that `import skinlab` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skinlab.api.functions import (
        explain,
        forward,
        identify,
        identify_joint,
        measure,
        read_campaign,
        read_curve,
        read_session,
        study,
    )
    from skinlab.api.results import (
        Campaign,
        Curve,
        Explanation,
        Identification,
        Measurement,
        Session,
        Study,
    )
    from skinlab.errors import AcquisitionError, InputError, NotTrustworthyError, SkinlabError
    from skinlab.versions import __version__ as __version__

__all__ = [
    "AcquisitionError",
    "Campaign",
    "Curve",
    "Explanation",
    "Identification",
    "InputError",
    "Measurement",
    "NotTrustworthyError",
    "Session",
    "SkinlabError",
    "Study",
    "explain",
    "forward",
    "identify",
    "identify_joint",
    "measure",
    "read_campaign",
    "read_curve",
    "read_session",
    "study",
]


def __getattr__(name: str) -> Any:
    if name not in {*__all__, "__version__"}:
        raise AttributeError(f"module 'skinlab' has no attribute {name!r}")
    if name == "__version__":
        home = "versions"
    elif name.endswith("Error"):
        home = "errors"
    else:
        home = "api.results" if name[0].isupper() else "api.functions"
    value = getattr(import_module(f"skinlab.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
