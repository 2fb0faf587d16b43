"""What `import` and `watch` share: the options that answer what a file leaves open."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

_HELP = {
    "encoding": "Of text files [default: found by looking].",
    "separator": "Between two fields.",
    "decimal": "Sign of the decimals.",
    "sheet": "Of a workbook, where several hold a table.",
    "time-column": "Its heading, or its number from 1; so with the others.",
    "pressure-column": "",
    "deflection-column": "",
    "time-unit": "",
    "pressure-unit": "",
    "deflection-unit": "",
    "deflection-sign": "- where the file counts the dome as negative.",
    "program-start-s": "The file's time at which the program started.",
}
_CHOICES = {
    "encoding": ("UTF-8", "UTF-16", "Latin-1"),
    "separator": ("tab", "semicolon", "comma", "space"),
    "decimal": ("point", "comma"),
    "time-unit": ("s", "ms", "µs", "min"),
    "pressure-unit": ("mbar", "bar", "hPa", "kPa", "Pa", "mmHg"),
    "deflection-unit": ("mm", "µm", "um", "cm"),
    "deflection-sign": ("+", "-"),
}


def form_options() -> Callable[[F], F]:
    """Return a decorator that adds the options; `stated` takes their values."""

    def apply(function: F) -> F:
        for name in reversed(_HELP):
            choices = _CHOICES.get(name)
            kind = click.Choice(choices, case_sensitive=False) if choices else None
            shown = f"[{'|'.join(choices)}]" if choices else None
            function = click.option(f"--{name}", type=kind, metavar=shown, help=_HELP[name])(
                function
            )
        function = click.option("--site", default="", help="Where on the body.")(function)
        return click.option("--subject", default="", help="Pseudonym; never a name.")(function)

    return apply


def stated(options: dict[str, Any]) -> dict[str, str]:
    """Take the values of `form_options` out of `options`; by name, those that were given."""
    values = {name: options.pop(name.replace("-", "_")) for name in _HELP}
    return {name: value for name, value in values.items() if value is not None}
