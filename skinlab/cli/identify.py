"""`skinlab identify`: from curves to parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    database_option,
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
    placement_scatter_option,
    prior_options,
    probe_option,
    read_by,
    reference_options,
    with_prior_option,
    workers_option,
)
from skinlab.cli.output import echo, echo_text, print_json, tell_left_behind
from skinlab.cli.paths import PATH
from skinlab.cli.start import INTERRUPTED

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from skinlab.curves.campaign import Unusable
    from skinlab.curves.curve import Curve, Setup
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Advice, Identification
    from skinlab.recording.load_inputs import Input
    from skinlab.recording.session import StatedModel
    from skinlab.studies.reference import Reference


@click.command(cls=MethodCommand)
@click.argument("inputs", nargs=-1, required=True, type=PATH)
@geometry_options(required=False)
@identification_options()
@database_option()
@probe_option(kept=True)
@prior_options(site=True)
@reference_options()
@click.option("--joint", is_flag=True, help="One answer for all curves, as of one skin.")
@placement_scatter_option("With --joint: how")
@click.option("--advise", is_flag=True, help="Say which measurement would narrow the intervals.")
@workers_option("; the answers stay the same", default=1)
@click.option("--strict", is_flag=True, help="Exit with 5 where a result is not trustworthy.")
@json_option()
def command(
    inputs: tuple[Path, ...],
    aperture_mm: float | None,
    thickness_mm: float | None,
    thickness_sd_mm: float | None,
    probe_path: Path | None,
    prior_path: Path | None,
    age_years: float | None,
    site: str | None,
    reference_path: Path | None,
    sex: str | None,
    joint: bool,
    placement_scatter: float | str | None,
    advise: bool,
    workers: int,
    strict: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Identify the skin's parameters from INPUTS: curve CSVs, sessions or campaigns.

    A CSV needs --aperture-mm and --thickness-mm. Its header is time_s,pressure_mbar,deflection_mm.
    Sessions and campaigns state aperture and thickness of each curve themselves.
    With --joint all curves are explained by one skin, and sessions of two people or two sites are
    refused; with --advise the measurement is named that
    would narrow the intervals most (of all curves together, or of the first).
    With --database the answer comes from a database of your own; if its model has effects, their
    parameters are identified too, as far as they are axes of it.
    A session that was measured with a probe file is read with it, and with the noise that was
    stated when it was measured; by the law alone, though, unless --model names its model.
    Ctrl-C prints what is done by then.
    With --prior what a study knows of such people narrows the intervals; a skin that is unlike them
    keeps its own, and gets the flag unlike_cohort.

    \b
    Example: skinlab identify curve.csv --aperture-mm 6 --thickness-mm 1.0 --json
             skinlab identify campaign.toml --joint --advise
    """
    from skinlab.inference.batch import with_scatter
    from skinlab.inference.result import document, not_trustworthy
    from skinlab.recording.load_inputs import Input
    from skinlab.text import counted

    if advise and options["method"] != "auto":
        raise click.UsageError("--advise needs the intervals that only --method auto gives")
    if advise and options["database_path"] is not None:
        raise click.UsageError("--advise needs the shipped database, which speaks of all openings")
    if placement_scatter is not None and not joint:
        raise click.UsageError("--placement-scatter is for --joint")
    if (site, age_years) != (None, None) and (prior_path, reference_path) == (None, None):
        raise click.UsageError("--site and --age-years are for --prior and --reference")
    if sex is not None and reference_path is None:
        raise click.UsageError("--sex is for --reference")
    if (reference_path is None) != (site is None) and prior_path is None:
        raise click.UsageError("--reference needs --site")
    identifier: Identifier = with_prior_option(
        make_identifier(**options), prior_path, site, age_years
    )
    reference = None
    if reference_path is not None:
        from skinlab.studies.reference import read_reference

        reference = read_reference(reference_path)  # before anything is computed
    geometry = _geometry(inputs, aperture_mm, thickness_mm, thickness_sd_mm)
    taken = list(
        _taken(inputs, geometry, probe_path, identifier, options["database_path"], whole=joint)
    )
    read = [one for one in taken if isinstance(one, Input)]
    if joint:
        _check_together(read)
    found = _Found()
    try:
        found.fill(identifier, taken, workers)
        knowing = identifier
        if joint and read:
            curves = _first_cycles(identifier, read)
            knowing = _knowing_all(identifier, read, placement_scatter)
            found.together = knowing.joint(curves)
        elif read:
            knowing = with_scatter(identifier, read[0].placement_scatter)
        if advise and (source := found.advised):
            found.advice = knowing.advise(source, _thickness_mm(source, read))
    except KeyboardInterrupt:
        if not found.results:
            raise
        found.stopped = True
    known = identifier.of_probe([curve for given in read for curve in given.curves])
    whole = document(known.provenance(), found.results, joint=found.together, advice=found.advice)
    refused = []
    placed: dict[int, list[str]] = {}
    if reference is not None:
        for k, result in enumerate(found.results):
            said, lines = _beside(reference, result, site or "", sex, age_years, whole)
            whole["curves"][k]["reference"] = said
            placed[id(result)] = lines
            refused += [f"{reference_path}: {said['error']}"] if said and "error" in said else []
    if as_json:
        print_json(whole)
    else:
        _print(found, placed)
    for sentence in [*(r.error for r in found.failed), *dict.fromkeys(refused)]:
        echo(f"skinlab: {sentence}", err=True)
    if found.stopped:
        count = sum(len(one.curves) if isinstance(one, Input) else 1 for one in taken)
        echo(f"skinlab: stopped after {len(found.results)} of {counted(count, 'curve')}", err=True)
        return INTERRUPTED
    if refused or any("outside_database" not in r.flags for r in found.failed):
        return 3
    if found.failed:
        return 5
    if strict and any(not_trustworthy(r) for r in found.all):
        echo("skinlab: a result is not trustworthy (its flags say why)", err=True)
        return 5
    return 0


