"""Which files a study is made of, and what is known of each before it is read.

What a curve was measured with, and whose it is, comes from the first of these that states it:

1. a row of a table: any CSV in the folder with a column `file` (`skinlab export` writes one);
2. a campaign.toml that lists the file;
3. `--layout`, a pattern of the path inside the folder such as
   `{subject}/{site}/v{visit}_p{placement}`, and parts of the path such as `subject=P-017`;
4. the file itself, where it is a session;
5. the command line.

A CSV with a column `subject` and none of `file` says what is known of the people: age, sex, group.
"""

from __future__ import annotations

import csv
import errno
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.reading import read_whole
from skinlab.errors import InputError
from skinlab.exchange.importing.folder import SUFFIXES
from skinlab.exchange.importing.headings import read_heading
from skinlab.io.documents import read_toml
from skinlab.io.files import cannot_read, file_hash, named_in_errors, real_path
from skinlab.mechanics.names import parameter_of
from skinlab.recording.session_names import SESSIONS
from skinlab.studies.facts import LABELS, LEFT_OUT, NOISE, PARTIAL, SETUP, Facts, checked
from skinlab.studies.path_layout import PathLayout, pairs_of

_TEXTS = frozenset({"file", "program", *LABELS})
_MEANT = frozenset({"time_s", LEFT_OUT, PARTIAL, *_TEXTS, *SETUP, *NOISE})
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+")
STATE = "study.sqlite"  # in the folder that a study writes
LEFT_ALONE = "left alone: "  # how the reason begins of what nobody would take for a curve

_NOT_LEFT_OUT = frozenset({"no", "false", "0"})

_ENDINGS = SUFFIXES | SESSIONS
_EXPECTED = ", ".join(sorted(_ENDINGS))
_HEAD_BYTES = 4096
_MOST_BYTES = 2 << 30  # of any file: to look at more takes longer than anybody waits
_OURS = re.compile(  # columns of exported tables that a study computes itself
    r".*(_MPa|_low|_high|_um)|name|samples|points|partial|flags|not_identified|error|sha256|session_file"
)


@dataclass(frozen=True)
class Source:
    """One file: its name in the study, its path, what is known of it, or why it cannot be used."""

    name: str
    path: Path
    facts: Facts = field(default_factory=dict)
    error: str | None = None

    @property
    def left_alone(self) -> bool:
        """Whether it is no curve, and nobody would take it for one."""
        return self.error is not None and self.error.startswith(LEFT_ALONE)


@dataclass(frozen=True)
class Table:
    """A CSV with a heading: rows as they stand, by column, each with its line."""

    path: Path
    columns: tuple[str, ...]
    rows: Sequence[tuple[int, dict[str, str]]]


@dataclass(frozen=True)
class Plan:
    """How to look at the folders."""

    folders: tuple[Path, ...]
    stated: Mapping[str, Any] = field(default_factory=dict)  # by the command line
    layout: str | None = None
    without: Path | None = None  # the study's own folder


def sha256_of(path: Path) -> str:
    """Return the hash of a file's bytes.

    Raises:
        OSError: it cannot be read.
    """
    if path.stat().st_size > _MOST_BYTES:
        raise OSError(errno.EFBIG, f"larger than {_MOST_BYTES >> 30} GB")
    return file_hash(path).removeprefix("sha256:")


def find_sources(plan: Plan) -> Iterator[Source | Table]:
    """Yield tables of people, then every file, folder by folder, in the order of their names.

    Raises:
        InputError: a folder does not exist, no curve is in any, the layout is none, or what is
            stated is out of range.
    """
    layout = None if plan.layout is None else PathLayout.of(plan.layout)
    checked(plan.stated, "stated for all files")
    names = _folder_names(plan.folders)
    for folder in plan.folders:
        with cannot_read(folder):
            there = folder.exists()
        if not there:
            raise InputError(f"{folder}: no such folder")
        if not (folder.is_dir() or folder.is_file()):
            raise InputError(f"{folder}: a pipe or a device; expected a folder")
    empty: list[Source] = []
    for folder, prefix in zip(plan.folders, names, strict=True):
        if folder.is_file():
            yield _Top(folder.parent, "", plan, layout).source(folder, {})
            continue
        curves = False
        for found in _Top(folder, prefix, plan, layout).walk(folder, {}):
            curves = curves or (isinstance(found, Source) and not found.left_alone)
            yield found
        if not curves:
            reason = f"{folder}: no curve is in it; expected {_EXPECTED}"
            empty.append(Source(prefix or folder.name, folder, error=reason))
    if len(empty) == len(plan.folders):  # a wrong folder, or a drive that is away
        raise InputError("; ".join(str(one.error) for one in empty))
    yield from empty


