"""`skinlab plugins`: which extensions there are, and whether they obey the rules."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.groups import SuggestingGroup
from skinlab.cli.options import json_option
from skinlab.cli.output import echo, echo_text, print_json

if TYPE_CHECKING:
    from skinlab.extensions.rules import Kind
    from skinlab.plugins import Origin

SCHEMA = "skinlab.plugins/1"
DIFFERS = 1

_KINDS = ("law", "effect", "method", "error model", "gate", "dialect")


@click.group(cls=SuggestingGroup, invoke_without_command=True)
@click.option("--table", type=click.Choice(_KINDS), help="The built-in ones as docs show them.")
@json_option()
@click.pass_context
def command(ctx: click.Context, table: str | None, as_json: bool) -> int | None:
    """List laws, effects, methods, error models, gates and dialects, and where each comes from.

    An installed package adds its own by entry points: docs/extending.md has a recipe for each kind.

    \b
    Example: skinlab plugins
             skinlab plugins check my_effect
    """
    if ctx.invoked_subcommand is not None:
        return None
    from skinlab.extensions.kinds import KINDS

    if table is not None:
        (kind,) = (k for k in KINDS if k.name == table)
        echo_text(kind.markdown().removesuffix("\n"))
        return 0
    entries = [entry for kind in KINDS for entry in _entries(kind)]
    _warn_of_groups()
    if as_json:
        print_json({"schema": SCHEMA, "plugins": entries})
        return 0
    for entry in entries:
        where = "built in" if entry["distribution"] is None else _origin(entry)
        what = where if entry["error"] is None else entry["error"]
        echo(f"{entry['kind']:<13}{entry['name']:<26}{what}")
    return 0


def _entries(kind: Kind[Any]) -> Iterator[dict[str, Any]]:
    for name in kind.registry.names():
        yield _entry(kind, name, kind.registry.origin(name), None)
    for name, origin, why in kind.registry.refused():
        yield _entry(kind, name, origin, why)


def _entry(kind: Kind[Any], name: str, origin: Origin | None, why: str | None) -> dict[str, Any]:
    return {
        "kind": kind.name,
        "name": name,
        "distribution": None if origin is None else origin.distribution,
        "version": None if origin is None else origin.version,
        "error": why,
    }


def _warn_of_groups() -> bool:
    """Warn of each entry point that no kind looks for; return whether there is one."""
    from skinlab.extensions.kinds import KINDS
    from skinlab.plugins import in_no_group, warn

    sentences = in_no_group([kind.registry.group for kind in KINDS])
    for sentence in sentences:
        warn(sentence)
    return bool(sentences)


def _origin(entry: dict[str, Any]) -> str:
    return f"{entry['distribution']} {entry['version']}"


@command.command()
@click.argument("names", nargs=-1)
@click.option("--all", "everything", is_flag=True, help="What is built in, too.")
@json_option()
def check(names: tuple[str, ...], everything: bool, as_json: bool) -> int:
    """Try the rules of its kind on every installed extension, or on NAMES.

    Status 1 where one is broken. The same rules hold for what is built in.

    \b
    Example: skinlab plugins check
    """
    from skinlab.extensions.kinds import KINDS
    from skinlab.extensions.rules import broken, says

    listed = [(kind, entry) for kind in KINDS for entry in _entries(kind)]
    unknown = sorted(set(names) - {entry["name"] for _, entry in listed})
    if unknown:
        raise click.UsageError(f"nothing is called {', '.join(unknown)}; `skinlab plugins` lists")
    lost = _warn_of_groups()
    rows: list[dict[str, Any]] = []
    for kind, entry in listed:
        name = entry["name"]
        if name not in names and (names or not (everything or entry["distribution"])):
            continue
        found: list[tuple[str, str | None]] = [("It can be loaded", entry["error"])]
        if entry["error"] is None:
            one = kind.registry.get(name)
            found += [(says(rule), broken(rule, one)) for rule in kind.rules]
        for rule, why in found:
            rows.append({"kind": kind.name, "name": name, "rule": rule, "broken": why})
            if not as_json:
                end = "" if why is None else f": {why}"
                echo(f"{'ok    ' if why is None else 'BROKEN'} {kind.name} {name}: {rule}{end}")
    if as_json:
        print_json({"schema": SCHEMA, "rules": rows})
    elif not rows and not lost:
        echo("no plugins are installed; --all tries what is built in")
    return DIFFERS if lost or any(row["broken"] for row in rows) else 0