@dataclass
class _Found:
    """What was found until now: Ctrl-C ends it at any place."""

    results: list[Identification] = field(default_factory=list)  # a curve or a file each
    together: Identification | None = None
    advice: list[Advice] | None = None
    stopped: bool = False

    @property
    def all(self) -> list[Identification]:
        """All answers, with that of all curves together."""
        return [*self.results, *([self.together] if self.together else [])]

    @property
    def failed(self) -> list[Identification]:
        """The answers that are none."""
        return [one for one in self.all if one.error is not None]

    @property
    def advised(self) -> Identification | None:
        """The answer that a next measurement would narrow."""
        return self.together or next((r for r in self.results if r.uncertainty), None)

    def fill(
        self, identifier: Identifier, taken: Sequence[Input | Identification], workers: int
    ) -> None:
        """Identify the curves of what was read, one after the other, in the order of the files."""
        from skinlab.inference.batch import identify_all
        from skinlab.recording.load_inputs import Input

        curves = [c for one in taken if isinstance(one, Input) for c in one.curves]
        answers = identify_all(identifier, curves, workers)
        for one in taken:
            for result in islice(answers, len(one.curves)) if isinstance(one, Input) else [one]:
                self.results.append(result)  # so that what is done stays where it is interrupted


def _geometry(
    inputs: Sequence[Path],
    aperture_mm: float | None,
    thickness_mm: float | None,
    thickness_sd_mm: float | None,
) -> Setup | None:
    """Return what CSVs were measured with; None where no CSV is given."""
    from skinlab.recording.load_inputs import import_advice

    csv_given = any(path.suffix.lower() == ".csv" for path in inputs)
    if not csv_given and (aperture_mm, thickness_mm, thickness_sd_mm) != (None, None, None):
        raise click.UsageError(
            "--aperture-mm, --thickness-mm and --thickness-sd-mm are for a curve CSV; sessions and "
            f"campaigns state their own{import_advice(inputs)}"
        )
    if aperture_mm is not None and thickness_mm is not None:
        from skinlab.curves.curve import Setup

        return Setup(aperture_mm, thickness_mm, thickness_sd_mm=thickness_sd_mm)
    if csv_given:
        raise click.UsageError("a curve CSV needs --aperture-mm and --thickness-mm")
    return None


def _taken(
    inputs: Sequence[Path],
    geometry: Setup | None,
    probe_path: Path | None,
    identifier: Identifier,
    database_path: Path | None,
    *,
    whole: bool,
) -> Iterator[Input | Identification]:
    """Yield what is in each file; of one that cannot be used an answer that says why.

    So it is of each curve of a campaign, unless `whole` ones are asked for.
    """
    from dataclasses import replace

    from skinlab.errors import InputError
    from skinlab.inference.result import Identification
    from skinlab.recording.load_inputs import read_input

    for path in inputs:
        unusable: list[Unusable] = []
        try:
            given = read_input(path, geometry, None if whole else unusable)
            tell_left_behind(path)
            read = replace(given, curves=read_by(given.curves, probe_path))
        except InputError as error:
            yield Identification(str(path), geometry, str(error))
            continue
        if given.model is not None and identifier.model_name is None:
            _tell_model(path, given.model, database_given=database_path is not None)
        if read.curves:
            yield read
        for one in unusable:
            yield Identification(one.file, None, one.error)


