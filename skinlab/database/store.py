"""Databases as HDF5 files; docs/files.md describes them field by field."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from skinlab.database.grid import GridDatabase, GridSpec
from skinlab.errors import InputError
from skinlab.fem.suction import Geometry

SCHEMA = "skinlab.database/1"


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """Open an HDF5 file for reading.

    Raises:
        InputError: no such file, no HDF5, cut off, or a field is missing.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except PermissionError:
        raise InputError(f"{path}: no permission to read it") from None
    except OSError as error:
        what = "truncated" if "truncated" in str(error) else "not readable"
        raise InputError(f"{path}: {what} as HDF5; expected a file that skinlab wrote") from None
    except (KeyError, RuntimeError) as error:
        raise InputError(f"{path}: a field is missing or damaged ({error})") from None


def write_grid(path: Path, database: GridDatabase) -> None:
    """Write the database; the file appears whole or not at all."""
    import h5py

    spec = database.spec
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with h5py.File(partial, "w", track_order=True) as file:
            file.attrs["schema"] = SCHEMA
            file.attrs["kind"] = "grid"
            file.attrs["law"] = spec.law
            file.attrs["kappa"] = spec.kappa
            file.attrs["aperture_mm"] = spec.geometry.aperture_mm
            file.attrs["thickness_mm"] = spec.geometry.thickness_mm
            file.attrs["mesh"] = database.mesh_name
            file.attrs["degrees_of_freedom"] = database.dofs
            file.attrs["solver_version"] = database.solver_version
            file.attrs["content_hash"] = database.content_hash
            for name, unit in (("X1_MPa", "MPa"), ("X2_MPa", "MPa"), ("nu", "1")):
                axis = file.create_dataset(f"axes/{name}", data=np.array(getattr(spec, name)))
                axis.attrs["unit"] = unit
            axis = file.create_dataset("axes/pressure_mbar", data=np.array(spec.pressure_mbar))
            axis.attrs["unit"] = "mbar"
            data = file.create_dataset(
                "deflection_mm",
                data=database.deflection_mm,
                compression="gzip",
                compression_opts=9,
                shuffle=True,
            )
            data.attrs["unit"] = "mm"
            data.attrs["axes"] = "X1_MPa, X2_MPa, nu, pressure_mbar"
            holds = file.create_dataset("holds_to_mbar", data=database.holds_to_mbar)
            holds.attrs["unit"] = "mbar"
            file.create_dataset("newton_iterations", data=database.iterations)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def read_grid(path: Path) -> GridDatabase:
    """Return the database in this file.

    Raises:
        InputError: the file is no database of this version, or its content hash does not agree.
    """
    with open_hdf5(path) as file:
        schema = file.attrs.get("schema")
        if schema != SCHEMA or file.attrs.get("kind") != "grid":
            raise InputError(f"{path}: schema {schema!r}; expected a database, {SCHEMA!r}")
        axes = {name: tuple(map(float, file[f"axes/{name}"][:])) for name in _AXES}
        spec = GridSpec(
            law=str(file.attrs["law"]),
            kappa="consistent" if file.attrs["kappa"] == "consistent" else "paper",
            geometry=Geometry(float(file.attrs["aperture_mm"]), float(file.attrs["thickness_mm"])),
            **axes,
        )
        database = GridDatabase(
            spec,
            file["deflection_mm"][:],
            file["holds_to_mbar"][:],
            file["newton_iterations"][:],
            str(file.attrs["mesh"]),
            str(file.attrs["solver_version"]),
            int(file.attrs["degrees_of_freedom"]),
        )
        stated = str(file.attrs["content_hash"])
    if database.content_hash != stated:
        raise InputError(f"{path}: its content does not agree with its hash; it is damaged")
    return database


_AXES = ("X1_MPa", "X2_MPa", "nu", "pressure_mbar")


def shipped_grid() -> GridDatabase:
    """Return the paper's grid that ships inside the package."""
    with as_file(files("skinlab") / "data" / "paper_grid.h5") as path:
        return read_grid(path)
