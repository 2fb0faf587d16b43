"""`skinlab export`: a session as tidy files, as a report, or as its pictures."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from skinlab.cli.options import control_option, database_option, study_option
from skinlab.cli.output import echo, tell_left_behind
from skinlab.cli.paths import PATH
from skinlab.text import inert

if TYPE_CHECKING:
    from skinlab.recording.session import Session
    from skinlab.report.page import Section
    from skinlab.report.session_report import Format

_NO_COMPARISON = Path("none")


@click.command()
@click.argument("session", type=PATH)
@click.argument("folder", type=PATH, metavar="DIR")
@click.option(
    "--to",
    "kind",
    type=click.Choice(["csv", "json", "html", "pdf", "png", "svg", "fhir", "parameters"]),
    required=True,
    help="Format.",
)
@database_option("the one that SESSION names")
@click.option(
    "--reference",
    "reference_path",
    type=PATH,
    help="REFERENCE.toml: percentiles in the report.",
)
@click.option("--age-years", type=float, help="Of the person, for --reference.")
@click.option("--sex", type=click.Choice(["f", "m"]), help="For --reference.")
@click.option(
    "--since",
    "since_path",
    type=PATH,
    help="Session that the report compares with, or none [default: the one before it in its "
    "folder, of the same subject and site].",
)
@control_option()
@study_option()
def command(
    session: Path,
    folder: Path,
    kind: Literal["csv", "json", "html", "pdf", "png", "svg", "fhir", "parameters"],
    database_path: Path | None,
    reference_path: Path | None,
    age_years: float | None,
    sex: str | None,
    since_path: Path | None,
    control: tuple[Path, Path] | None,
    study: Path | None,
) -> int:
    """Write SESSION into DIR.

    csv: curves, results, and a campaign of them; json: one file; html: a report with pictures that
    stands alone; pdf: the same, on A4; png, svg: the pictures of that report; fhir: a bundle of
    HL7 FHIR R4; parameters: JSON with all that is needed to compare parameters (docs/exchange.md).
    Prints the paths of what it wrote. A file that exists is never overwritten.

    \b
    Example: skinlab export visit.h5 --to html visit
    """
    from skinlab.acquisition.replay import identifier_of
    from skinlab.exchange.export import export, write_new
    from skinlab.exchange.fhir import to_fhir
    from skinlab.exchange.parameters import to_parameters
    from skinlab.recording.session import read_session

    if reference_path is None and (age_years, sex) != (None, None):
        raise click.UsageError("--age-years and --sex are for --reference")
    if reference_path is not None and kind not in {"html", "pdf"}:
        raise click.UsageError("--reference is for the report, --to html or pdf")
    if (since_path or control or study) and kind not in {"html", "pdf"}:
        raise click.UsageError("--since, --control and --study are for the report: html or pdf")
    read = read_session(session)
    tell_left_behind(session)
    file = inert(session.name)
    match kind:
        case "csv" | "json":
            paths = export(read, kind, folder, file)
        case "fhir":
            paths = write_new(folder, {n: t.encode() for n, t in to_fhir(read, file).items()})
            _tell_without(session, read)
        case "parameters":
            identifier, warning = identifier_of(read, database_path)
            if warning is not None:
                echo(f"skinlab: {session}: {warning}", err=True)
            made = to_parameters(read, identifier, file)
            paths = write_new(folder, {n: t.encode() for n, t in made.items()})
            _tell_without(session, read)
        case _:
            more = []
            if reference_path is not None:
                more.append(_beside(read, reference_path, sex, age_years, database_path))
            if kind in {"html", "pdf"}:
                more += _changed(session, read, since_path, control, study, database_path)
            paths = _export_report(session, read, kind, folder, database_path, more)
    for path in paths:
        echo(str(path))
    return 0


def _tell_without(path: Path, session: Session) -> None:
    """Say which curves have no parameters to export, and why."""
    missing = [r for r in session.results if not (r or {}).get("parameters")]
    if session.curves and not missing:
        return
    if len(missing) < len(session.curves):
        of = f"{len(missing)} of {len(session.curves)} curves have"
    else:
        of = "no curve has"
    if not session.curves:
        why = "the session has no curves"
    elif None in missing:
        why = f"not identified yet; `skinlab identify {path} --json` does, and prints them"
        if session.meta.get("imported") is not None:
            why += "; `skinlab watch` identifies what it imports, and keeps it in its session"
    else:
        why = f"identification failed; `skinlab export {path} --to csv DIR` says why"
    echo(f"skinlab: {path}: {of} parameters: {why}", err=True)


def _beside(
    session: Session,
    path: Path,
    sex: str | None,
    age_years: float | None,
    database_path: Path | None,
) -> Section:
    """Return where the session's values stand in a reference."""
    from skinlab.acquisition.replay import identifier_of
    from skinlab.errors import InputError
    from skinlab.studies.reference import Placed, place, read_reference, section

    reference = read_reference(path)
    model_hash = identifier_of(session, database_path)[0].provenance().model_hash
    found: list[tuple[str, list[Placed] | str]] = []
    for curve, result in zip(session.curves, session.results, strict=True):
        values = {n: v["value"] for n, v in ((result or {}).get("parameters") or {}).items()}
        try:
            placed: list[Placed] | str = place(
                reference,
                values,
                site=str(session.meta.get("site") or ""),
                aperture_mm=curve.setup.aperture_mm,
                program=None if curve.setup.program is None else str(curve.setup.program),
                sex=sex,
                age_years=age_years,
                model_hash=model_hash,
            )
        except InputError as error:
            placed = str(error)
            echo(f"skinlab: {path}: {error}", err=True)
        found.append((curve.name, placed))
    return section(found)


