"""`measure --protocol`: one step of a study's protocol, without a screen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from skinlab.acquisition.protocol import NamedProtocol, ProtocolStep

F = TypeVar("F", bound=Callable[..., Any])


def protocol_options() -> Callable[[F], F]:
    """`--protocol`, `--step`, `--condition`."""

    def apply(function: F) -> F:
        for option in (
            click.option(
                "--condition",
                "conditions",
                multiple=True,
                metavar="NAME=VALUE",
                help="With --protocol: a condition as it was, e.g. room_temperature_c=22.5.",
            ),
            click.option(
                "--step", default=1, show_default=True, help="Which step of the protocol."
            ),
            click.option(
                "--protocol",
                "protocol_path",
                type=PATH,
                help="PROTOCOL.toml of a study: gives opening, program, repeats and rest.",
            ),
        ):
            function = option(function)
        return function

    return apply


@dataclass(frozen=True)
class AskedStep:
    """A step of a protocol, and the conditions as stated."""

    named: NamedProtocol
    step: ProtocolStep
    stated: Mapping[str, str]

    def otherwise(self, site: str, repeats: int | None, rest_s: float | None) -> list[str]:
        """Return what is otherwise than the protocol says, in clauses; None: as it says."""
        from skinlab.acquisition.protocol import conditions_missing, site_not_named, step_otherwise

        protocol = self.named.protocol
        return [
            *step_otherwise(self.step, self.step.repeats, repeats, rest_s),
            *site_not_named(protocol, site),
            *conditions_missing(protocol, dict(self.stated)),
        ]

    def trail(
        self, site: str, repeats: int | None, rest_s: float | None
    ) -> list[tuple[str, dict[str, Any]]]:
        """Return what the session's audit trail keeps of it."""
        from skinlab.report.protocol import protocol_trail

        return protocol_trail(self.named, self.stated, self.otherwise(site, repeats, rest_s))


def read_step(path: Path, number: int, conditions: tuple[str, ...]) -> AskedStep:
    """Return a step of the protocol in this file, by its number from 1.

    Raises:
        InputError: the file is wrong.
        click.UsageError: it has no such step, or asks for no such condition.
    """
    from skinlab.acquisition.protocol import condition_complaint, demanded, read_protocol
    from skinlab.text import did_you_mean

    named = read_protocol(path)
    steps, known = named.protocol.step, demanded(named.protocol)
    if not 1 <= number <= len(steps):
        raise click.UsageError(f"--step {number}: the protocol has steps 1 to {len(steps)}")
    stated = {}
    for text in conditions:
        name, _, value = text.partition("=")
        if name not in known:
            near = did_you_mean(name, known) or f"; it asks for {', '.join(known) or 'none'}"
            raise click.UsageError(f"--condition {name}: the protocol does not ask for it{near}")
        complaint = condition_complaint(name, value)
        if complaint is not None:
            raise click.UsageError(f"--condition: {complaint}")
        stated[name] = value
    return AskedStep(named, steps[number - 1], stated)
