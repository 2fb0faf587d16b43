"""One self-contained HTML page: what it is given, as text, tables and pictures.

Nothing is fetched from anywhere: pictures are data URIs, and the page's own policy forbids the
rest. Text is escaped here, and only here; callers pass it as it is. The page is well-formed XML.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from skinlab.text import inert_lines


@dataclass(frozen=True)
class Table:
    """Rows of cells under a head, all plain text; the first column names the row.

    Raises:
        ValueError: a row has not as many cells as the head.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""

    def __post_init__(self) -> None:
        """Refuse a ragged table."""
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"a row of {len(row)} cells under a head of {len(self.head)}")


@dataclass(frozen=True)
class Illustration:
    """A picture: `source` is a data URI (`skinlab.report.pictures.to_data_uri`).

    `alt` says in words what is to be seen, for whoever cannot see it.

    Raises:
        ValueError: the source is no picture as a data URI, or there is no alternative text.
    """

    source: str
    alt: str
    caption: str = ""

    def __post_init__(self) -> None:
        """Refuse what would be fetched from elsewhere, or would be lost to some readers."""
        if not re.fullmatch(r"data:image/(png|svg\+xml);base64,[A-Za-z0-9+/=]+", self.source):
            raise ValueError("the source of a picture must be a data URI, PNG or SVG in base64")
        if not self.alt.strip():
            raise ValueError("a picture needs an alternative text")


@dataclass(frozen=True)
class Section:
    """A heading, and in this order: paragraphs, points of a list, figures, tables, subsections."""

    heading: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[Illustration] = ()
    points: Sequence[str] = ()
    sections: Sequence[Section] = ()


def page(
    title: str, sections: Sequence[Section], *, subtitle: str = "", notices: Sequence[str] = ()
) -> str:
    """Return the page; the same input gives the same text.

    `notices` are what nobody may overlook, and stand in frames above all else.
    """
    body = [f"<h1>{_text(title)}</h1>"]
    if subtitle:
        body.append(f'<p class="subtitle">{_text(subtitle)}</p>')
    body += [f'<p class="notice">{_text(notice)}</p>' for notice in notices]
    if len(sections) > 1:
        body.append("<nav><ul>")
        body += [
            f'<li><a href="#s{number}">{_text(section.heading)}</a></li>'
            for number, section in enumerate(sections, start=1)
        ]
        body.append("</ul></nav>")
    for number, section in enumerate(sections, start=1):
        body += _section(section, f"s{number}", 2)
    content = "\n".join(body)
    return _PAGE.format(title=_text(title), style=_STYLE, content=content)


def _section(section: Section, name: str, level: int) -> Iterator[str]:
    yield f'<section id="{name}">'
    yield f"<h{level}>{_text(section.heading)}</h{level}>"
    for paragraph in section.paragraphs:
        yield f"<p>{_text(paragraph)}</p>"
    if section.points:
        yield "<ul>"
        for point in section.points:
            yield f"<li>{_text(point)}</li>"
        yield "</ul>"
    if section.figures:
        yield '<div class="figures">'
    for figure in section.figures:
        caption = f"<figcaption>{_text(figure.caption)}</figcaption>" if figure.caption else ""
        alt = _text(figure.alt)
        yield f'<figure><img src="{figure.source}" alt="{alt}" />{caption}</figure>'
    if section.figures:
        yield "</div>"
    for table in section.tables:
        yield from _table(table)
    for number, inner in enumerate(section.sections, start=1):
        yield from _section(inner, f"{name}.{number}", min(level + 1, 6))
    yield "</section>"


def _table(table: Table) -> Iterator[str]:
    # On a narrow screen a wide table scrolls in its own frame, by keyboard too.
    yield '<div class="wide" tabindex="0"><table>'
    if table.caption:
        yield f"<caption>{_text(table.caption)}</caption>"
    cells = "".join(f'<th scope="col">{_text(cell)}</th>' for cell in table.head)
    yield f"<thead><tr>{cells}</tr></thead><tbody>"
    for row in table.rows:
        cells = "".join(_cell(cell, first=k == 0) for k, cell in enumerate(row))
        yield f"<tr>{cells}</tr>"
    yield "</tbody></table></div>"


def _cell(cell: str, *, first: bool) -> str:
    if first:
        return f'<th scope="row">{_text(cell)}</th>'
    if _NUMBER.match(cell):
        return f'<td class="n">{_text(cell)}</td>'
    if max(map(len, cell.split()), default=0) > _LONG:
        return f'<td class="long">{_text(cell)}</td>'
    return f"<td>{_text(cell)}</td>"


_NUMBER = re.compile(r"[-−+±<>≥≤ ]*\d[^A-Za-z:]*(µm|mm|mbar|MPa|s|%)?$")
_LONG = 30  # letters without a space: a hash or a path, which paper cannot scroll


def _text(text: str) -> str:
    return html.escape(inert_lines(text), quote=True)


_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 60rem; color: #1a1a1a; background: #fff;
  font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: break-word; }
h1, h2, h3, h4 { line-height: 1.25; margin: 1.6em 0 0.5em; }
h1 { margin-top: 0.5em; }
h2 { border-top: 1px solid #bbb; padding-top: 0.8em; }
.subtitle { color: #444; }
a { color: #00508a; }
.notice { border: 2px solid #b34700; padding: 0.5rem 0.75rem; font-weight: 600; }
.figures { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 24rem), 1fr)); }
figure { margin: 0; }
img { max-width: 100%; height: auto; display: block; }
figcaption, caption { color: #444; font-size: 0.9rem; text-align: left; padding: 0.3rem 0; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: 0.9rem; }
th, td { border-bottom: 1px solid #ccc; padding: 0.25rem 0.75rem 0.25rem 0; text-align: left;
  vertical-align: top; }
th { font-weight: 600; }
.n { font-variant-numeric: tabular-nums; white-space: nowrap; }
@page { size: A4; margin: 15mm; }
@media print {
  #s1 { break-after: page; }
  #s1 h2 { border-top: none; margin-top: 0; }
  #s1 figure img { max-height: 48mm; }
  #s1 table, figcaption { font-size: 9pt; }
  #s1 h3 { margin: 0.7em 0 0.2em; }
  #s1 p, #s1 ul, #s1 .wide { margin: 0.4em 0; }
  #s1 th, #s1 td, #s1 figcaption, #s1 caption { padding-top: 0.1rem; padding-bottom: 0.1rem; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  nav { display: none; }
  figure, tr, li { break-inside: avoid; }
  h2, h3, h4 { break-after: avoid; }
  .wide { overflow: visible; }
  .figures { grid-template-columns: 1fr 1fr; }
  .long { overflow-wrap: anywhere; }
}
"""

_PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8" />
<meta http-equiv="Content-Security-Policy" \
content="default-src 'none'; img-src data:; style-src 'unsafe-inline'" />
<meta name="viewport" content="width=device-width, initial-scale=1" />
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{content}
</body>
</html>
"""
