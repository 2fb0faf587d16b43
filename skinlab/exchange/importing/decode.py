"""Bytes of a text file to text: UTF-8, UTF-16 or Latin-1, by what is in them."""

from __future__ import annotations

import codecs

from skinlab.errors import InputError
from skinlab.exchange.importing.questions import Answers

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig", "UTF-8"),
    (codecs.BOM_UTF16_LE, "utf-16", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16", "UTF-16"),
)
_NO_TEXT = "it is not text; expected a table of numbers as text, or .xlsx"
# Windows' extension of Latin-1: the same where Latin-1 has printable characters.
_LATIN = "cp1252"


def decode(data: bytes, answers: Answers) -> tuple[str, str]:
    """Return the text and the name of its encoding.

    Raises:
        InputError: the bytes are no text, or not in the encoding that the option `encoding` says.
    """
    stated = answers.stated("encoding")
    if stated is not None:
        return _strictly(data, stated), stated
    for mark, codec, name in _MARKS:
        if data.startswith(mark):
            return _checked(data, codec, name), name
    guessed = _utf16_without_mark(data)
    if guessed is not None:
        return _checked(data, guessed, "UTF-16"), "UTF-16"
    if b"\0" in data:
        raise InputError(_NO_TEXT)
    try:
        return data.decode("utf-8"), "UTF-8"
    except UnicodeDecodeError:
        return _checked(data, _LATIN, "Latin-1"), "Latin-1"


def _strictly(data: bytes, name: str) -> str:
    codec = {"UTF-8": "utf-8-sig", "Latin-1": _LATIN}.get(name)
    if codec is None:
        marked = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        codec = "utf-16" if marked else _utf16_without_mark(data) or "utf-16-le"
    return _checked(data, codec, name)


def _utf16_without_mark(data: bytes) -> str | None:
    """Return the codec where every other byte is (nearly always) zero, as in Western UTF-16."""
    if len(data) < 4 or len(data) % 2:
        return None
    half = len(data) // 2
    high = data[1::2].count(0)
    low = data[0::2].count(0)
    if high > 0.8 * half and low < 0.1 * half:
        return "utf-16-le"
    if low > 0.8 * half and high < 0.1 * half:
        return "utf-16-be"
    return None


def _checked(data: bytes, codec: str, name: str) -> str:
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start + 1} is not {name} text") from None
    if "\0" in text:
        raise InputError(_NO_TEXT)
    return text