@dataclass(frozen=True)
class _Top:
    """A folder that was named, and how to look at what is in it."""

    folder: Path
    prefix: str  # of the names of its files
    plan: Plan
    layout: PathLayout | None

    def walk(self, folder: Path, known: Mapping[Path, Facts]) -> Iterator[Source | Table]:
        """Yield what is in one folder; what its tables say of deeper files goes down with it."""
        try:
            entries = sorted(os.scandir(folder), key=lambda e: e.name)
        except OSError as error:
            reason = f"{folder}: {error.strerror or error}"
            yield Source(self.prefix or folder.name, folder, error=reason)
            return
        if any(entry.name == STATE for entry in entries):
            yield self._unusable(folder, f"{LEFT_ALONE}{folder}: the folder of a study")
            return
        folders, files = [], []
        for entry in entries:
            path = Path(entry.path)
            if entry.name.startswith((".", "~")):
                continue
            kind, why = _kind(entry)
            if kind == "folder":
                if self.plan.without is None or real_path(path) != self.plan.without:
                    folders.append(path)
            elif kind == "file":
                files.append(path)
            else:
                yield self._unusable(path, f"{path}: {why}")
        listed = dict(known)
        curves: list[Path] = []
        for path in files:
            suffix = path.suffix.lower()
            try:
                if suffix == ".toml":
                    listed |= _campaign(path)
                elif suffix == ".csv" and (table := read_table(path)) is not None:
                    if "file" in table.columns:
                        listed |= _listed(table)
                    else:
                        yield table
                elif suffix in _ENDINGS:
                    curves.append(path)
                elif suffix == ".journal":
                    reason = f"{path}: a measurement that did not end; see `skinlab recover`"
                    yield self._unusable(path, reason)
                else:
                    yield self._unusable(path, f"{LEFT_ALONE}{path}: expected {_EXPECTED}")
            except InputError as error:
                yield self._unusable(path, str(error))
        for path in curves:
            yield self.source(path, listed.pop(path, {}))
        below: dict[Path, dict[Path, Facts]] = {path: {} for path in folders}
        for path, facts in listed.items():
            branch = next((p for p in path.parents if p in below), None)
            if branch is not None:
                below[branch][path] = facts
            else:
                reason = f"{path}: listed in {facts['listed']}, and not there"
                yield self._unusable(path, facts.get("error", reason))
        for path, facts_of in below.items():
            yield from self.walk(path, facts_of)

    def source(self, path: Path, facts: Facts) -> Source:
        """Return a file with all that is known of it."""
        if "error" in facts:
            return self._unusable(path, str(facts["error"]))
        if str(facts.get(LEFT_OUT, "no")).casefold() not in _NOT_LEFT_OUT:
            reason = f"{LEFT_ALONE}{path}: its operator left it out: {facts[LEFT_OUT]}"
            return self._unusable(path, reason)
        try:
            merged = {**self.plan.stated, **self._by_path(path), **facts}
            merged.pop("listed", None)
            return Source(self._name(path), path, checked(merged, str(path)))
        except InputError as error:
            return self._unusable(path, str(error))

    def _unusable(self, path: Path, reason: str) -> Source:
        return Source(self._name(path), path, error=reason)

    def _by_path(self, path: Path) -> Facts:
        """Return what a path says: pairs from the named folder on, a layout inside it.

        Raises:
            InputError: the path is none of the layout, or a pair is wrong.
        """
        stem = path.relative_to(self.folder).as_posix().rsplit(".", 1)[0]
        with named_in_errors(path):
            found = pairs_of(f"{real_path(self.folder).name}/{stem}")
            return found if self.layout is None else found | self.layout.facts(stem)

    def _name(self, path: Path) -> str:
        try:
            inside = path.relative_to(self.folder).as_posix()
        except ValueError:
            inside = path.name
        return f"{self.prefix}/{inside}" if self.prefix else inside


def _kind(entry: os.DirEntry[str]) -> tuple[str, str]:
    """Return whether this is a folder or a file, or neither, and why."""
    try:
        if entry.is_dir(follow_symlinks=False):
            named = Path(entry.name).suffix.lower() in _ENDINGS
            if named and not os.listdir(entry.path):
                return "", "an empty folder, expected a file"
            return "folder", ""
        if entry.is_file():
            return "file", ""
        if entry.is_dir():
            return "", "a link to a folder, which is not followed; name the folder itself"
        return "", "a link to nothing" if entry.is_symlink() else "no regular file"
    except OSError as error:  # a link that leads to itself, a folder that nobody may read
        return "", error.strerror or str(error)


