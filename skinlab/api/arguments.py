"""What a function says of its arguments' types, held to where a user calls it."""

from __future__ import annotations

import functools
import inspect
import os
import re
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from skinlab.curves import curve as curves
from skinlab.errors import InputError, SkinlabError

P = ParamSpec("P")
R = TypeVar("R")

_WORDS: dict[object, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "a text",
    os.PathLike: "a path, as str or Path",
    curves.Curve: "a curve, such as skinlab.read_curve returns",
    type(None): "None",
}
_LISTS = (Sequence, list, tuple)
_OPTION = re.compile(r"`[^`]*`|“[^”]*”|--(?P<option>[a-z]+(?:-[a-z0-9]+)*)")
_LONGEST = 60  # of a value that is shown
_MOST_WORKERS = 1024
_AS_NUMPY_COMES: dict[str, Any] = {
    "divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse values of another type than the function's hints say, before it is called.

    Numbers of numpy become Python's: json and h5py write no others, so results and sessions need
    them. Options by any name (`**options`) are the function's own to check.

    Raises:
        InputError: names the argument, and what was expected.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        hints = _hints(function)
        args = tuple(map(plain, args))  # type: ignore[assignment]
        kwargs = {name: plain(value) for name, value in kwargs.items()}  # type: ignore[assignment]
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD:
                continue
            if not _fits(value, hints[name]):
                raise InputError(f"{name} {_short(value)}: expected {_words(hints[name])}")
        try:
            with np.errstate(**_AS_NUMPY_COMES):  # and not as the caller's program has it
                return function(*args, **kwargs)
        except SkinlabError as error:
            error.args = (_as_arguments(str(error), signature.parameters),)
            raise

    return call


def plain(value: Any) -> Any:
    """Return a number of numpy as Python's; all else as it is."""
    return value.item() if isinstance(value, np.generic) else value


def check_workers(workers: int | None) -> None:
    """Refuse a number of processes that no machine has, as `--workers` does.

    Raises:
        InputError: says what was expected.
    """
    if workers is not None and not 1 <= workers <= _MOST_WORKERS:
        raise InputError(f"workers {workers}: expected 1–{_MOST_WORKERS}")


def _as_arguments(sentence: str, known: Mapping[str, inspect.Parameter]) -> str:
    """Name the function's arguments as its caller writes them: `out`, where a sentence has --out.

    What is a command, in quotes, stays one.
    """

    def written(found: re.Match[str]) -> str:
        name = found["option"] and found["option"].replace("-", "_")
        if name not in known:
            return found[0]
        return f"{name}=True" if known[name].default is False else name

    return _OPTION.sub(written, sentence)


@functools.cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    return get_type_hints(function)


def _fits(value: Any, hint: Any) -> bool:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return any(_fits(value, one) for one in get_args(hint))
    if hint is Any or origin is Literal:  # names are refused with those that there are
        return True
    if hint in (int, float):
        return isinstance(value, Integral if hint is int else Real) and not isinstance(value, bool)
    if origin in _LISTS:
        if isinstance(value, str | bytes) or not isinstance(value, Iterable):
            return False
        of = get_args(hint)[0]
        return not isinstance(value, list | tuple) or all(_fits(one, of) for one in value)
    if origin is Callable:
        return callable(value)
    return isinstance(value, origin or hint)


def _words(hint: Any) -> str:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        each = [one for one in get_args(hint) if one is not str or not _has_path(hint)]
        return " or ".join(dict.fromkeys(_words(one) for one in each))
    if origin in _LISTS:
        return f"a list, each of it {_words(get_args(hint)[0])}"
    if origin is Literal:
        return " or ".join(map(repr, get_args(hint)))
    name = getattr(origin or hint, "__name__", str(hint))
    return _WORDS.get(origin or hint, f"a {name}")


def _has_path(hint: Any) -> bool:
    return any(get_origin(one) is os.PathLike for one in get_args(hint))


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
