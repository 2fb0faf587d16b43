"""What a user may name as input: a curve CSV, a session, a campaign."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from skinlab.campaign import read_campaign
from skinlab.curve import Curve, Setup
from skinlab.curve_csv import read_curve
from skinlab.errors import InputError


def read_input(path: Path, setup: Setup | None) -> list[Curve]:
    """Return the curves of one input; `setup` is what a CSV was measured with.

    Raises:
        InputError: the file cannot be read, or is none of these.
    """
    if path.is_dir():
        path = path / "campaign.toml"
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix == ".csv":
        if setup is None:
            raise InputError(f"{path}: a curve CSV needs its aperture and thickness")
        return [read_curve(path, setup)]
    if suffix == ".toml":
        return list(read_campaign(path).curves)
    if suffix in (".h5", ".hdf5"):
        from skinlab.session import read_session

        return [replace(curve, name=f"{path}:{curve.name}") for curve in read_session(path).curves]
    raise InputError(f"{path}: expected a curve (.csv), a session (.h5) or a campaign (.toml)")
