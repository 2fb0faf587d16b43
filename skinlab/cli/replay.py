"""`skinlab replay`: a recorded session through the same pipeline."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.options import json_option, print_json


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.option(
    "--speed", type=click.Choice(["1", "10", "max"]), default="max", help="Pace [default: max]."
)
@click.option("--verify", is_flag=True, help="Compare with the stored results, bit for bit.")
@json_option()
def command(session: Path, speed: str, verify: bool, as_json: bool) -> int:
    """Run a recorded SESSION through driver, assembler and identification again.

    \b
    Example: skinlab replay visit.h5 --speed max --verify
    """
    from skinlab.identify.result import Identification, document
    from skinlab.replay import differences, identifier_of, is_imported, replay
    from skinlab.report.text import describe
    from skinlab.session import read_session
    from skinlab.stream import Identified, Message

    recorded = read_session(session)
    identifier, warning = identifier_of(recorded)
    if warning:
        click.echo(f"skinlab: {warning}", err=True)
    if is_imported(recorded):
        sentence = "imported curves: there are no bytes to replay; the curves are identified again"
        click.echo(f"skinlab: {session}: {sentence}", err=True)
    results: list[Identification] = []

    def show(message: Message) -> None:
        if isinstance(message, Identified):
            results.append(message.result)
            if not as_json:
                click.echo(describe(message.result))

    completed = replay(recorded, identifier, [show], speed=None if speed == "max" else float(speed))
    if as_json:
        print_json(document(identifier.provenance(), results, session=str(session)))
    if not verify:
        return 0
    found = differences(recorded, completed, results)
    for sentence in found:
        click.echo(f"skinlab: {session}: {sentence}", err=True)
    if not found and not as_json:
        stored = sum(result is not None for result in recorded.results)
        click.echo(f"{len(completed)} curves and {stored} stored results agree bit for bit")
    return 1 if found else 0
