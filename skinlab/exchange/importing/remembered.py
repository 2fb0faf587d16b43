"""Answers to what files left open, kept for each layout of headings in the user's settings.

One software exports all its files alike, so that a question is asked once, and not once a day. The
file is TOML and may be edited or deleted; docs/files.md describes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from platformdirs import user_config_path

from drivers.reading import read_whole
from skinlab.errors import InputError
from skinlab.io.documents import decode, read_toml, toml_text
from skinlab.io.files import named_in_errors, write_file

# What holds for a file of this layout; the start of a program is each file's own
_KEPT = ("-column", "-unit", "-sign")


class _Layout(msgspec.Struct, forbid_unknown_fields=True):
    headings: list[str]
    answers: dict[str, str] = msgspec.field(default_factory=dict)


class _File(msgspec.Struct, forbid_unknown_fields=True):
    layout: list[_Layout] = msgspec.field(default_factory=list)


def default_path() -> Path:
    """Return where answers are kept."""
    return user_config_path("skinlab", appauthor=False) / "imports.toml"


class Remembered:
    """The answers in a file, which is read at once.

    Raises:
        InputError: the file is damaged; names it and the field.
    """

    def __init__(self, path: Path, *, ask_again: bool = False) -> None:
        """With `ask_again` nothing is answered from the file; new answers replace the old ones."""
        self.path = path
        self._ask_again = ask_again
        with named_in_errors(path):
            try:
                self._file = decode(read_toml(read_whole(path)), _File)
            except FileNotFoundError:
                self._file = _File()

    def answer(self, headings: Sequence[str], option: str) -> str | None:
        """Return what was answered for files of these headings; None: nothing yet."""
        if self._ask_again:
            return None
        found = self._layout(headings)
        return None if found is None else found.answers.get(option)

    def keep(self, headings: Sequence[str], option: str, answer: str) -> bool:
        """Keep an answer; False: it is of one file only, there are no headings, or no place."""
        if not option.endswith(_KEPT) or not any(headings):
            return False
        found = self._layout(headings)
        if found is None:
            found = _Layout(list(headings))
            self._file.layout.append(found)
        found.answers[option] = answer
        try:
            write_file(self.path, toml_text(msgspec.to_builtins(self._file)), replace=True)
        except (OSError, InputError):
            return False
        return True

    @property
    def lines(self) -> list[str]:
        """All answers, in sentences."""
        if not self._file.layout:
            return [f"no answers are kept ({self.path})"]
        found = [f"answers in {self.path}:"]
        for layout in self._file.layout:
            said = ", ".join(f"--{option} {answer}" for option, answer in layout.answers.items())
            found.append(f"  files with the headings {'; '.join(layout.headings)}: {said}")
        return found

    def _layout(self, headings: Sequence[str]) -> _Layout | None:
        return next((one for one in self._file.layout if one.headings == list(headings)), None)
