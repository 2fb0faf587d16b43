"""Regular expressions that no line can keep busy for long.

The time of a match grows with a power of the line's length, which is bounded; what makes it
exponential (a repeated group) or the power high is refused.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from re import _constants as codes  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

_MOST_CHARACTERS = 500
_MOST_ANY = 2  # how often `.` may be repeated
_MOST_OPTIONAL = 12  # each may double the ways in which a line can be tried
_MOST_SHARING = 3  # repeats that may share out the same characters: a power of the line's length
_REPEATS = (codes.MAX_REPEAT, codes.MIN_REPEAT, codes.POSSESSIVE_REPEAT)
_CATEGORIES = {
    codes.CATEGORY_DIGIT: r"\d", codes.CATEGORY_NOT_DIGIT: r"\D",
    codes.CATEGORY_SPACE: r"\s", codes.CATEGORY_NOT_SPACE: r"\S",
    codes.CATEGORY_WORD: r"\w", codes.CATEGORY_NOT_WORD: r"\W",
}  # fmt: skip

Item = tuple[Any, Any]  # as Python's own parser has it: what, and with which values


def bounded_pattern(text: str, where: str) -> re.Pattern[str]:
    """Compile a pattern that is to match whole lines.

    Raises:
        ValueError: it is none, or could keep a line busy; a sentence that begins with `where`.
    """
    if len(text) > _MOST_CHARACTERS:
        raise ValueError(f"{where} has {len(text)} characters; expected up to {_MOST_CHARACTERS}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Python's, of what may mean something else one day
            pattern = re.compile(text, re.ASCII)
            items = list(parser.parse(text, re.ASCII))
    except (re.error, OverflowError, RecursionError, Warning) as error:
        raise ValueError(f"{where} is not a regular expression: {error}") from None
    while items and _is_anything(items[-1]):
        items.pop()  # at the end it takes what is left, and cannot fail
    every = list(_each(items))
    optional = sum(what in _REPEATS and args[:2] == (0, 1) for what, args in every)
    if optional > _MOST_OPTIONAL:
        raise ValueError(f"{where}: `?` stands {optional} times; expected {_MOST_OPTIONAL}")
    repeated = [args[2] for what, args in every if what in _REPEATS and args[1] > 1]
    if any(len(part) != 1 or not _is_character(part[0]) for part in repeated):
        raise ValueError(
            f"{where}: a group is repeated; only single characters and sets may be, so that no "
            "line can keep the pattern busy for long"
        )
    anything = sum(part[0][0] is codes.ANY for part in repeated)
    if anything > _MOST_ANY:
        raise ValueError(f"{where}: `.` is repeated {anything} times; expected {_MOST_ANY}")
    most, char = max((_sharing(items, chr(k)).most, chr(k)) for k in range(256))
    if most > _MOST_SHARING:
        raise ValueError(
            f"{where}: {most} repeats in a row may each take {char!r}; expected {_MOST_SHARING} at "
            "most, so that no line can keep it busy for long: put what every line has between them"
        )
    return pattern


def _each(items: Iterable[Item]) -> Iterator[Item]:
    """Yield all items, those inside of others too."""
    for what, args in items:
        yield what, args
        for inner in _inside(what, args):
            yield from _each(inner)


def _inside(what: Any, args: Any) -> list[Any]:
    """Return the sequences inside of an item."""
    if what in _REPEATS:
        return [args[2]]
    if what is codes.SUBPATTERN:
        return [args[3]]
    if what is codes.BRANCH:
        return list(args[1])
    if what in {codes.ASSERT, codes.ASSERT_NOT}:
        return [args[1]]
    if what is codes.GROUPREF_EXISTS:
        return [part for part in args[1:] if part is not None]
    return [args] if what is codes.ATOMIC_GROUP else []


def _is_character(item: Item) -> bool:
    return item[0] in {codes.LITERAL, codes.NOT_LITERAL, codes.ANY, codes.IN}


def _is_anything(item: Item) -> bool:
    what, args = item
    return what in _REPEATS and args[1] is codes.MAXREPEAT and args[2][0][0] is codes.ANY


@dataclass(frozen=True)
class _Sharing:
    """Repeats in a row that may take one and the same character: at both ends, and at most."""

    first: int = 0
    last: int = 0
    most: int = 0
    through: bool = True  # nothing in it is another character for certain

    def then(self, other: _Sharing) -> _Sharing:
        return _Sharing(
            self.first + (other.first if self.through else 0),
            other.last + (self.last if other.through else 0),
            max(self.most, other.most, self.last + other.first),
            self.through and other.through,
        )

    def either(self, other: _Sharing) -> _Sharing:
        return _Sharing(
            max(self.first, other.first),
            max(self.last, other.last),
            max(self.most, other.most),
            self.through or other.through,
        )


_ONE = _Sharing(1, 1, 1)


def _sharing(items: Iterable[Item], char: str) -> _Sharing:
    found = _Sharing()
    for item in items:
        found = found.then(_sharing_of(item, char))
    return found


def _sharing_of(item: Item, char: str) -> _Sharing:
    what, args = item
    if _is_character(item):
        return _Sharing(through=_takes(item, char))
    if what is codes.GROUPREF:
        return _ONE
    inside = [_sharing(part, char) for part in _inside(what, args)]
    if what in _REPEATS:
        least, most = args[:2]
        varies = most > 1 and least < most  # `?` is counted by itself
        one = _ONE if varies and _takes(args[2][0], char) else inside[0]
        return one if least else one.either(_Sharing())
    found = inside[0] if inside else _Sharing()
    for other in inside[1:]:
        found = found.either(other)
    return found


def _takes(item: Item, char: str) -> bool:
    """Return whether a single character or a set takes this one, as it is or in the other case."""
    what, args = item
    codes_of = {ord(c) for c in (char, char.lower(), char.upper()) if len(c) == 1}
    if what is codes.LITERAL:
        return args in codes_of
    if what is codes.NOT_LITERAL:
        return codes_of != {args}
    if what is codes.ANY:
        return char != "\n"
    negated = args[0][0] is codes.NEGATE
    inside = [any(_in_set(part, code) for part in args) for code in codes_of]
    return not all(inside) if negated else any(inside)


def _in_set(part: Item, code: int) -> bool:
    what, args = part
    if what is codes.LITERAL:
        return bool(args == code)
    if what is codes.RANGE:
        return bool(args[0] <= code <= args[1])
    if what is codes.CATEGORY:
        return re.fullmatch(_CATEGORIES[args], chr(code), re.ASCII) is not None
    return False
