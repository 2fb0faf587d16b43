"""The settings of the last time, kept between two starts; never who was measured."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

from platformdirs import user_config_path

from skinlab.acquisition.measurement_request import DEFAULTS, complaint
from skinlab.errors import InputError
from skinlab.io.documents import read_json
from skinlab.io.files import write_file
from skinlab.text import json_text

# What is left over would label the next person; the thickness is of a person's skin as well.
_OF_A_PERSON = frozenset({"subject", "site", "cycle", "thickness_mm", "thickness_sd_mm"})
_KEPT = tuple(name for name in DEFAULTS if name not in _OF_A_PERSON)


def default_path() -> Path:
    """Return where settings are kept where nobody says where."""
    return user_config_path("skinlab", appauthor=False) / "ui.json"


def recall(path: Path | None) -> dict[str, str]:
    """Return the texts of the fields, without those that are no good any more."""
    if path is None:
        return {}
    try:
        said = read_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(said, dict):
        return {}
    texts = {name: said[name] for name in _KEPT if isinstance(said.get(name), str)}
    return {name: text for name, text in texts.items() if complaint(name, text) is None}


def remember(path: Path | None, texts: Mapping[str, str]) -> None:
    """Keep the texts; where that cannot be done, the next start has the defaults."""
    if path is None:
        return
    kept = {name: texts[name] for name in _KEPT}
    with contextlib.suppress(InputError):
        write_file(path, json_text(kept), replace=True)
