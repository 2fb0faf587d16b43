"""Pictures as bytes: PNG, SVG and data URIs, the same bytes for the same figure.

matplotlib is loaded when a picture is drawn. Figures are made from its classes, without pyplot: no
window, no global list of figures.
"""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

from skinlab.errors import InputError
from skinlab.text import needs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Kind = Literal["png", "svg"]

# Okabe and Ito's colours, which people with any of the common colour blindnesses tell apart.
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, GREY = "#E69F00", "#56B4E9", "#6B6B6B"
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, "#000000")

_DOTS_PER_INCH = 150

_STYLE: dict[str, object] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "axes.axisbelow": True,
    "font.size": 10.0,
    "legend.frameon": False,
    "svg.hashsalt": "skinlab",  # else the ids in an SVG differ from run to run
    "svg.fonttype": "path",  # looks the same wherever it is opened
}


NO_PICTURES = needs("the pictures need", "matplotlib", "pictures")


def have_pictures() -> bool:
    """Return whether there is what draws them."""
    return find_spec("matplotlib") is not None


def check_pictures() -> None:
    """Say so before long work whose pictures could not be drawn.

    Raises:
        InputError: matplotlib is not installed.
    """
    if not have_pictures():
        raise InputError(NO_PICTURES)


@contextmanager
def style() -> Iterator[None]:
    """Draw inside of this, so that a user's own matplotlib settings change nothing.

    Raises:
        InputError: matplotlib is not installed, or set up wrongly.
    """
    check_pictures()
    try:
        import matplotlib.style
    except ValueError as error:  # the environment names a backend that there is not
        raise InputError(f"matplotlib, which draws the pictures, does not start: {error}") from None
    with matplotlib.style.context(["default", _STYLE]):
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure that arranges what is put into it; call it inside `style()`."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def to_bytes(figure: Figure, kind: Kind) -> bytes:
    """Return the figure as a file of this kind.

    The bytes of `savefig`, which would draw twice to learn the size that `layout` has given.
    """
    stream = io.BytesIO()
    with style(), warnings.catch_warnings():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        # A name in letters that the font lacks is drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph ", category=UserWarning)
        figure.set_dpi(_DOTS_PER_INCH)
        if kind == "png":
            raster: Any = FigureCanvasAgg(figure)  # some releases have types of this, some none
            raster.print_png(stream, metadata={"Software": "skinlab"})
        else:
            vector: Any = FigureCanvasSVG(figure)
            vector.print_svg(stream, metadata={"Date": None, "Creator": "skinlab"})
    return stream.getvalue()


def to_data_uri(figure: Figure, kind: Kind = "svg") -> str:
    """Return the figure as the source of an `<img>` that needs no other file."""
    media = {"png": "image/png", "svg": "image/svg+xml"}[kind]
    return f"data:{media};base64,{base64.b64encode(to_bytes(figure, kind)).decode('ascii')}"
