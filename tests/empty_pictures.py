"""Reports without what takes most of their time."""

from __future__ import annotations

import pytest


def leave_pictures_empty(patch: pytest.MonkeyPatch) -> None:
    from skinlab.report import pictures, plots

    svg = b'<svg xmlns="http://www.w3.org/2000/svg"/>'
    patch.setattr(pictures, "to_bytes", lambda figure, kind: svg)
    for name in [name for name in vars(plots) if name.startswith("draw_")]:
        patch.setattr(plots, name, lambda *_: None)
