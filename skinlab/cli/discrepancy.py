"""`skinlab discrepancy`: what is missing in the model."""

from __future__ import annotations

import datetime
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinlab.cli.options import database_option, json_option
from skinlab.cli.output import echo, echo_text, print_json

if TYPE_CHECKING:
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.mechanics.model_file import Model
    from skinlab.tables.table import Table


@click.command()
@click.argument("campaign", type=click.Path(path_type=Path))
@click.option(
    "--model", "model_path", type=click.Path(path_type=Path), help="Model to start from [base]."
)
@database_option()
@click.option("--adopt", type=click.Path(path_type=Path), help="Write the model with the effect.")
@click.option("--report", type=click.Path(path_type=Path), help="Folder for an HTML report.")
@click.option("--workers", type=int, help="Processes; same answers [default: all cores].")
@click.option("--no-cache", is_flag=True, help="Compute again what was computed before.")
@json_option()
def command(
    campaign: Path,
    model_path: Path | None,
    database_path: Path | None,
    adopt: Path | None,
    report: Path | None,
    workers: int | None,
    no_cache: bool,
    as_json: bool,
) -> int:
    """Find where simulation and measurement disagree, and which physical effect is missing.

    CAMPAIGN: a campaign's TOML (or its folder), or a session.

    \b
    Example: skinlab discrepancy forearm/campaign.toml --adopt forearm-model.toml --report out
    """
    from skinlab.discrepancy.text import describe

    if workers is not None and workers < 1:
        raise click.BadParameter("expected 1 or more", param_hint="--workers")
    if adopt is not None and adopt.exists():
        from skinlab.errors import InputError

        raise InputError(f"{adopt}: exists already; expected a new file")
    outcome, files = _outcome(
        campaign, model_path, database_path, workers or os.cpu_count() or 1, no_cache, report
    )
    if adopt is not None:
        outcome = _adopt(outcome, adopt, model_path, database_path, files)
    if report is not None:
        from skinlab.report.missing_effect import write_report

        echo(f"report: {write_report(outcome, report)}", err=True)
    if as_json:
        print_json(outcome.to_json())
    else:
        echo_text(describe(outcome))
    if outcome.verdict.name == "ambiguous" and outcome.next_measurement is None:
        echo("skinlab: no measurement of the menu would tell the tied explanations apart", err=True)
    return 0


def _outcome(
    path: Path,
    model_path: Path | None,
    database_path: Path | None,
    workers: int,
    no_cache: bool,
    report: Path | None,
) -> tuple[Outcome, list[Path]]:
    from skinlab.discrepancy import cache
    from skinlab.discrepancy.adopt import hashes
    from skinlab.discrepancy.records import records_of
    from skinlab.discrepancy.workflow import Partial, explain
    from skinlab.recording.load_inputs import read_campaign_or_session
    from skinlab.tables.store import read, shipped_table

    campaign, files = read_campaign_or_session(path)
    table = shipped_table() if database_path is None else read(database_path)
    model = _base(model_path, table)
    data = (f"{file} {content}" for file, content in hashes(files).items())
    name = cache.key([model.hash, table.content_hash, *data])
    known = None if no_cache else cache.load(name, records_of(campaign))
    if known is not None:
        return known, files

    def progress(text: str) -> None:
        if sys.stderr.isatty():
            echo(f"{text} …", err=True)

    partial = Partial()
    try:
        outcome = explain(
            campaign, table, model=model, workers=workers, progress=progress, partial=partial
        )
    except KeyboardInterrupt:
        from skinlab.discrepancy.text import partial_words
        from skinlab.io.files import write_file
        from skinlab.text import inert_lines

        text = partial_words(partial)
        echo_text(text, err=True)
        if report is not None:
            write_file(report / "partial.txt", inert_lines(text) + "\n", replace=True)
        raise
    cache.save(name, outcome)
    return outcome, files


def _base(model_path: Path | None, table: Table) -> Model:
    """Return the model to start from: that of the file, else the table's law as it is."""
    from skinlab.mechanics.model_file import BASE, Header, Model, read_model

    if model_path is not None:
        return read_model(model_path)
    return BASE if table.law == BASE.model.law else Model(Header(table.law, table.law))


def _adopt(
    outcome: Outcome,
    to: Path,
    model_path: Path | None,
    database_path: Path | None,
    files: list[Path],
) -> Outcome:
    from dataclasses import replace
    from importlib.metadata import version

    from skinlab.discrepancy.adopt import adopted, hashes
    from skinlab.io.files import write_file
    from skinlab.tables.store import read, shipped_table

    if outcome.verdict.name != "named":
        echo(f"skinlab: the verdict is {outcome.verdict.name}: there is nothing to adopt", err=True)
        return outcome
    table = shipped_table() if database_path is None else read(database_path)
    model = adopted(
        _base(model_path, table),
        outcome.posteriors[outcome.best.effects],
        verdict=outcome.verdict.name,
        data=hashes(files),
        database_hash=table.content_hash,
        version=version("skinlab"),
        date=datetime.datetime.now(datetime.UTC).date().isoformat(),
    )
    write_file(to, model.to_toml())
    return replace(outcome, adopted_model=str(to))