def _print(found: _Found, placed: Mapping[int, list[str]]) -> None:
    """Print the answers in words; `placed` has lines beside a reference, by the result's id."""
    from skinlab.report.text import describe, describe_advice

    for result in found.all:
        if result.error is None:
            echo_text(describe(result))
            for line in placed.get(id(result), []):
                echo(f"  {line}")
    if found.advice is not None:
        echo_text(describe_advice(found.advice))


def _beside(
    reference: Reference,
    result: Any,
    site: str,
    sex: str | None,
    age_years: float | None,
    whole: dict[str, Any],
) -> tuple[dict[str, Any] | None, list[str]]:
    """Return where a curve's values stand in a reference, as data and in lines."""
    from skinlab.errors import InputError
    from skinlab.studies.reference import place

    if not result.parameters or result.setup is None:
        return None, []
    program = result.setup.program
    try:
        found = place(
            reference,
            {name: value.value for name, value in result.parameters.items()},
            site=site,
            aperture_mm=result.setup.aperture_mm,
            program=None if program is None else str(program),
            sex=sex,
            age_years=age_years,
            model_hash=whole["model"]["hash"],
        )
    except InputError as error:
        return {"error": str(error)}, []
    lines = [f"{one.quantity} is {one.words} ({one.range.words}; {one.source})" for one in found]
    return {one.quantity: one.to_json() for one in found}, lines


def _tell_model(path: Path, own: StatedModel, *, database_given: bool) -> None:
    """Say that a session's own results are of a model, which these are not."""
    known = None if database_given else own.database
    option = "--model FILE" if known is None else f"--database {known}"
    echo(
        f"skinlab: {path}: its own results are of the model {own.name!r}, these are by the law "
        f"alone; {option} gives the others",
        err=True,
    )


def _check_together(read: list[Input]) -> None:
    """Say what has to be known of whose skin these are together, before anything is computed.

    Raises:
        InputError: one curve is there twice, they are of two people or two sites, or operators left
            out all of them.
    """
    from skinlab.curves.distinct import check_distinct
    from skinlab.curves.one_skin import check_one_skin
    from skinlab.errors import InputError
    from skinlab.recording.load_inputs import NONE_LEFT

    curves = [curve for given in read for curve in given.used]
    if not curves and any(given.left_out for given in read):
        raise InputError(f"--joint: {NONE_LEFT}")
    check_distinct(curves)
    for sentence in check_one_skin(curves):
        echo(f"skinlab: {sentence}", err=True)


def _first_cycles(identifier: Identifier, read: list[Input]) -> Sequence[Curve]:
    """Return the curves that are fitted together; says how many later cycles are left out."""
    from skinlab.inference.batch import fitted_together
    from skinlab.text import counted

    for sentence in (sentence for given in read for sentence in given.left_out_words):
        echo(f"skinlab: {sentence}", err=True)
    everything = [curve for given in read for curve in given.used]
    curves = fitted_together(identifier, everything)
    if len(curves) < len(everything):
        echo(
            f"skinlab: {counted(len(everything) - len(curves), 'curve')} of later cycles left out "
            "of the joint identification",
            err=True,
        )
    return curves


def _knowing_all(
    identifier: Identifier, read: list[Input], scatter: float | str | None
) -> Identifier:
    """Return the identifier with what all files state alike; says where they differ."""
    from skinlab.inference.batch import scatter_of, with_scatter, with_stated_noise

    sensor, differ = identifier.sensor, []
    common: dict[str, float | None] = {}
    for name, known in (
        ("noise_um", sensor.noise_um),
        ("pressure_noise_mbar", sensor.pressure_noise_mbar),
        ("placement_scatter", scatter),
    ):
        stated = [getattr(given, name) for given in read]
        same = len(set(stated)) == 1
        common[name] = stated[0] if same else None
        if not same and known is None:
            differ.append(name)
    if differ:
        echo(
            f"skinlab: the files do not all state the same {' and '.join(differ)}: learned from "
            "all curves together",
            err=True,
        )
    knowing = with_stated_noise(identifier, common["noise_um"], common["pressure_noise_mbar"])
    return with_scatter(knowing, scatter_of(scatter, common["placement_scatter"]))


def _thickness_mm(source: Identification, read: list[Input]) -> float:
    """Return the skin's thickness where the answer is from; of curves together the first one's."""
    setup = read[0].curves[0].setup if source.setup is None else source.setup
    return setup.thickness_mm
