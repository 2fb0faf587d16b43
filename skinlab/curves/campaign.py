"""A campaign: curves that are explained together, described by a TOML file beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import msgspec

from drivers.reading import read_whole
from skinlab.curves.csv import read_curve
from skinlab.curves.curve import Curve, Setup, named_placement
from skinlab.curves.program import parse_program
from skinlab.curves.program_check import check_program
from skinlab.errors import InputError
from skinlab.io.documents import decode, read_toml
from skinlab.io.files import named_in_errors, real_path
from skinlab.plugins import warn

_STATED: Mapping[str, tuple[str, Callable[[float], bool]]] = {
    # No dome is higher than the widest opening, and no command goes beyond 500 mbar.
    "noise_um": ("more than 0 and less than 8000", lambda um: 0 < um < 8e3),
    "pressure_noise_mbar": ("0 or more and less than 500", lambda mbar: 0 <= mbar < 500),
    "placement_scatter": ("0 to below 1", lambda share: 0 <= share < 1),
}


def range_missed(name: str, value: float | None) -> str | None:
    """Return the range, in words, of what is stated by this name, if the value is out of it.

    Names are `noise_um`, `pressure_noise_mbar` and `placement_scatter`; None is always allowed.
    """
    words, holds = _STATED[name]
    return None if value is None or holds(value) else words


class _Header(msgspec.Struct, forbid_unknown_fields=True):
    title: str = ""
    noise_um: float | None = None
    pressure_noise_mbar: float | None = None
    placement_scatter: Literal["auto"] | float = "auto"


class _CurveEntry(msgspec.Struct, forbid_unknown_fields=True):
    file: str
    aperture_mm: float
    thickness_mm: float
    thickness_sd_mm: float | None = None
    program: str | None = None
    cycle: int = 1
    repeat: int = 1
    placement: str | None = None


class _File(msgspec.Struct, forbid_unknown_fields=True):
    campaign: _Header
    curve: list[_CurveEntry]


@dataclass(frozen=True, eq=False)
class Campaign:
    """Curves with their setups, and the stated noise (None: to be estimated)."""

    title: str
    noise_um: float | None
    pressure_noise_mbar: float | None
    curves: tuple[Curve, ...]
    placement_scatter: float | None = None  # None: to be learned


@dataclass(frozen=True)
class Unusable:
    """A curve of a campaign that cannot be read; the sentence names it."""

    file: str
    error: str


def read_campaign(path: Path, unusable: list[Unusable] | None = None) -> Campaign:
    """Return the campaign of this TOML file, its curves read.

    A list of the `unusable` takes the curves that are wrong; without one the first ends it.

    Raises:
        InputError: the file or one of its curves is wrong; names file and field or line. A curve
            outside the campaign's folder is refused, and one that was measured by another program.
    """
    with named_in_errors(path):
        data = decode(read_toml(read_whole(path)), _File)
    if not data.curve:
        raise InputError(f"{path}: no [[curve]]; expected at least one")
    stated = data.campaign
    noise, pressure_noise = stated.noise_um, stated.pressure_noise_mbar
    auto = stated.placement_scatter == "auto"
    scatter = None if auto else float(stated.placement_scatter)
    for name, value, besides in (
        ("noise_um", noise, ""),
        ("pressure_noise_mbar", pressure_noise, ""),
        ("placement_scatter", scatter, "auto or "),
    ):
        if (words := range_missed(name, value)) is not None:
            raise InputError(f"{path}: campaign.{name} is {value}, expected {besides}{words}")
    folder = real_path(path.parent)
    curves = []
    for number, entry in enumerate(data.curve, start=1):
        file = path.parent / entry.file
        try:
            curve = read_curve(file, _setup(folder, entry, f"{path}: curve {number}"))
            known = replace(
                curve, campaign=str(folder), noise_um=noise, pressure_noise_mbar=pressure_noise
            )
            curves.append(check_program(known))
        except InputError as error:
            if unusable is None:
                raise
            unusable.append(Unusable(str(file), str(error)))
    _ask_about_labels(path, [one for one in data.curve if named_placement(one.placement)])
    return Campaign(stated.title, noise, pressure_noise, tuple(curves), scatter)


def _setup(folder: Path, entry: _CurveEntry, where: str) -> Setup:
    """Return what a curve was measured with, once its file is known to be in the folder.

    Raises:
        InputError: it is not, or a field is wrong; begins with `where`.
    """
    if "\0" in entry.file:
        raise InputError(f"{where}: file {entry.file!r} is not a file name")
    if not real_path(folder / entry.file).is_relative_to(folder):
        raise InputError(f"{where}: file {entry.file!r} is outside the folder")
    if (folder / entry.file).is_dir():
        raise InputError(f"{where}: file {entry.file!r} is a folder; expected a curve CSV")
    with named_in_errors(where):
        return Setup(
            aperture_mm=entry.aperture_mm,
            thickness_mm=entry.thickness_mm,
            program=None if entry.program is None else parse_program(entry.program),
            cycle=entry.cycle,
            repeat=entry.repeat,
            thickness_sd_mm=entry.thickness_sd_mm,
            placement=named_placement(entry.placement),
        )


def _ask_about_labels(path: Path, labelled: Iterable[_CurveEntry]) -> None:
    """Warn of labels of placements that cannot be meant so: they count as they are written."""
    openings: dict[str, dict[float, list[str]]] = {}
    for entry in labelled:
        files = openings.setdefault(str(entry.placement), {}).setdefault(entry.aperture_mm, [])
        files.append(entry.file)
    alike: dict[str, list[str]] = {}
    for label in openings:
        alike.setdefault(label.strip().casefold(), []).append(label)
    for written in alike.values():
        if len(written) > 1:
            names = " and ".join(repr(label) for label in written)
            warn(
                f"{path}: placements {names} are counted as {len(written)}; write them alike where "
                "they are one"
            )
    for label, of in openings.items():
        if len(of) > 1:
            each = " and ".join(f"{mm:g} mm ({', '.join(files)})" for mm, files in of.items())
            warn(
                f"{path}: placement {label!r} is counted as one, through openings of {each}; a "
                "probe that is put on once has one: give each a label of its own"
            )
