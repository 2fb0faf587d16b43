"""Databases as HDF5 files; docs/files.md describes them field by field."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from skinlab.database.dimensionless import Axis, DimensionlessSpec, DimensionlessTable
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


@contextmanager
def _written_whole(path: Path) -> Iterator[Any]:
    """Open a new HDF5 file for writing; it takes its name once it is whole.

    Raises:
        InputError: it cannot be written.
    """
    import h5py

    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with h5py.File(partial, "w", track_order=True) as file:
            yield file
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def write_grid(path: Path, database: GridDatabase) -> None:
    """Write the grid; the file appears whole or not at all."""
    spec = database.spec
    with _written_whole(path) as file:
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
        for name, unit in zip(_AXES, ("MPa", "MPa", "1", "mbar"), strict=True):
            axis = file.create_dataset(f"axes/{name}", data=np.array(getattr(spec, name)))
            axis.attrs["unit"] = unit
        data = file.create_dataset(
            "deflection_mm",
            data=database.deflection_mm,
            compression="gzip",
            compression_opts=9,
            shuffle=True,
        )
        data.attrs["unit"] = "mm"
        data.attrs["axes"] = ", ".join(_AXES)
        holds = file.create_dataset("holds_to_mbar", data=database.holds_to_mbar)
        holds.attrs["unit"] = "mbar"
        file.create_dataset("newton_iterations", data=database.iterations)


def read_grid(path: Path) -> GridDatabase:
    """Return the database in this file.

    Raises:
        InputError: the file is no database of this version, or its content hash does not agree.
    """
    with open_hdf5(path) as file:
        _check_kind(path, file, "grid")
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
    _check_hash(path, database.content_hash, stated)
    return database


_AXES = ("X1_MPa", "X2_MPa", "nu", "pressure_mbar")


def write_table(path: Path, table: DimensionlessTable) -> None:
    """Write the table; the file appears whole or not at all."""
    spec = table.spec
    with _written_whole(path) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["kind"] = "dimensionless"
        file.attrs["law"] = spec.law
        file.attrs["mesh"] = table.mesh_name
        file.attrs["solver_version"] = table.solver_version
        file.attrs["content_hash"] = table.content_hash
        file.attrs["X1_MPa"] = spec.X1_MPa
        file.attrs["pressure_mbar"] = spec.pressure_mbar
        file.attrs["load_nodes"] = spec.load_nodes
        file.attrs["load_scale"] = spec.load_scale
        file.attrs["least_load"] = spec.least_load
        for name in _RATIOS:
            axis: Axis = getattr(spec, name)
            file.attrs[name] = (axis.low, axis.high, axis.nodes)
        # Not compressed: it must load at once, and it is small.
        data = file.create_dataset("log_compliance", data=table.log_compliance)
        data.attrs["axes"] = "thickness_over_radius, X2_over_X1, kappa_over_X1, load"
        data.attrs["unit"] = "1"
        holds = file.create_dataset("holds_to_load", data=table.holds_to_load)
        holds.attrs["unit"] = "1"


_RATIOS = ("thickness_over_radius", "X2_over_X1", "kappa_over_X1")


def read_table(path: Path) -> DimensionlessTable:
    """Return the dimensionless table in this file.

    Raises:
        InputError: the file is no table of this version, or its content hash does not agree.
    """
    with open_hdf5(path) as file:
        _check_kind(path, file, "dimensionless")
        attrs = file.attrs
        axes = {
            name: Axis(float(attrs[name][0]), float(attrs[name][1]), int(attrs[name][2]))
            for name in _RATIOS
        }
        spec = DimensionlessSpec(
            law=str(attrs["law"]),
            X1_MPa=(float(attrs["X1_MPa"][0]), float(attrs["X1_MPa"][1])),
            pressure_mbar=float(attrs["pressure_mbar"]),
            load_nodes=int(attrs["load_nodes"]),
            load_scale=float(attrs["load_scale"]),
            least_load=float(attrs["least_load"]),
            **axes,
        )
        table = DimensionlessTable(
            spec,
            file["log_compliance"][:],
            file["holds_to_load"][:],
            str(attrs["mesh"]),
            str(attrs["solver_version"]),
        )
        stated = str(attrs["content_hash"])
    _check_hash(path, table.content_hash, stated)
    return table


def read_database(path: Path) -> GridDatabase | DimensionlessTable:
    """Return the database in this file, of whichever kind.

    Raises:
        InputError: the file is no database of this version, or its content hash does not agree.
    """
    with open_hdf5(path) as file:
        kind = file.attrs.get("kind")
    return read_table(path) if kind == "dimensionless" else read_grid(path)


def _check_kind(path: Path, file: Any, kind: str) -> None:
    schema = file.attrs.get("schema")
    if schema != SCHEMA or file.attrs.get("kind") != kind:
        raise InputError(f"{path}: schema {schema!r}; expected a {kind} database, {SCHEMA!r}")


def _check_hash(path: Path, computed: str, stated: str) -> None:
    if computed != stated:
        raise InputError(f"{path}: its content does not agree with its hash; it is damaged")


@cache
def shipped_grid() -> GridDatabase:
    """Return the paper's grid that ships inside the package."""
    with as_file(files("skinlab") / "data" / "paper_grid.h5") as path:
        return read_grid(path)


@cache
def shipped_table() -> DimensionlessTable:
    """Return the dimensionless table that ships inside the package."""
    with as_file(files("skinlab") / "data" / "dimensionless.h5") as path:
        return read_table(path)
