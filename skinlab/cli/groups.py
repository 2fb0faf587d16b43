"""Groups of commands that say which one was probably meant."""

from __future__ import annotations

import click

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
        return super().resolve_command(ctx, args)
