"""How a sentence tells why the code of a plugin broke down, and where."""

from __future__ import annotations

import os
from pathlib import Path

# What a plugin is written with: none of its lines says what is wrong with it.
_OURS = ("skinlab", "drivers")
_LIBRARIES = {"numpy", "scipy"}


def reason(error: BaseException) -> str:
    """Give an error in one line, with the place that it comes from, where that is a plugin's."""
    import traceback  # slow to import

    message = " ".join(str(error).split())
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    frames = [f for f in traceback.extract_tb(error.__traceback__) if _outside(f.filename)]
    if frames:
        text += f" ({Path(frames[-1].filename).name} line {frames[-1].lineno})"
    return text


def _outside(filename: str) -> bool:
    """Whether a file is neither Python's own nor ours, nor of what everybody computes with."""
    path, root = Path(filename), Path(__file__).parents[1]
    if filename.startswith("<") or any(path.is_relative_to(root / name) for name in _OURS):
        return False
    if "site-packages" in path.parts:
        return not _LIBRARIES & set(path.parts)
    return not path.is_relative_to(Path(os.__file__).parent)
