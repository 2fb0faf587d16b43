"""What a path says of a curve: `--layout '{subject}/{site}/v{visit}'`, or `subject=P-017`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from skinlab.errors import InputError
from skinlab.studies.facts import LABELS, SETUP, Facts

_KNOWN = (*LABELS, *SETUP)
_ANY = "any"


@dataclass(frozen=True)
class PathLayout:
    """A pattern of the whole path of a file inside its folder, without the name's ending.

    `shortest` takes as little for each name as it can, `longest` as much. Beside `{any}`, which
    takes the rest, names are short in both.
    """

    text: str
    shortest: re.Pattern[str]
    longest: re.Pattern[str]

    @classmethod
    def of(cls, text: str) -> PathLayout:
        """Return the pattern that this text describes.

        Raises:
            InputError: it names something that there is not, or nothing, or something twice.
        """
        names = _named(text)[1::2]
        for name in names:
            if name not in _KNOWN and name != _ANY:
                raise InputError(
                    f"layout {text}: {{{name}}} is unknown; expected one of "
                    f"{', '.join('{' + k + '}' for k in _KNOWN)} and {{{_ANY}}}"
                )
        stated = [name for name in names if name != _ANY]
        if not stated or len(set(stated)) < len(stated):
            raise InputError(f"layout {text}: expected each name once, at least one")
        return cls(text, _pattern(text, longest=False), _pattern(text, longest=True))

    def facts(self, stem: str) -> Facts:
        """Return what a path inside its folder says, without the ending of the file's name.

        Raises:
            InputError: it does not fit, or in more than one way; says what to write.
        """
        match, other = self.shortest.fullmatch(stem), self.longest.fullmatch(stem)
        if match is None or other is None:
            raise InputError(f"does not fit layout {self.text}{self._hint(stem)}")
        for name, value in match.groupdict().items():
            if other[name] != value:
                raise InputError(
                    f"fits layout {self.text} in two ways: {name} may be {value!r} or "
                    f"{other[name]!r}; expected a separator that is in no name, or a folder each"
                )
        return {name: value for name, value in match.groupdict().items() if value}

    def _hint(self, stem: str) -> str:
        """Return what to write where the layout fits the end of a path."""
        parts = stem.split("/")
        for k in range(1, len(parts)):
            if self.shortest.fullmatch("/".join(parts[k:])):
                anything = f"{{{_ANY}}}/" * k
                return (
                    f", which does not say what {'/'.join(parts[:k])}/ is; expected a name for "
                    f"each level of the path, or {anything}{self.text} if it says nothing"
                )
        return ", which is of the whole path inside the folder, without the ending"


def _named(text: str) -> list[str]:
    """Return text and names in turn."""
    return re.split(r"\{(\w+)\}", text)


def _pattern(text: str, *, longest: bool) -> re.Pattern[str]:
    levels = []
    for level in text.split("/"):
        parts = _named(level)
        more = "+" if longest and _ANY not in parts[1::2] else "+?"
        levels.append(
            "".join(
                re.escape(part)
                if k % 2 == 0
                else "[^/]+"
                if part == _ANY
                else f"(?P<{part}>[^/]{more})"
                for k, part in enumerate(parts)
            )
        )
    return re.compile("/".join(levels))


def pairs_of(path: str) -> Facts:
    """Return what parts of a path such as `subject=P-017` say.

    Raises:
        InputError: two of them contradict each other.
    """
    found: Facts = {}
    for part in re.split(r"[/,]", path):
        key, equals, value = part.partition("=")
        if not (equals and key in _KNOWN and value):
            continue
        if found.setdefault(key, value) != value:
            raise InputError(f"{key}={found[key]} and {key}={value} in one path; expected one")
    return found