def _folder_names(folders: Sequence[Path]) -> list[str]:
    """Return what each folder is called in the names of its files; nothing where there is one."""
    if len(folders) == 1:
        return [""]
    names = [real_path(folder).name for folder in folders]
    return [
        name if names.count(name) == 1 else f"{name}-{k}" for k, name in enumerate(names, start=1)
    ]


# ---- what tables say ------------------------------------------------------------------------


def read_table(path: Path) -> Table | None:
    """Return a table of files or people; None where this CSV is a curve.

    Raises:
        InputError: it is one, and cannot be read.
    """
    with named_in_errors(path), path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    first = head.split(b"\n", 1)[0].decode("utf-8-sig", errors="replace").strip()
    sign = max(",;\t", key=first.count)
    columns = tuple(_column(c.strip().strip('"')) for c in first.split(sign))
    if "file" not in columns and "subject" not in columns:
        return None
    if _of_samples(columns):
        return None
    try:
        text = read_whole(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{path}: not UTF-8 text; expected a table") from None
    reader = csv.reader(text.splitlines(), delimiter=sign)
    try:
        every = [(values, reader.line_num) for values in reader]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: {error}") from None
    columns = tuple(_column(c.strip()) for c in every[0][0])
    if len(set(columns)) < len(columns):
        raise InputError(f"{path}: line 1: a column is there twice")
    rows = []
    for values, line in every[1:]:
        if not any(v.strip() for v in values):
            continue
        if len(values) != len(columns):
            raise InputError(f"{path}: line {line}: {len(values)} fields, expected {len(columns)}")
        cells = {c: v.strip() for c, v in zip(columns, values, strict=True) if v.strip()}
        if sign != ",":  # then a comma may be a decimal sign
            numbers = (c for c in cells if c not in _TEXTS and _DECIMAL_COMMA.fullmatch(cells[c]))
            cells |= {c: cells[c].replace(",", ".") for c in numbers}
        rows.append((line, cells))
    return Table(path, columns, rows)


def _of_samples(columns: Sequence[str]) -> bool:
    """Return whether columns are those of a curve, which may say whose it is in one more."""
    told = {read_heading(c).role for c in columns if c not in _MEANT and not _is_ours(c)}
    return "time_s" in columns or told >= {"time", "pressure"} or told >= {"time", "deflection"}


def _column(text: str) -> str:
    """Return the name of a column; those that mean something may be in capitals."""
    return text.casefold() if text.casefold() in _MEANT else text


def _listed(table: Table) -> dict[Path, Facts]:
    """Return what a table says of files, by path; a row that is wrong as an error of its file."""
    found: dict[Path, Facts] = {}
    folder = table.path.parent
    for line, cells in table.rows:
        if "file" not in cells:
            continue
        path = Path(os.path.normpath(folder / cells["file"]))
        where = f"{table.path}: line {line}"
        facts: Facts = {"listed": table.path.name}
        if path in found:
            facts["error"] = f"{where}: {cells['file']} is listed twice"
        elif not path.is_relative_to(folder):
            facts["error"] = (  # not this study's to read: the table is what is wrong
                f"{where}: {cells['file']} is outside of the table's folder; expected a file in it"
            )
            found.setdefault(table.path, facts)
            continue
        else:
            wanted = {k: v for k, v in cells.items() if k != "file" and not _is_ours(k)}
            try:
                wanted |= {k: cells[k].casefold() for k in (PARTIAL,) if k in cells}
                facts |= checked(wanted | {k: cells[k] for k in NOISE if k in cells}, where)
            except InputError as error:
                facts["error"] = str(error)
        found[path] = facts
    return found


def _is_ours(column: str) -> bool:
    return bool(_OURS.fullmatch(column)) or parameter_of(column) is not None


def _campaign(path: Path) -> dict[Path, Facts]:
    """Return what a campaign says of its files; nothing where this TOML is none.

    Raises:
        InputError: it is a campaign, and damaged.
    """
    try:
        data = read_toml(read_whole(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}") from None
    header, entries = data.get("campaign"), data.get("curve")
    if not isinstance(header, dict) or not isinstance(entries, list):
        return {}
    shared = {k: v for k, v in header.items() if k in (*NOISE, *LABELS)}
    found: dict[Path, Facts] = {}
    for number, entry in enumerate(entries, start=1):
        where = f"{path}: curve {number}"
        if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
            raise InputError(f"{where}: expected a field file")
        known = (*SETUP, *LABELS)
        facts: Facts = {"listed": path.name, "campaign": path.parent.name}
        try:
            facts |= checked(shared | {k: v for k, v in entry.items() if k in known}, where)
        except InputError as error:
            facts["error"] = str(error)
        found[Path(os.path.normpath(path.parent / entry["file"]))] = facts
    return found
