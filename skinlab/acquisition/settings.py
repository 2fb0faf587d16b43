"""The settings of the last time, kept between two starts; never who was measured."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Collection, Mapping
from pathlib import Path

from platformdirs import user_config_path

from drivers.reading import read_whole
from skinlab.acquisition.measurement_request import DEFAULTS, complaint
from skinlab.errors import InputError
from skinlab.io.documents import read_json
from skinlab.io.files import write_file

# What is left over would label the next person; the thickness is of a person's skin as well.
_OF_A_PERSON = frozenset({"subject", "site", "cycle", "thickness_mm", "thickness_sd_mm"})
_KEPT = tuple(name for name in DEFAULTS if name not in _OF_A_PERSON)


def default_path() -> Path:
    """Return where settings are kept where nobody says where."""
    return user_config_path("skinlab", appauthor=False) / "ui.json"


def _said(path: Path | None) -> dict[str, object]:
    if path is None:
        return {}
    try:
        said = read_json(read_whole(path))
    except (OSError, ValueError):
        return {}
    return said if isinstance(said, dict) else {}


def recall(path: Path | None) -> dict[str, str]:
    """Return the texts of the fields, without those that are no good any more."""
    said = _said(path)
    texts = {name: text for name in _KEPT if isinstance(text := said.get(name), str)}
    return {name: text for name, text in texts.items() if complaint(name, text) is None}


def recall_choice(path: Path | None, name: str, among: Collection[str]) -> str | None:
    """Return what was chosen of a few things; None: nothing, or none of these."""
    chosen = _said(path).get(name)
    return chosen if isinstance(chosen, str) and chosen in among else None


def remember(path: Path | None, texts: Mapping[str, str]) -> None:
    """Keep the texts; where that cannot be done, the next start has the defaults."""
    _keep(path, {name: texts[name] for name in _KEPT})


def remember_choice(path: Path | None, name: str, chosen: str) -> None:
    """Keep a choice beside the texts."""
    _keep(path, {name: chosen})


def _keep(path: Path | None, new: Mapping[str, str]) -> None:
    if path is None:
        return
    kept = {n: text for n, text in _said(path).items() if isinstance(text, str)}
    with contextlib.suppress(InputError):
        write_file(path, json.dumps({**kept, **new}, indent=1), replace=True)
