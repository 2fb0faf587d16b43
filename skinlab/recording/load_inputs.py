"""What a user may name as input: a curve CSV, a session, a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os.path import exists, isdir, isfile  # Path's own raise where one may not look
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.curves.campaign import Campaign, Unusable, read_campaign
from skinlab.curves.csv import IMPORT, read_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.distinct import check_distinct
from skinlab.errors import InputError
from skinlab.io.files import cannot_read, file_hash, real_path
from skinlab.plugins import warn
from skinlab.recording.session_names import SESSIONS, is_session_name

if TYPE_CHECKING:
    from skinlab.recording.session import StatedModel

NONE_LEFT = "all its curves were left out by who measured them; expected one at least"


@dataclass(frozen=True, eq=False)
class Input:
    """The curves of one file, and what it states: the sensors' noise, the model of its results."""

    curves: tuple[Curve, ...]
    noise_um: float | None = None
    pressure_noise_mbar: float | None = None
    placement_scatter: float | None = None  # None: to be learned
    model: StatedModel | None = None  # None: of the law alone, or there are no results
    left_out: Mapping[str, str] = field(default_factory=dict)  # why, by the name of the curve

    @property
    def used(self) -> tuple[Curve, ...]:
        """The curves that answer together."""
        return tuple(curve for curve in self.curves if curve.name not in self.left_out)

    @property
    def left_out_words(self) -> list[str]:
        """Which curves do not answer together, a sentence each."""
        return [f"{name} is left out: {why}" for name, why in self.left_out.items()]


def read_input(path: Path, setup: Setup | None, unusable: list[Unusable] | None = None) -> Input:
    """Return one input; `setup` is what a CSV was measured with.

    A list of the `unusable` takes a campaign's curves that are wrong: as `read_campaign` says.

    Raises:
        InputError: the file cannot be read, or is none of these.
    """
    path = _file_of(path)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        if setup is None:
            raise InputError(f"{path}: a curve CSV needs its aperture and thickness")
        return Input((read_curve(path, setup),))
    if suffix == ".toml":
        campaign = read_campaign(path, unusable)
        noise = campaign.noise_um, campaign.pressure_noise_mbar
        return Input(campaign.curves, *noise, campaign.placement_scatter)
    if is_session_name(path):
        from skinlab.recording.session import read_session, stated_model, stated_noise
        from skinlab.recording.session_fit import left_out_of

        session = read_session(path)
        named = tuple(
            replace(curve, name=f"{path}:{curve.name}", campaign=str(path))
            for curve in session.curves
        )
        noise = stated_noise(session.meta)
        left_out = {f"{path}:{name}": why for name, why in left_out_of(session).items()}
        return Input(named, *noise, model=stated_model(session.meta), left_out=left_out)
    raise InputError(
        f"{path}: expected a curve (.csv), a session (.h5) or a campaign (.toml); {IMPORT}"
    )


def _file_of(path: Path) -> Path:
    """Return the file that is meant: of a folder its campaign.

    Raises:
        InputError: there is no such file, or it cannot be looked at; or the folder has no campaign:
            says who takes a folder of curves.
    """
    with cannot_read(path):
        folder = path.is_dir()
        file = path / "campaign.toml" if folder else path
        there = file.exists()
    if not there and not folder:
        raise InputError(f"{path}: no such file")
    if not there:
        raise InputError(
            f"{path}: a folder without a campaign.toml, which names its curves; `skinlab study` "
            "reads any folder of curves"
        )
    return file


def import_advice(paths: Sequence[Path]) -> str:
    """Return what to do with the first of these that is no input, but could be; "" for none."""
    bare = next((p for p in paths if isdir(p) and not exists(p / "campaign.toml")), None)
    if bare is not None:
        return f"; {bare} is a folder without a campaign.toml: name its curves one by one"
    ours = {".csv", ".toml", *SESSIONS}
    foreign = (p for p in paths if p.suffix.lower() not in ours and isfile(p))
    first = next(foreign, None)
    return "" if first is None else f"; {first} is none of these: {IMPORT}"


def read_campaign_or_session(path: Path) -> tuple[Campaign, dict[str, str]]:
    """Return the curves that are explained together, and the hash of each file they are from.

    Files are called as the campaign calls them: those of two folders may have one name. What does
    not count of a session (`left_out_of`) is told.

    Raises:
        InputError: the file cannot be read, is neither, has a curve twice, or none that counts.
    """
    path = _file_of(path)
    suffix = path.suffix.lower()
    if suffix == ".toml":
        campaign = read_campaign(path)
        named = tuple(replace(c, name=_within(path.parent, Path(c.name))) for c in campaign.curves)
        check_distinct(named)
        hashes = {path.name: file_hash(path)} | {c.name: c.source for c in named if c.source}
        return replace(campaign, curves=named), hashes
    if is_session_name(path):
        given = read_input(path, None)
        check_distinct(given.curves)
        for sentence in given.left_out_words:
            warn(sentence)
        if given.left_out and not given.used:
            raise InputError(f"{path}: {NONE_LEFT}")
        noise = given.noise_um, given.pressure_noise_mbar
        return Campaign(path.stem, *noise, given.used), {path.name: file_hash(path)}
    raise InputError(f"{path}: expected a campaign (.toml) or a session (.h5)")


def _within(folder: Path, file: Path) -> str:
    """Return how a campaign's folder calls one of its files, also where it states a whole path."""
    if file.is_relative_to(folder):
        return str(file.relative_to(folder))
    return str(real_path(file).relative_to(real_path(folder)))
