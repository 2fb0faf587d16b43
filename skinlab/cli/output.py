"""The one way out of a command: text that came from outside is inert when it is printed."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

from skinlab.text import inert, inert_lines, json_text

_LONGEST = 1500  # characters of a line to standard error; a path may have some hundreds
_kept: list[TextIO] = []  # standard output while it is kept for us


@contextlib.contextmanager
def output_kept() -> Iterator[None]:
    """Send to standard error what others print, as a plugin may: it would spoil a document."""
    _kept.append(sys.stdout)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _kept.pop()


@contextlib.contextmanager
def reader_may_leave() -> Iterator[None]:
    """Go on where whoever read standard output went away (`| head`): what follows goes nowhere."""
    try:
        yield
    except BrokenPipeError:
        _forget(sys.stdout)


def echo(line: str, *, err: bool = False) -> None:
    """Print one line; `err`: to standard error, which never fails and takes no floods.

    Raises:
        OSError: standard output cannot be written, for another reason than a closed terminal.
    """
    _write((_shortened(inert(line)) if err else inert(line)) + "\n", err)


def echo_text(text: str, *, err: bool = False) -> None:
    """Print several lines.

    Raises:
        OSError: as `echo`.
    """
    lines = inert_lines(text)
    _write(("\n".join(map(_shortened, lines.split("\n"))) if err else lines) + "\n", err)


def _shortened(line: str) -> str:
    """Leave out the middle of a line that repeats a whole file's content."""
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 300]} … {line[-300:]}"


def tell_left_behind(session: Path) -> None:
    """Say that a crash left a journal that says more than a session, if one did."""
    from skinlab.recording.journal import left_behind

    journal = left_behind(session)
    if journal is not None:
        why = f"{journal.name} beside it was left by a crash, and says more"
        echo(f"skinlab: {session}: {why}: skinlab recover {journal}", err=True)


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document; nothing in it may be NaN or infinite.

    Raises:
        OSError: as `echo`.
    """
    _write(json_text(document) + "\n", err=False)


def status_line(text: str) -> None:
    """Replace the line that the cursor of a terminal is in."""
    _write(f"\r\x1b[K{inert(text)}", err=True)


def _write(text: str, err: bool) -> None:
    stream = sys.stderr if err else (_kept or [sys.stdout])[-1]
    encoding = getattr(stream, "encoding", None) or "utf-8"
    try:
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        stream.flush()
    except OSError as error:
        if not err and error.errno != errno.EIO:
            error.filename = "standard output"
            raise
        _forget(stream)  # the terminal was closed: nobody reads it, and nothing else may fail


def _forget(stream: TextIO) -> None:
    """Let what is still in the stream, and all that follows, go nowhere."""
    number = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(number, stream.fileno())
    finally:
        os.close(number)
