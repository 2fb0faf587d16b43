"""Extensions found by looking: in the folder of their kind, and in installed packages.

An extension is one object in one file. In the package it is what a module of the kind's folder
calls `EFFECT`, `LAW`, …; an installed package offers it by an entry point of the kind's group
(`skinlab.effects`), whose name is the extension's and whose value says where the object is
(`my_package.my_effect:EFFECT`). docs/extending.md has a recipe for each kind.

What is wrong with an installed one is said once, in one sentence that names it; it is then not
there. Worker processes look for themselves and find the same.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import math
import os
import pkgutil
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.machinery import PathFinder
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from drivers.breakdown import reason
from skinlab.errors import BrokenPluginError, InputError, SkinlabError
from skinlab.text import did_you_mean, inert

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUPS = "skinlab."  # what the names of all groups begin with
_METADATA = (".dist-info", ".egg-info")
_OURS = {"skinlab", "drivers"}
# What ends a program, and is no plugin's. All else is one's own: a panic of compiled code, or a
# test that skips, is no Exception either.
_FROM_OUTSIDE = (KeyboardInterrupt, GeneratorExit)


class Named(Protocol):
    """What every extension has."""

    @property
    def name(self) -> str:
        """How it is called in files and options."""
        ...


T = TypeVar("T", bound=Named)


@dataclass(frozen=True)
class Origin:
    """Where an extension comes from: a distribution, as installers call it, and its version."""

    distribution: str
    version: str


class AtWork:
    """Name an installed extension that breaks down while this lasts: a context manager.

    A class, since fits enter it often, and a generator is slow. `who` returns how a sentence names
    it; None: it is built in, and its error comes through as it is. `refuses` returns what it is
    called where it may refuse values that a user stated; that is then named, too.
    """

    __slots__ = ("_refuses", "_who")

    def __init__(
        self, who: Callable[[], str | None], refuses: Callable[[], str] | None = None
    ) -> None:
        self._who, self._refuses = who, refuses

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None or isinstance(error, _FROM_OUTSIDE):
            return
        if isinstance(error, SkinlabError):
            if self._refuses is not None and isinstance(error, InputError):
                named = f"{self._who() or self._refuses()}: "
                if not str(error).startswith(named):  # one part of it may ask another
                    raise InputError(f"{named}{error}") from error
        elif (who := self._who()) is not None:
            raise broken(who, error) from error


class Registry(Generic[T]):
    """The extensions of one kind; looked for when first asked.

    `package` is the folder of the built-in ones, `attribute` what their modules call them, `group`
    that of the entry points. `check` raises an error, whose message says what is wrong, for an
    object that is none of this kind. `called` is how messages name one. `adopt` is told how a
    sentence names an installed one, for kinds that are called from where no registry is known.
    """

    def __init__(
        self,
        kind: str,
        package: str,
        attribute: str,
        group: str,
        check: Callable[[Any], None],
        *,
        called: Callable[[str], str] | None = None,
        adopt: Callable[[Any, str], None] | None = None,
    ) -> None:
        self.kind, self.group = kind, group
        self.package, self.attribute = package, attribute
        self._check, self._adopt = check, adopt
        self._called = called or (lambda name: f"{kind} {name!r}")
        self._lock = threading.RLock()
        self._found: dict[str, T] = {}
        self._origins: dict[str, Origin] = {}
        self._refused: dict[str, list[tuple[Origin, str]]] = {}
        self._looked = False

    def names(self) -> tuple[str, ...]:
        """Return the names of all, sorted."""
        return tuple(sorted(self._all()))

    def all(self) -> tuple[T, ...]:
        """Return all, in the order of their names."""
        found = self._all()
        return tuple(found[name] for name in sorted(found))

    def get(self, name: str) -> T:
        """Return the one of that name.

        Raises:
            InputError: there is none; the message lists those that there are, and says what is
                wrong with an installed one of that name.
        """
        try:
            return self._all()[name]
        except KeyError:
            why = "; ".join(sentence for _, sentence in self._refused.get(name, ()))
            known, near = ", ".join(self.names()), did_you_mean(name, self.names())
            raise InputError(
                f"{self._called(name)} is not known{f' ({why})' if why else ''}; "
                f"expected one of: {known or 'none is there'}{near}"
            ) from None

    def origin(self, name: str) -> Origin | None:
        """Return where the one of that name comes from; None: it is built in."""
        self._all()
        return self._origins.get(name)

    def who(self, name: str) -> str | None:
        """Return how a sentence names an installed one; None: it is built in."""
        origin = self.origin(name)
        return None if origin is None else f"plugin {origin.distribution}, {self.kind} {name!r}"

    def said(self, name: str) -> str:
        """Return how a sentence names one, built in or not."""
        return self.who(name) or self._called(name)

    def at_work(self, name: str, *, refuses: bool = False) -> AtWork:
        """Name an installed one that breaks down while this lasts.

        With `refuses` any one, built in or not, that refuses values.

        Raises:
            BrokenPluginError: it did; an error of what is built in comes through as it is.
            InputError: it refuses values.
        """
        return AtWork(partial(self.who, name), partial(self._called, name) if refuses else None)

    def refused(self) -> list[tuple[str, Origin, str]]:
        """Return the name, the origin and why it is not there, of each that was left out."""
        self._all()
        return [(name, *one) for name, each in self._refused.items() for one in each]

    @contextlib.contextmanager
    def lent(self, one: T) -> Iterator[T]:
        """Have one more in this process for a while: one that is in no file and not installed.

        Raises:
            TypeError, ValueError: it is none of this kind.
        """
        self._check(one)
        found = self._all()
        before = found.get(one.name)
        found[one.name] = one
        try:
            yield one
        finally:
            del found[one.name]
            if before is not None:
                found[one.name] = before

    def _all(self) -> dict[str, T]:
        with self._lock:
            if not self._looked:
                self._looked = True  # an extension that asks while it is imported sees the others
                self._look()
            return self._found

    def _look(self) -> None:
        for one in _built_in(self.package, self.attribute):
            self._check(one)
            if one.name in self._found:
                raise TypeError(f"two built-in ones are called {self._called(one.name)}")
            self._found[one.name] = one
        for entry in entries(self.group):
            if (why := self._take(entry)) is not None:
                self._refused.setdefault(entry.name, []).append((origin_of(entry), why))
                warn(why)

    def _take(self, entry: EntryPoint) -> str | None:
        """Load an installed one; return what is wrong with it."""
        origin = origin_of(entry)
        who = f"plugin {origin.distribution}, {self.kind} {entry.name!r}"
        if entry.name in self._found:
            other = self._origins.get(entry.name)
            by = "is built in" if other is None else f"comes from {other.distribution}"
            return f"{who}: left out, because one of this name {by}"
        try:
            with _as_it_was():  # the check asks it, too
                one = entry.load()
                self._check(one)
            if one.name != entry.name:
                raise TypeError(f"it calls itself {one.name!r}; expected its entry point's name")
            if self._adopt is not None:
                self._adopt(one, who)
        except _FROM_OUTSIDE:
            raise
        except BaseException as error:  # noqa: BLE001 -- anything may be in it
            return f"{who}: left out, because it is broken: {reason(error)}"
        self._found[entry.name] = one
        self._origins[entry.name] = origin
        return None


def broken(who: str, error: BaseException) -> BrokenPluginError:
    """Return the sentence that says that an installed one broke down, and why."""
    return BrokenPluginError(f"{who}: broke down: {reason(error)}")


@contextlib.contextmanager
def blaming() -> Iterator[None]:
    """Name the plugin whose code raises while this lasts, wherever it was called from.

    Raises:
        BrokenPluginError: one did; an error of what is built in comes through as it is.
    """
    try:
        yield
    except (SkinlabError, *_FROM_OUTSIDE):
        raise
    except BaseException as error:
        why = blamed(error)
        if why is None:
            raise
        raise BrokenPluginError(why) from error


@contextlib.contextmanager
def _as_it_was() -> Iterator[None]:
    """Undo what an import may change for everybody: answers to overflow, warnings, the folder.

    What it prints goes to standard error: a document may follow.
    """
    import warnings

    import numpy as np  # slow to import

    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # a folder that is gone
            stack.callback(os.chdir, os.getcwd())
        stack.enter_context(contextlib.redirect_stdout(sys.stderr))
        stack.enter_context(warnings.catch_warnings())
        stack.enter_context(np.errstate())
        yield


def _built_in(package: str, attribute: str) -> Iterator[Any]:
    """Yield what the package's modules call `attribute`; their import errors come through."""
    for found in pkgutil.iter_modules(importlib.import_module(package).__path__):
        module = importlib.import_module(f"{package}.{found.name}")
        if hasattr(module, attribute):
            yield getattr(module, attribute)


