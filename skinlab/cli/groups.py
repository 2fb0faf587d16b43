"""Groups of commands that say which one was probably meant, and take plain numbers only."""

from __future__ import annotations

from copy import copy
from typing import Any

import click

from drivers.numbers import number_in
from skinlab.text import did_you_mean


class SuggestingGroup(click.Group):
    """A group whose unknown command is answered with the nearest known one."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command.

        Raises:
            click.UsageError: there is none of this name; says what was probably meant.
        """
        name = args[0]
        if not name.startswith("-") and name not in self.list_commands(ctx):
            near = did_you_mean(name, self.list_commands(ctx))
            raise click.UsageError(f"No such command {name!r}{near or '.'}", ctx)
        found = super().resolve_command(ctx, args)
        if found[1] is not None:
            _take_plain_numbers(found[1])
        return found


class _Plain(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """Before a type of numbers: takes what is a number everywhere else, too."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number.

        Raises:
            click.BadParameter: it is none.
        """
        if isinstance(value, str):
            try:
                number_in(value)
            except ValueError:
                self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)
        return super().convert(value, param, ctx)


_NUMBERS = (type(click.FLOAT), type(click.INT), click.FloatRange, click.IntRange)
_PLAIN: dict[type, type] = {kind: type(kind.__name__, (_Plain, kind), {}) for kind in _NUMBERS}


def _take_plain_numbers(command: click.Command) -> None:
    """Refuse 1_0 in its options, however they were declared."""
    for parameter in command.params:
        if type(parameter.type) in _PLAIN:
            plain = copy(parameter.type)  # one is shared by many
            plain.__class__ = _PLAIN[type(parameter.type)]
            parameter.type = plain
