"""Options for the parameters of laws, made from what the laws declare: such as --x1-mpa."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click


def option_name(parameter: str) -> str:
    """Return the option of a law's parameter: --x1-mpa of X1_MPa."""
    return "--" + parameter.lower().replace("_", "-")


def _field(parameter: str) -> str:
    return f"law_{parameter.lower()}"


class LawCommand(click.Command):
    """A command with an option for each parameter of each law; its function gets `law_…` of all."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's own parameters and the laws'."""
        from skinlab.mechanics.materials import DEFAULT_LAW, LAWS, get_law, law_names
        from skinlab.plugins import warn

        own = super().get_params(ctx)
        taken = {flag for p in own for flag in (*p.opts, *p.secondary_opts)}
        laws = [get_law(name) for name in (DEFAULT_LAW, *law_names())]
        helps: dict[str, str] = {}
        for law in dict.fromkeys(laws):
            for one in law.parameters:
                unit = f", {one.unit}" if one.unit else ""
                text = f"{one.label} of {law.name}{unit}: {one.meaning}."
                if option_name(one.name) in taken:
                    who, flag = LAWS.said(law.name), option_name(one.name)
                    warn(f"{who}: its option {flag} is the command's; expected another name")
                    continue
                helps.setdefault(one.name.lower(), text)
        options = [
            click.Option([option_name(name), _field(name)], type=float, help=text)
            for name, text in helps.items()
        ]
        return [*options, *own]


def law_values(law_name: str, given: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the values of a law's parameters from the options given (`law_…`; None: nothing).

    Raises:
        click.UsageError: one is missing, or belongs to another law.
    """
    from skinlab.mechanics.materials import get_law, law_names

    law = get_law(law_name)
    fields = set(map(_field, law.names))  # C2 of one law and c2 of another have one option
    for other in law_names():
        for one in get_law(other).parameters:
            if given.get(_field(one.name)) is not None and _field(one.name) not in fields:
                own = ", ".join(map(option_name, law.names))
                raise click.UsageError(
                    f"{option_name(one.name)} is not a parameter of the law {law.name}, "
                    f"which takes {own}"
                )
    for name in law.names:
        if given.get(_field(name)) is None:
            raise click.UsageError(f"Missing option '{option_name(name)}'.")
    return tuple(float(given[_field(name)]) for name in law.names)