def _changed(
    path: Path,
    session: Session,
    before: Path | None,
    control: tuple[Path, Path] | None,
    study: Path | None,
    database_path: Path | None,
) -> list[Section]:
    """Return whether the skin has changed; nothing where there is nothing to compare with."""
    from skinlab.acquisition.replay import identifier_of
    from skinlab.errors import SkinlabError
    from skinlab.recording.session import measured_utc
    from skinlab.recording.visit_index import visit_before
    from skinlab.studies.comparison import section, since

    if before == _NO_COMPARISON:
        return []
    asked = any((before, control, study))
    if before is None:
        instrument = session.meta.get("instrument")
        simulated = isinstance(instrument, dict) and bool(instrument.get("simulated"))
        whose = (str(session.meta.get("subject") or ""), str(session.meta.get("site") or ""))
        if whose[0] and not measured_utc(session.meta):
            echo(
                f"skinlab: {path}: not compared with an earlier session: nobody stated when it was "
                "measured (--since FILE compares, and `skinlab import --measured` states it)",
                err=True,
            )
        before = visit_before(path.parent, whose, path, simulated=simulated, keep=False)
    if before is None:
        if control is not None:
            raise click.UsageError("--control needs an earlier session of this site: --since FILE")
        return []
    try:
        identifier = identifier_of(session, database_path)[0]
        return [section(since(identifier, before, path, control, study))]
    except SkinlabError as error:
        if asked:
            raise
        echo(f"skinlab: {path}: not compared with {before}: {error}", err=True)
        return [section(str(error))]


def _export_report(
    path: Path,
    session: Session,
    kind: Format,
    folder: Path,
    database_path: Path | None,
    more: Sequence[Section] = (),
) -> list[Path]:
    from skinlab.acquisition.replay import identifier_of
    from skinlab.errors import InputError
    from skinlab.exchange.export import check_free, write_new
    from skinlab.inference.identify import Identifier
    from skinlab.report.session_report import SessionReport

    identifier: Identifier | str
    remarks = []
    try:
        identifier, warning = identifier_of(session, database_path)
    except InputError as error:
        identifier, warning = str(error), None
    if warning is not None:
        echo(f"skinlab: {path}: {warning}", err=True)
        remarks.append(warning[:1].upper() + warning[1:] + ".")
    report = SessionReport(session, identifier, remarks, more, inert(path.name))
    try:
        check_free(folder, report.names(kind))
        hidden = not sys.stderr.isatty()
        with click.progressbar(
            length=len(report.drawings), label="pictures", file=sys.stderr, hidden=hidden
        ) as bar:
            files = report.files(kind, lambda: bar.update(1))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(folder)) else f"{path}: {text}") from None
    return write_new(folder, files)
