"""What `import` and `watch` share: the options that answer what a file leaves open."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

_HELP = {
    "encoding": "Encoding of text files  [default: found by looking].",
    "separator": "What stands between two fields.",
    "decimal": "Decimal sign.",
    "sheet": "Sheet of a workbook, where several hold a table.",
    "time-column": "Heading of the time, or its number from 1.",
    "pressure-column": "Heading of the pressure, or its number.",
    "deflection-column": "Heading of the deflection, or its number.",
    "time-unit": "Unit of the time, where the file does not name it.",
    "pressure-unit": "Unit of the pressure, as with the time.",
    "deflection-unit": "Unit of the deflection, as with the time.",
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


def _measured(_: click.Context, param: click.Parameter, text: str | None) -> str:
    """Return when curves were measured as a session keeps it; "" where it is not stated."""
    from skinlab.errors import InputError
    from skinlab.exchange.importing.stated_time import stated_time

    try:
        return "" if text is None else stated_time(text, datetime.now(UTC))
    except InputError as error:
        raise click.BadParameter(str(error), param=param) from None


def form_options(unmeasured: str) -> Callable[[F], F]:
    """Return a decorator that adds the options; `stated` takes the values of those of the form.

    `unmeasured` is what holds without --measured.
    """

    def apply(function: F) -> F:
        for name in reversed(_HELP):
            choices = _CHOICES.get(name)
            kind = click.Choice(choices, case_sensitive=False) if choices else None
            shown = f"[{'|'.join(choices)}]" if choices else None
            function = click.option(f"--{name}", type=kind, metavar=shown, help=_HELP[name])(
                function
            )
        function = click.option(
            "--measured",
            callback=_measured,
            metavar="DAY[THH:MM]",
            help=f"Day of the measurement, or day and local time  [default: {unmeasured}].",
        )(function)
        function = click.option("--site", default="", help="Where on the body.")(function)
        return click.option("--subject", default="", help="Pseudonym; never a name.")(function)

    return apply


def stated(options: dict[str, Any], *, program: bool) -> dict[str, str]:
    """Take the values of `form_options` out of `options`; by name, those that were given.

    `program` is whether there is one that could have started.
    """
    values = {name: options.pop(name.replace("-", "_")) for name in _HELP}
    if values["program-start-s"] is not None and not program:
        raise click.UsageError("--program-start-s is for --program")
    return {name: value for name, value in values.items() if value is not None}
