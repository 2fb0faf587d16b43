"""Options that only some inverse methods read, set apart in `--help`, refused with any other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.output import echo

if TYPE_CHECKING:
    from skinlab.inference.methods import Method, Option


class MethodCommand(click.Command):
    """A command with the options that the methods declare, under a heading of their own."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._single = _click_options(self.params)
        self.params += self._single

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write all options in their two sections."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        for heading, single in (("Options", False), ("Options of single methods", True)):
            rows = [p.get_help_record(ctx) for p in options if (p in self._single) is single]
            with formatter.section(heading):
                formatter.write_dl([row for row in rows if row is not None])


def _click_options(others: list[click.Parameter]) -> list[click.Option]:
    """Return an option for each name that methods declare; they are None where nothing is given.

    Methods may share a name. One that the command needs itself is left out, with a warning.
    """
    from skinlab.inference.methods import METHODS
    from skinlab.plugins import warn

    taken = {flag for p in others for flag in (*p.opts, *p.secondary_opts, f"--{p.name}")}
    taken.add("--help")
    options = []
    for name, readers in _readers().items():
        first = readers[0][1]
        if first.flag in taken or f"--{name}" in taken:
            who = METHODS.said(readers[0][0].name)
            warn(f"{who}: its option {first.flag} is the command's; expected another name")
            continue
        help_ = "; ".join(f"{m.name}: {o.help}  [default: {o.default:{_g(o)}}]" for m, o in readers)
        options.append(click.Option([first.flag, name], metavar=first.metavar, help=help_))
    return options


def _g(option: Option[Any]) -> str:
    return "g" if isinstance(option.default, float) else ""


def _readers() -> dict[str, list[tuple[Method, Option[Any]]]]:
    """Return the methods that read an option, by its name."""
    from skinlab.inference.methods import METHODS

    found: dict[str, list[tuple[Method, Option[Any]]]] = {}
    for method in METHODS.all():
        for option in method.options:
            found.setdefault(option.name, []).append((method, option))
    return found


def parsed(method: str, samples: int | None, given: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the single methods' options that the user gave (None: nothing).

    Raises:
        click.UsageError: the method does not read one of them, or N is given twice.
    """
    from skinlab.inference.methods import METHODS, get_method
    from skinlab.inference.problem import Options

    chosen = get_method(method)
    own = {option.name: option for option in chosen.options}
    said = {}
    for name, text in given.items():
        if text is None:
            continue
        readers = _readers()[name]
        flag = readers[0][1].flag
        if name not in own:
            whose = " or ".join(m.name for m, _ in readers)
            raise click.UsageError(f"{flag} belongs to --method {whose}; {method} does not read it")
        if own[name].instead_of == "samples" and samples is not None:
            flags = " and ".join(o.flag for o in chosen.options if o.instead_of == "samples")
            raise click.UsageError(f"{flags} give N; leave --samples out")
        try:
            said[name] = own[name].parse(text)
        except ValueError as error:
            raise click.BadParameter(str(error), param_hint=flag) from None
    if samples is not None:
        with METHODS.at_work(method):
            remarks = chosen.remarks(Options(samples=samples).having(**said))
        for remark in remarks:
            echo(f"skinlab: {remark}", err=True)
    return said
