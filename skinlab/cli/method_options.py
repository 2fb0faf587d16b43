"""Options that only one inverse method reads, set apart in `--help`, refused with any other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from skinlab.cli.output import echo

# Name of the parameter → the method that reads it.
_READ_BY = {
    "sampling": "sto",
    "confidence": "sto",
    "accuracy": "sto",
    "slowdown": "hka",
    "forgetting": "rls",
    "covariance": "rls",
    "passes": "rls",
}


class MethodCommand(click.Command):
    """A command whose help lists the options of single methods under a heading of their own."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write all options in their two sections."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        for heading, single in (("Options", False), ("Options of single methods", True)):
            rows = [p.get_help_record(ctx) for p in options if (p.name in _READ_BY) is single]
            with formatter.section(heading):
                formatter.write_dl([row for row in rows if row is not None])


def method_options() -> list[Callable[[Any], Any]]:
    """Return the options; they are None where the user says nothing."""
    return [
        click.option(
            "--sampling",
            type=click.Choice(["uniform", "lhs"]),
            help="sto: uniform, or a Latin hypercube  [default: uniform]",
        ),
        click.option(
            "--confidence",
            type=float,
            help="sto: N from eq. (10), in place of --samples: how sure, 0 to 1  [default: 0.99]",
        ),
        click.option(
            "--accuracy",
            type=float,
            help="sto: the same: in which best fraction of the box  [default: 0.01]",
        ),
        click.option(
            "--slowdown",
            type=float,
            help="hka: the lower, the slower it narrows, 0 to 1  [default: 0.4]",
        ),
        click.option(
            "--forgetting",
            type=float,
            help="rls: lambda0, 1 forgets nothing  [default: 0.9]",
        ),
        click.option(
            "--covariance",
            type=float,
            help="rls: diagonal of P at the start; more is bolder  [default: 1]",
        ),
        click.option("--passes", type=int, help="rls: most runs over a curve  [default: 100]"),
    ]


def single_settings(method: str, samples: int | None, given: dict[str, Any]) -> dict[str, Any]:
    """Return fields of identify's Options from what the user gave (None: nothing).

    Raises:
        click.UsageError: the method does not read one of them, or N is given twice.
        InputError: a confidence or accuracy out of its range.
    """
    said = {name: value for name, value in given.items() if value is not None}
    for name in said:
        if _READ_BY[name] != method:
            raise click.UsageError(
                f"--{name} belongs to --method {_READ_BY[name]}; {method} does not read it"
            )
    confidence, accuracy = said.pop("confidence", None), said.pop("accuracy", None)
    if confidence is None and accuracy is None:
        if samples is not None:
            said["samples"] = samples
            if method == "sto":
                _warn_of_few(samples)
        return said
    if samples is not None:
        raise click.UsageError("--confidence and --accuracy give N; leave --samples out")
    from skinlab.inference.methods.stochastic import ACCURACY, CONFIDENCE, least_samples

    said["samples"] = least_samples(
        CONFIDENCE if confidence is None else confidence,
        ACCURACY if accuracy is None else accuracy,
    )
    return said


def _warn_of_few(samples: int) -> None:
    from skinlab.inference.methods.stochastic import ACCURACY, CONFIDENCE, least_samples

    if samples < (least := least_samples()):
        echo(
            f"skinlab: {samples} samples break the paper's rule, eq. (10): {least} or more for a "
            f"confidence of {CONFIDENCE:g} and an accuracy of {ACCURACY:g}",
            err=True,
        )
