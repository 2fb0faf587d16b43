"""`python -m sim_device.cohort`: the curves of many people, with known components of variance.

People, sites, visits, operators, probes, placements and single curves each shift the skin, or the
sensor, by an amount drawn from a normal distribution whose standard deviation COHORT.toml states.
The true values go beside the folder of curves, never into it.
"""

from __future__ import annotations

import csv
import math
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

import click
import msgspec
import numpy as np
from msgspec import Meta, field
from numpy.typing import NDArray

from sim_device.files import SensorSection, SkinSection, load_toml

if TYPE_CHECKING:
    from sim_device.skin import Domes

Array = NDArray[np.float64]

EXIT_BAD_INPUT = 3
_MOST_DRAWS = 200  # of one person, until the skin can be computed
_NU = (0.05, 0.49)
_SOFTEST = 4.0  # standard deviations of stiffness below a site's own, to which it is solved

Count = Annotated[int, Meta(ge=1, le=100_000)]
Spread = Annotated[float, Meta(ge=0, le=10)]


class Shifts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Standard deviations of what one level adds.

    `X1`, `X2` and `thickness` in the logarithm; `stiffness` in the logarithm of both X1 and X2;
    `gain` in the logarithm of the deflection as read.
    """

    X1: Spread = 0.0
    X2: Spread = 0.0
    nu: Annotated[float, Meta(ge=0, le=0.2)] = 0.0
    stiffness: Spread = 0.0
    thickness: Spread = 0.0
    gain: Spread = 0.0
    offset_um: Annotated[float, Meta(ge=0, le=1000)] = 0.0


class Size(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How many of each, and how they are measured."""

    people: Count = 20
    sites: tuple[str, ...] = ("forearm_left", "forearm_right")
    visits: Count = 2
    placements: Count = 2
    cycles: Count = 1
    operators: Count = 2
    probes: Count = 2
    aperture_mm: float = 6.0
    program: str = "ramp:100@20"
    age_years: tuple[float, float] = (20.0, 80.0)


