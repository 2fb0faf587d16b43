"""What an inverse method is: a search, and what it says of itself, its options with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from drivers.numbers import number_in
from skinlab.errors import InputError
from skinlab.inference.problem import Estimate, Options, Problem
from skinlab.inference.settings import STARTS
from skinlab.plugins import needs, texts

V = TypeVar("V", int, float, str)

_KINDS = {int: "INTEGER", float: "NUMBER", str: "TEXT"}
_WORDS = {int: "an integer", float: "a number", str: "a text"}


@dataclass(frozen=True)
class Option(Generic[V]):
    """An argument that a method reads beyond those of all: `--name` on the command line.

    `help` ends with no full stop. `accepts` says whether a value can work, `expected` in words what
    can. `instead_of` is one of the common options, which this one settles and cannot stand beside.
    """

    name: str  # as Python spells it
    default: V
    help: str
    expected: str = ""
    accepts: Callable[[V], bool] = lambda _: True
    choices: tuple[V, ...] = ()
    instead_of: str | None = None

    @property
    def flag(self) -> str:
        """How the command line spells it."""
        return "--" + self.name.replace("_", "-")

    @property
    def metavar(self) -> str:
        """What stands for a value in the help."""
        if self.choices:
            return f"[{'|'.join(map(str, self.choices))}]"
        return _KINDS[type(self.default)]

    def of(self, options: Options) -> V:
        """Return its value among these options.

        Raises:
            InputError: it cannot work.
        """
        return self.checked(dict(options.own).get(self.name, self.default))

    def checked(self, value: Any) -> V:
        """Return a value that can work.

        Raises:
            InputError: names the option and what was expected.
        """
        expected = self.expected or " or ".join(map(str, self.choices))
        if not _is_a(type(self.default), value):
            raise InputError(f"{self.name} {value!r}: expected {_WORDS[type(self.default)]}")
        if self.choices and value not in self.choices:
            raise InputError(f"{self.name} {value!r}: expected {expected}")
        if not self.accepts(value):
            raise InputError(f"{self.name} {value}: expected {expected}")
        found: V = value
        return found

    def parse(self, text: str) -> V:
        """Return the value that a text says.

        Raises:
            ValueError: it says none.
        """
        kind = type(self.default)
        try:
            if kind is not str:
                number_in(text)
            value = kind(text)
        except ValueError:
            raise ValueError(f"{text!r} is not {_WORDS[kind]}") from None
        if self.choices and value not in self.choices:
            raise ValueError(f"{text!r} is not one of {', '.join(map(str, self.choices))}")
        return value


def _is_a(kind: type, value: object) -> bool:
    """Whether it is of this kind; every whole number is a number."""
    return not isinstance(value, bool) and isinstance(
        value, (int, float) if kind is float else kind
    )


class Search(Protocol):
    """What a method does. Same problem, options and generator state: same bits."""

    def __call__(self, problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
        """Return the answer."""
        ...


def _as_they_are(options: Options) -> Options:
    return options


def _nothing(options: Options) -> tuple[str, ...]:
    del options
    return ()


@dataclass(frozen=True)
class Method:
    """An inverse method: its name, its search, and what command line, report and docs ask of it."""

    name: str
    search: Search
    meaning: str  # how it finds the answer, for a report: no full stop
    options: tuple[Option[Any], ...] = ()
    in_papers_box: bool = False  # searches where the paper does, whatever the database
    most_fitted: int = STARTS.most_fitted  # samples of a curve: of more, evenly some
    settle: Callable[[Options], Options] = _as_they_are  # turns its own into common ones
    remarks: Callable[[Options], tuple[str, ...]] = _nothing  # what is doubtful about them

    def __call__(self, problem: Problem, options: Options, rng: np.random.Generator) -> Estimate:
        """Return the answer.

        Raises:
            InputError: an option is out of its range, or not of this method.
        """
        self.check(options)
        return self.search(problem, self.settle(options), rng)

    def check(self, options: Options) -> None:
        """Refuse options of its own that cannot work, and those that it does not read.

        Raises:
            InputError: names the option and what was expected.
        """
        known = {option.name: option for option in self.options}
        for name, value in options.own:
            if name not in known:
                raise InputError(f"{name}: method {self.name} does not read it")
            known[name].checked(value)

    def own(self, options: Options) -> dict[str, Any]:
        """Return the values of its own options, defaults filled in, but for those that settle."""
        return {o.name: o.of(options) for o in self.options if o.instead_of is None}


def check_method(one: object) -> None:
    """Check that an extension is a method.

    Raises:
        TypeError: it is not.
    """
    needs(one, "search", "meaning", "options")
    if not isinstance(one, Method):
        raise TypeError(
            f"it is a {type(one).__name__}; expected a skinlab.inference.methods.base.Method"
        )
    texts(one, "meaning")
    for name in ("search", "settle", "remarks"):
        if not callable(given := getattr(one, name)):
            raise TypeError(f"its {name} is a {type(given).__name__}; expected a function")
    in_box: object = one.in_papers_box
    if not isinstance(in_box, bool):
        raise TypeError(f"its in_papers_box is {in_box!r}; expected True or False")
    most: object = one.most_fitted
    if not isinstance(most, int) or most < 2:
        raise TypeError(f"its most_fitted is {most!r}; expected an int above 1")
    options: object = one.options
    if not isinstance(options, tuple) or not all(isinstance(o, Option) for o in options):
        raise TypeError("its options are not skinlab.inference.methods.base.Option")
    for option in one.options:
        _check_option(option)
    names = [option.name for option in one.options]
    if len(set(names)) < len(names):
        raise ValueError(f"two of its options have one name: {', '.join(names)}")
    if not isinstance(one.settle(Options()), Options):
        raise TypeError("its settle returns no Options")
    remarks: object = one.remarks(Options())
    if not isinstance(remarks, tuple | list) or not all(isinstance(r, str) for r in remarks):
        raise TypeError(f"its remarks are {remarks!r}; expected a tuple of texts")


def _check_option(option: Option[Any]) -> None:
    """Check an option that a method declares.

    Raises:
        TypeError, InputError: the command line cannot have it.
    """
    name: object = option.name
    common = {f.name for f in fields(Options)} | {"method", "seed"}
    if not isinstance(name, str) or not name.isidentifier() or name in common:
        raise TypeError(f"its option {name!r} is not a name, or one of all methods")
    for field in ("help", "expected"):
        if not isinstance(text := getattr(option, field), str):
            raise TypeError(f"its option {name}: {field} is {text!r}; expected a text")
    if type(option.default) not in _KINDS:
        raise TypeError(f"its option {name} has no default of type int, float or str")
    choices: object = option.choices
    if not isinstance(choices, tuple) or not callable(option.accepts):
        raise TypeError(
            f"its option {name}: expected a tuple of choices, and a function that accepts"
        )
    option.checked(option.default)
