"""The page that reports are made of, and pictures as bytes."""

from __future__ import annotations

import base64
import io
import subprocess
import sys
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import matplotlib
import pytest
from PIL import Image

from skinlab.report import pictures
from skinlab.report.page import Illustration, Section, Table, page
from skinlab.text import inert_lines

HOSTILE = "<script>alert('1')</script> & \"quoted\" $x$ \x00\x1b[31m \ud800 \u202eabc {title}"


def draw():
    with pictures.style():
        figure = pictures.new_figure(3, 2)
        axes = figure.add_subplot()
        axes.plot([0, 1, 2], [0, 1, 4], "o-", color=pictures.BLUE)
        axes.set_xlabel("pressure (mbar)")
    return figure


def whole(text: str) -> str:
    figure = Illustration(pictures.to_data_uri(draw()), text, text)
    table = Table((text, "value"), ((text, "1.5"), ("b", text)), text)
    inner = Section(text, (text,), (table,), (figure,), (text,))
    return page(text, (Section(text, (text,), (table,), (figure,), (text,), (inner,)), inner))


class Elements(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def test_hostile_text_stays_text_and_the_page_is_well_formed():
    text = whole(HOSTILE)
    text.encode("utf-8")
    plain = [tag for tag, _ in Elements(whole("plain")).found]
    assert [tag for tag, _ in Elements(text).found] == plain
    assert "script" not in plain
    root = ET.fromstring(text)
    shown = inert_lines(HOSTILE)
    assert "\x1b" not in shown
    assert root.find("head/title").text == shown
    assert [e.text for e in root.iter("li") if e.text] == [shown] * 3
    assert {e.get("alt") for e in root.iter("img")} == {shown}


def test_nothing_is_fetched_and_links_stay_in_the_page():
    elements = Elements(whole("plain")).found
    ids = {attributes.get("id") for _, attributes in elements}
    links = [a["href"] for _, a in elements if "href" in a]
    assert links
    assert all(link[0] == "#" and link[1:] in ids for link in links)
    sources = [a["src"] for _, a in elements if "src" in a]
    assert len(sources) == 3
    assert all(source.startswith("data:image/") for source in sources)
    assert "url(" not in whole("plain")
    assert "@import" not in whole("plain")


def test_a_picture_from_elsewhere_or_without_words_and_a_ragged_table_are_refused():
    with pytest.raises(ValueError, match="data URI"):
        Illustration("https://example.org/a.png", "a curve")
    with pytest.raises(ValueError, match="data URI"):
        Illustration('data:image/png;base64,AA" onload="x', "a curve")
    with pytest.raises(ValueError, match="alternative text"):
        Illustration("data:image/png;base64,AA==", " ")
    with pytest.raises(ValueError, match="a row of 1 cells"):
        Table(("a", "b"), (("1",),))


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_the_same_figure_gives_the_same_valid_bytes(kind):
    first = pictures.to_bytes(draw(), kind)
    with matplotlib.rc_context({"axes.facecolor": "red", "font.size": 30, "savefig.dpi": 10}):
        assert pictures.to_bytes(draw(), kind) == first
    uri = pictures.to_data_uri(draw(), kind)
    assert base64.b64decode(uri.partition(",")[2], validate=True) == first
    if kind == "png":
        image = Image.open(io.BytesIO(first))
        image.load()
        assert image.size == (450, 300)
        assert len(image.convert("RGB").getcolors(maxcolors=2**16)) > 10
    else:
        assert ET.fromstring(first).tag == "{http://www.w3.org/2000/svg}svg"
        assert b"<dc:date>" not in first


@pytest.mark.long
def test_drawing_needs_no_pyplot():
    code = (
        "import sys; from skinlab.report import pictures\n"
        "assert 'matplotlib' not in sys.modules\n"
        "with pictures.style(): figure = pictures.new_figure(2, 2)\n"
        "figure.add_subplot(); pictures.to_data_uri(figure)\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
