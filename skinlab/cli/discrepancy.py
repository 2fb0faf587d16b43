"""`skinlab discrepancy`: what is missing in the model."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinlab.cli.options import (
    database_option,
    json_option,
    placement_scatter_option,
    probe_option,
    read_by,
    workers_option,
)
from skinlab.cli.output import echo, echo_text, print_json, tell_left_behind
from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from skinlab.discrepancy.workflow import Partial


@click.command()
@click.argument("campaign", type=PATH)
@click.option(
    "--model",
    "model_path",
    type=PATH,
    help="MODEL.toml to start from [default: the law alone].",
)
@database_option()
@probe_option(kept=True)
@placement_scatter_option()
@click.option("--adopt", type=PATH, help="Write the model with the effect to this file.")
@click.option("--report", type=PATH, help="Folder for an HTML report.")
@workers_option("; the answers stay the same")
@click.option("--no-cache", is_flag=True, help="Compute again what was computed before.")
@json_option()
def command(
    campaign: Path,
    model_path: Path | None,
    database_path: Path | None,
    probe_path: Path | None,
    placement_scatter: float | str | None,
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
    from skinlab.errors import InputError
    from skinlab.io.files import check_can_write

    # What cannot be written is said now, and not after the computation.
    if adopt is not None:
        if os.path.lexists(adopt):
            raise InputError(f"{adopt}: exists already; expected a new file")
        check_can_write(adopt)
    if report is not None:
        from skinlab.report.missing_effect import check_report
        from skinlab.report.pictures import check_pictures

        check_report(report)
        check_pictures()
    from skinlab.api.explaining import adopt as write_adopted
    from skinlab.api.explaining import base_model, outcome_of
    from skinlab.api.identifiers import find_table
    from skinlab.discrepancy.workflow import Partial
    from skinlab.inference.batch import scatter_of
    from skinlab.recording.load_inputs import read_campaign_or_session

    curves, data = read_campaign_or_session(campaign)
    tell_left_behind(campaign)
    table = find_table(database_path)
    base = base_model(model_path, table)
    curves = replace(
        curves,
        curves=read_by(curves.curves, probe_path),
        placement_scatter=scatter_of(placement_scatter, curves.placement_scatter),
    )
    partial = Partial()
    try:
        outcome = outcome_of(
            curves,
            base,
            table,
            workers=workers,
            cached=not no_cache,
            progress=_progress,
            partial=partial,
        )
    except KeyboardInterrupt:
        _tell_partial(partial, report)
        raise
    lost: list[str] = []  # why a file was not written: the answer comes all the same
    if adopt is not None and not outcome.verdict.explains:
        echo(f"skinlab: the verdict is {outcome.verdict.name}: there is nothing to adopt", err=True)
    elif adopt is not None:
        try:
            write_adopted(outcome, adopt, base, table, data)
        except InputError as error:
            lost.append(str(error))
        else:
            outcome = replace(outcome, adopted_model=str(adopt))
    if report is not None:
        from skinlab.report.missing_effect import write_report

        try:
            echo(f"report: {write_report(outcome, report, curves.title)}", err=True)
        except InputError as error:
            lost.append(str(error))
    if as_json:
        print_json(outcome.to_json())
    else:
        echo_text(describe(outcome))
    if outcome.verdict.name == "ambiguous" and outcome.next_measurement is None:
        echo("skinlab: no measurement of the menu would tell the tied explanations apart", err=True)
    for sentence in lost:
        echo(f"skinlab: {sentence}", err=True)
    return InputError.exit_status if lost else 0


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        echo(f"{text} …", err=True)


def _tell_partial(partial: Partial, report: Path | None) -> None:
    from skinlab.discrepancy.text import partial_words
    from skinlab.errors import InputError
    from skinlab.report.missing_effect import write_partial

    text = partial_words(partial)
    echo_text(text, err=True)
    if report is not None:
        try:
            write_partial(text, report)
        except InputError as error:  # it was interrupted all the same
            echo(f"skinlab: {error}", err=True)