def needs(one: object, *attributes: str) -> None:
    """Check that an extension has a name, and what else its kind has to have.

    Raises:
        TypeError: it has not.
    """
    missing = [a for a in ("name", *attributes) if not hasattr(one, a)]
    if missing:
        raise TypeError(f"{type(one).__name__} has no {', '.join(missing)}")
    name = one.name  # type: ignore[attr-defined]
    if not isinstance(name, str) or not name.strip():
        raise TypeError("its name is empty; expected a text")


def finite(what: str, value: object) -> float:
    """Return a finite number.

    Raises:
        TypeError: it is none.
    """
    if not isinstance(value, Real) or not math.isfinite(value):
        raise TypeError(f"{what} is {value!r}; expected a finite number")
    return float(value)


def zero_or_more(what: str, value: object) -> float:
    """Return a size.

    Raises:
        TypeError: it is none.
    """
    if (found := finite(what, value)) < 0.0:
        raise TypeError(f"{what} is {value!r}; expected 0 or more")
    return found


def above_zero(what: str, value: object, most: float = math.inf) -> float:
    """Return a number above 0.

    Raises:
        TypeError: it is none, or above the most.
    """
    if not 0.0 < (found := finite(what, value)) <= most:
        upper = "" if most == math.inf else f", at most {most:g}"
        raise TypeError(f"{what} is {value!r}; expected more than 0{upper}")
    return found