class Age(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What ten years add: to log X1, log X2 and ν."""

    X1_per_decade: float = 0.0
    X2_per_decade: float = 0.0
    nu_per_decade: float = 0.0


class CohortFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole COHORT.toml; everything has a default. `skin` is the mean person's."""

    cohort: Size = field(default_factory=Size)
    skin: SkinSection = field(
        default_factory=lambda: SkinSection(X1_MPa=0.03, X2_MPa=1.5, nu=0.32, thickness_mm=1.2)
    )
    subject: Shifts = field(default_factory=lambda: Shifts(X1=0.2, X2=0.25, nu=0.02))
    site: Shifts = field(default_factory=Shifts)  # of a site, common to all people
    subject_site: Shifts = field(default_factory=lambda: Shifts(stiffness=0.1))
    visit: Shifts = field(default_factory=lambda: Shifts(stiffness=0.06))
    operator: Shifts = field(default_factory=lambda: Shifts(stiffness=0.03))
    probe: Shifts = field(default_factory=lambda: Shifts(gain=0.02))
    placement: Shifts = field(default_factory=lambda: Shifts(stiffness=0.06, offset_um=3.0))
    curve: Shifts = field(default_factory=Shifts)
    age: Age = field(default_factory=Age)
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    sensor: SensorSection = field(default_factory=SensorSection)

    def __post_init__(self) -> None:
        """Refuse what cannot be measured."""
        if self.skin.law is not None:
            raise ValueError("skin.law: a cohort has the paper's; expected X1_MPa, X2_MPa and nu")
        if not self.cohort.sites or len(set(self.cohort.sites)) < len(self.cohort.sites):
            raise ValueError("cohort.sites must name at least one site, each once")
        for site in self.cohort.sites:
            if not site.isidentifier():
                raise ValueError(f"cohort.sites: {site!r} must be letters, digits and _")


@dataclass(frozen=True)
class Shift:
    """What was drawn for one level: one value a field of `Shifts`."""

    X1: float = 0.0
    X2: float = 0.0
    nu: float = 0.0
    stiffness: float = 0.0
    thickness: float = 0.0
    gain: float = 0.0
    offset_um: float = 0.0

    def __add__(self, other: Shift) -> Shift:
        return Shift(*(getattr(self, n) + getattr(other, n) for n in Shifts.__struct_fields__))


@dataclass(frozen=True)
class Measured:
    """One curve: where it belongs to, the true skin, and the samples."""

    file: str
    labels: Mapping[str, str | int | float]
    true: Mapping[str, float]
    time_s: Array
    pressure_mbar: Array
    deflection_mm: Array


@dataclass(frozen=True)
class Person:
    """One of the people."""

    name: str
    age_years: float
    sex: Literal["f", "m"]
    shift: Shift


class Cohort:
    """Draws people and measures them; the same file and seed give the same bits."""

    def __init__(self, spec: CohortFile, seed: int) -> None:
        from sim_device.skin import Domes, load_of, program_duration_s

        self._spec, self._seed = spec, seed
        size = spec.cohort
        load = load_of(size.program, spec.sensor.rate_hz)
        self._domes: Domes = Domes(spec.effects, size.aperture_mm, load)
        steps = math.floor(program_duration_s(size.program) * spec.sensor.rate_hz + 1e-9)
        self._time_s = np.arange(steps + 1) / spec.sensor.rate_hz
        self.people = [self._person(k) for k in range(size.people)]
        self._sites = self._level("site", spec.site, len(size.sites))
        self._operators = self._level("operator", spec.operator, size.operators)
        self._probes = self._level("probe", spec.probe, size.probes)

    def curves(self) -> Iterator[Measured]:
        """Yield every curve, person by person.

        Raises:
            ValueError: the finite elements do not hold for the cohort's skins.
        """
        for number in range(len(self.people)):
            yield from self._curves_of(number)

    def _curves_of(self, number: int) -> list[Measured]:
        """Return one person's curves; a person whose skin cannot be computed is drawn again."""
        problem = ""
        for attempt in range(_MOST_DRAWS):
            if attempt:
                self.people[number] = self._person(number, attempt)
            try:
                return list(self._measured(number, attempt))
            except ValueError as error:
                problem = str(error)
        raise ValueError(f"no skin near the cohort's mean can be computed: {problem}")

    def _measured(self, number: int, attempt: int) -> Iterator[Measured]:
        spec, size, person = self._spec, self._spec.cohort, self.people[number]
        rng = np.random.default_rng([self._seed, 1, number, attempt])
        visits = [_draw(spec.visit, rng) for _ in range(size.visits)]
        for s, site in enumerate(size.sites):
            at_site = person.shift + self._sites[s] + _draw(spec.subject_site, rng)
            softest = self._softest_mpa(at_site)
            for v in range(size.visits):
                for p in range(size.placements):
                    who = (p + v + number) % size.operators
                    probe = (p // size.operators + v + s + number) % size.probes
                    placed = (
                        at_site
                        + visits[v]
                        + self._operators[who]
                        + self._probes[probe]
                        + _draw(spec.placement, rng)
                    )
                    for c in range(size.cycles):
                        shift = placed + _draw(spec.curve, rng)
                        labels: dict[str, str | int | float] = {
                            "subject": person.name,
                            "site": site,
                            "visit": v + 1,
                            "operator": f"op{who + 1}",
                            "probe": f"probe{probe + 1}",
                            "placement": p + 1,
                            "cycle": c + 1,
                        }
                        file = f"{person.name}/{site}/v{v + 1}_p{p + 1}_c{c + 1}.csv"
                        yield self._measure(file, labels, shift, c + 1, softest, rng)

    def _measure(
        self,
        file: str,
        labels: Mapping[str, str | int | float],
        shift: Shift,
        cycle: int,
        softest_MPa: float,
        rng: np.random.Generator,
    ) -> Measured:
        skin = self._skin(shift)
        pressure, deflection = self._domes.curve(skin, self._time_s, cycle, softest_MPa)
        sensor, n = self._spec.sensor, len(self._time_s)
        read_um = 1e3 * deflection * math.exp(shift.gain) + shift.offset_um
        read_um = read_um + sensor.noise_um * rng.standard_normal(n)
        pressure = pressure + sensor.pressure_noise_mbar * rng.standard_normal(n)
        true = {
            "X1_MPa": skin.X1_MPa,
            "X2_MPa": skin.X2_MPa,
            "nu": skin.nu,
            "gain": math.exp(shift.gain),
            "offset_um": shift.offset_um,
        }
        return Measured(
            file,
            {**labels, "thickness_mm": skin.thickness_mm},
            true,
            self._time_s,
            _quantised(pressure, sensor.pressure_resolution_mbar),
            _quantised(read_um, sensor.resolution_um) / 1e3,
        )

    def _skin(self, shift: Shift) -> SkinSection:
        mean = self._spec.skin
        nu = mean.nu + shift.nu
        if not _NU[0] <= nu <= _NU[1]:
            raise ValueError(f"nu {nu:g} is not a skin's")
        return SkinSection(
            X1_MPa=mean.X1_MPa * math.exp(shift.X1 + shift.stiffness),
            X2_MPa=mean.X2_MPa * math.exp(shift.X2 + shift.stiffness),
            nu=nu,
            kappa=mean.kappa,
            thickness_mm=round(mean.thickness_mm * math.exp(shift.thickness), 3),
        )

    def _softest_mpa(self, at_site: Shift) -> float:
        """Return the least X1 that placing the probe anew is likely to make of a site."""
        spec = self._spec
        levels = (spec.visit, spec.operator, spec.probe, spec.placement, spec.curve)
        spread = math.sqrt(sum(one.stiffness**2 for one in levels))
        return self._skin(at_site).X1_MPa * math.exp(-_SOFTEST * spread)

    def _person(self, number: int, attempt: int = 0) -> Person:
        spec, size = self._spec, self._spec.cohort
        rng = np.random.default_rng([self._seed, 0, number, attempt])
        age = round(float(rng.uniform(*size.age_years)), 1)
        decades = (age - sum(size.age_years) / 2) / 10
        by_age = Shift(
            X1=spec.age.X1_per_decade * decades,
            X2=spec.age.X2_per_decade * decades,
            nu=spec.age.nu_per_decade * decades,
        )
        sex: Literal["f", "m"] = "f" if rng.random() < 0.5 else "m"
        return Person(f"P{number + 1:03d}", age, sex, by_age + _draw(spec.subject, rng))

    def _level(self, name: str, shifts: Shifts, count: int) -> list[Shift]:
        rng = np.random.default_rng([self._seed, 2, *name.encode()])
        return [_draw(shifts, rng) for _ in range(count)]


def _draw(shifts: Shifts, rng: np.random.Generator) -> Shift:
    values = rng.standard_normal(len(Shifts.__struct_fields__))
    return Shift(
        *(
            float(getattr(shifts, name) * value)
            for name, value in zip(Shifts.__struct_fields__, values, strict=True)
        )
    )


def _quantised(values: Array, resolution: float) -> Array:
    return np.round(values / resolution) * resolution if resolution > 0 else values


# ---- files ----------------------------------------------------------------------------------

_LABELS = ("subject", "site", "visit", "operator", "probe", "placement", "cycle")
_BROKEN = {
    "empty": "",
    "text": "this is no curve\n",
    "column": "time_s,pressure_mbar\n0,0\n",
    "value": "time_s,pressure_mbar,deflection_mm\n0,0,0\n0.05,1,what\n",
    "backward": "time_s,pressure_mbar,deflection_mm\n"
    + "".join(f"{t},1,0.1\n" for t in (0, 1, 2, 1, 3, 4)),
    "short": "time_s,pressure_mbar,deflection_mm\n0,0,0\n0.05,1,0.01\n",
}


def write_cohort(spec: CohortFile, folder: Path, seed: int, broken: int = 0) -> int:
    """Write the curves into a new folder, the true values beside it; return how many curves.

    Raises:
        ValueError: something is there already, cannot be written, or cannot be computed.
    """
    truth = folder.with_name(f"{folder.name}.truth.csv")
    for path in (folder, truth):
        if path.exists():
            raise ValueError(f"{path}: exists already; expected a new name")
    cohort = Cohort(spec, seed)
    size, count = spec.cohort, 0
    try:
        folder.mkdir(parents=True)
        with (
            (folder / "curves.csv").open("w", encoding="utf-8", newline="") as listed,
            truth.open("w", encoding="utf-8", newline="") as known,
        ):
            rows = csv.writer(listed, lineterminator="\n")
            rows.writerow(("file", *_LABELS, "aperture_mm", "thickness_mm", "program"))
            true = csv.writer(known, lineterminator="\n")
            for curve in cohort.curves():
                path = folder / curve.file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(_text(curve), encoding="utf-8")
                labels = [curve.labels[name] for name in _LABELS]
                thickness = curve.labels["thickness_mm"]
                rows.writerow((curve.file, *labels, size.aperture_mm, thickness, size.program))
                if not count:
                    true.writerow(("file", *_LABELS, *curve.true))
                true.writerow((curve.file, *labels, *(f"{v:.9g}" for v in curve.true.values())))
                count += 1
            for k in range(broken):
                kind = list(_BROKEN)[k % len(_BROKEN)]
                name = f"broken/{kind}_{k + 1}.csv"
                (folder / "broken").mkdir(exist_ok=True)
                (folder / name).write_text(_BROKEN[kind], encoding="utf-8")
                blank = ("P001", size.sites[0], 1, "op1", "probe1", 1, 1)
                thickness = spec.skin.thickness_mm
                rows.writerow((name, *blank, size.aperture_mm, thickness, size.program))
        with (folder / "subjects.csv").open("w", encoding="utf-8", newline="") as stream:
            people = csv.writer(stream, lineterminator="\n")
            people.writerow(("subject", "age_years", "sex"))
            people.writerows((p.name, p.age_years, p.sex) for p in cohort.people)
    except OSError as error:
        raise ValueError(f"{folder}: cannot be written ({error.strerror or error})") from None
    return count


def _text(curve: Measured) -> str:
    rows = zip(
        curve.time_s.tolist(),
        curve.pressure_mbar.tolist(),
        curve.deflection_mm.tolist(),
        strict=True,
    )
    lines = [f"{t:.9g},{p:.9g},{w:.9g}\n" for t, p, w in rows]
    return "time_s,pressure_mbar,deflection_mm\n" + "".join(lines)


@click.command(epilog="Example: python -m sim_device.cohort COHORT.toml --out cohort --seed 1")
@click.argument("spec", required=False, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="A new folder.")
@click.option("--people", type=click.IntRange(1, 100_000), help="Instead of the file's number.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0), help="Of all draws.")
@click.option(
    "--broken", default=0, type=click.IntRange(0, 100_000), help="So many files that are no curves."
)
def main(spec: Path | None, out: Path, people: int | None, seed: int, broken: int) -> None:
    """Write the curves of a simulated cohort as SPEC, a COHORT.toml, describes it.

    The folder can be given to `skinlab study`: curves.csv says whose curve each is, subjects.csv
    age and sex. OUT.truth.csv, beside it, has the true values.
    """
    try:
        file = CohortFile() if spec is None else load_toml(spec, CohortFile)
        if people is not None:
            file = msgspec.structs.replace(
                file, cohort=msgspec.structs.replace(file.cohort, people=people)
            )
        count = write_cohort(file, out, seed, broken)
    except ValueError as error:
        _fail(str(error))
    click.echo(f"{out}: {count} curves of {file.cohort.people} people")


def _fail(message: str) -> NoReturn:
    click.echo(f"sim_device: {message}", err=True)
    raise SystemExit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main(prog_name="python -m sim_device.cohort"))
