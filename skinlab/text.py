"""Text from outside, made inert: what a terminal would obey, or nobody would see, becomes visible.

Instruments, file names, notes and imported cells may hold anything. Whatever shows or writes such
text as text passes it through `inert`; what must read back as it was (JSON, TOML) uses `escaped`.
"""

from __future__ import annotations

import re
import sys
import unicodedata
from collections.abc import Iterable
from pathlib import Path
from typing import Any

# Control, format (directions, zero widths), surrogate, line and paragraph separator.
_UNSEEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
# Unicode's other characters of no width, or blank: joiner, fillers, variation selectors
_BLANK = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]"
)
# In JSON: half a character of two, which strict readers refuse; not behind another backslash
_HALF = re.compile(r"\\\\|\\ud[89ab]..\\ud[c-f]..|\\u(?P<code>d[89a-f]..)")
_FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")
# Where a comma is for decimals, spreadsheets begin another cell here
_NEXT_CELL = re.compile(f"(;\\s*)(?=[{re.escape(''.join(_FORMULA))}])")


class _Symbols(dict[int, str | int]):
    """A table for `str.translate` that looks each character up once."""

    def __missing__(self, code: int) -> str | int:
        self[code] = shown = _symbol(code) if _unseen(code) else code
        return shown


def _unseen(code: int) -> bool:
    # The last two of each plane are no characters, and not allowed in XML.
    char = chr(code)
    return (
        unicodedata.category(char) in _UNSEEN
        or code & 0xFFFE == 0xFFFE
        or _BLANK.match(char) is not None
    )


def _symbol(code: int) -> str:
    if code < 0x20:
        return chr(0x2400 + code)
    if code == 0x7F:
        return "\u2421"
    if 0xDC80 <= code <= 0xDCFF:  # a byte of a file name that is no UTF-8
        return f"\\x{code - 0xDC00:02x}"
    return f"\\x{code:02x}" if code < 0x100 else _u(code)


def _u(code: int) -> str:
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class _Escapes(dict[int, str | int]):
    """The same, as escapes of TOML's strings; below U+0020 the writer did it, but for the tab."""

    def __missing__(self, code: int) -> str | int:
        self[code] = shown = _u(code) if code >= 0x7F and _unseen(code) else code
        return shown


_SYMBOLS, _LINES, _ESCAPES = _Symbols(), _Symbols({10: 10}), _Escapes({9: "\\t"})


def is_inert(text: str) -> bool:
    """Return whether every character of one line can be seen."""
    return text.isprintable() and (text.isascii() or _BLANK.search(text) is None)


def inert(text: str) -> str:
    r"""Return one line of text in which every character can be seen: ESC as ␛, or as \u202e."""
    return text if is_inert(text) else text.translate(_SYMBOLS)


def inert_lines(text: str) -> str:
    """Return the same of a text of several lines, which stay lines."""
    return text if is_inert(text) else text.translate(_LINES)


def escaped(text: str) -> str:
    """Return TOML's text with what cannot be seen as escapes; its strings read back the same."""
    return text if is_inert(text) else text.translate(_ESCAPES)


def counted(count: int, noun: str) -> str:
    """Return `1 file`, or `2 files`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def json_text(document: Any) -> str:
    r"""Return a document as JSON of ASCII characters, none of which a terminal obeys.

    A byte of a file name that is no UTF-8 is `\xfc` in it, as in messages: JSON has no such text.

    Raises:
        ValueError: a number in it is not finite.
    """
    import json  # slow to import, as difflib

    text = json.dumps(document, indent=1, allow_nan=False).replace("\x7f", "\\u007f")
    return _HALF.sub(lambda m: "\\" + _symbol(int(m["code"], 16)) if m["code"] else m[0], text)


def csv_cell(value: Any) -> Any:
    """Return a cell of a CSV: text is inert, and no spreadsheet takes it for a formula."""
    if not isinstance(value, str):
        return value
    shown = inert(value)
    quoted = shown.lstrip().startswith(_FORMULA) or value[:1] in ("\t", "\r", "\n")
    shown = _NEXT_CELL.sub(r"\1'", shown)
    return f"'{shown}" if quoted else shown


def needs(what: str, package: str, extra: str) -> str:
    """Return the sentence of an optional package that is missing: what adds it to this environment.

    What `pip` alone would do in an environment of `pipx` or `uv tool` is to look for another one.
    """
    if Path(sys.prefix, "pipx_metadata.json").is_file():
        command = "pipx runpip skinlab install"
    elif Path(sys.prefix, "uv-receipt.toml").is_file():
        command = f"uv pip install --python '{sys.prefix}'"
    else:
        command = "pip install"
    return f"{what} {package}, which is not installed: {command} 'skinlab[{extra}]'"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return "; did you mean export?" for a word that is nearly a known one; else nothing."""
    import difflib

    near = difflib.get_close_matches(word.casefold(), list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""