def texts(one: object, *attributes: str) -> None:
    """Check that attributes of an extension, which reports and help print, are texts.

    Raises:
        TypeError: one is not.
    """
    for name in attributes:
        value: object = getattr(one, name)
        if not isinstance(value, str):
            raise TypeError(f"its {name} is {value!r}; expected a text")


# ---- what is installed ------------------------------------------------------------------------


def entries(group: str | None = None) -> list[EntryPoint]:
    """Return the entry points of a group, or of all of ours; sorted, so that all find the same."""
    try:
        found = [e for e in _every_entry() if group in (None, e.group)]
    except Exception as error:  # noqa: BLE001 -- metadata that somebody else has damaged
        warn(f"no plugins: the metadata of an installed package is damaged: {reason(error)}")
        return []
    return sorted(found, key=lambda e: (e.group, e.name, origin_of(e).distribution))


def in_no_group(known: Sequence[str]) -> tuple[str, ...]:
    """Return a sentence for each entry point whose group looks like ours, and is not: a slip."""
    return tuple(
        f"plugin {origin_of(entry).distribution}, {entry.name!r}: left out, because its group "
        f"{entry.group} is not known; expected one of: {', '.join(known)}"
        f"{did_you_mean(entry.group, known)}"
        for entry in entries()
        if entry.group not in known
    )


@cache
def _every_entry() -> tuple[EntryPoint, ...]:
    """Return all of ours; looked for once, in a file of every installed package."""
    if not _may_be_some():
        return ()
    import importlib.metadata  # slow to import

    every = importlib.metadata.entry_points()
    return tuple(e for g in every.groups if g.startswith(GROUPS) for e in every.select(group=g))


def _may_be_some() -> bool:
    """Return whether an installed package may have one of our groups.

    No where `importlib.metadata` would find none: it takes a tenth of `skinlab identify` to import.
    """
    if any(hasattr(f, "find_distributions") and f is not PathFinder for f in sys.meta_path):
        return True
    for place in sys.path:
        if place.lower().endswith(".egg"):
            return True
        try:
            with os.scandir(place or ".") as found:
                folders = [e.path for e in found if e.name.lower().endswith(_METADATA)]
        except NotADirectoryError:
            return True  # an archive
        except OSError:
            continue  # as Python's own search does
        for folder in folders:
            with contextlib.suppress(OSError):
                if b"[" + GROUPS.encode() in Path(folder, "entry_points.txt").read_bytes():
                    return True
    return False


def origin_of(entry: EntryPoint) -> Origin:
    """Return the distribution that an entry point is from."""
    if entry.dist is None:
        return Origin("unknown", "unknown")
    return Origin(entry.dist.name or "unknown", entry.dist.version or "unknown")


@cache
def installed() -> dict[str, str]:
    """Return every distribution with plugins: its version, and a hash of its source files.

    The hash tells two states of a plugin apart that is being written under one version. Nothing of
    a plugin is imported for it.
    """
    modules: dict[Origin, set[str]] = {}
    for entry in entries():
        modules.setdefault(origin_of(entry), set()).add(_package(entry))
    return {
        origin.distribution: f"{origin.version} {_hash(names)}"
        for origin, names in sorted(modules.items(), key=lambda item: item[0].distribution)
    }


def blamed(error: BaseException) -> str | None:
    """Return in words which plugin an error came through; None: through none."""
    import traceback  # slow to import

    files = {Path(frame.filename) for frame in traceback.extract_tb(error.__traceback__)}
    for entry in entries():
        package = _package(entry)
        if package not in _OURS and files & set(_sources(package)):
            return f"plugin {origin_of(entry).distribution}: broke down: {reason(error)}"
    return None


def _package(entry: EntryPoint) -> str:
    """Return the top package, or the module, that an entry point's object is in."""
    return str(entry.value).partition(":")[0].partition(".")[0].strip()


def _hash(modules: set[str]) -> str:
    digest = hashlib.sha256()
    for name in sorted(modules - _OURS):
        for path in _sources(name):
            digest.update(f"{name} {path.name} ".encode())
            with contextlib.suppress(OSError):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _sources(module: str) -> list[Path]:
    """Return the Python files of a module or package, without importing it."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    folders = spec.submodule_search_locations
    if folders is not None:
        return sorted(path for folder in folders for path in Path(folder).rglob("*.py"))
    return [Path(spec.origin)] if spec.has_location and spec.origin else []


# ---- what is said -----------------------------------------------------------------------------

_said: set[str] = set()


def warn(sentence: str) -> None:
    """Say it on standard error, once; workers are silent: who started them has said it."""
    if sentence in _said:
        return
    _said.add(sentence)
    multiprocessing = sys.modules.get("multiprocessing.process")  # loaded in every worker
    if multiprocessing is not None and multiprocessing.parent_process() is not None:
        return
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.write(f"skinlab: {inert(sentence)}\n")
            sys.stderr.flush()
