"""Databases as HDF5 files; docs/files.md describes them field by field."""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from skinlab.io.hdf5 import open_hdf5, read_array, written_whole
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.dimensionless import Axis, DimensionlessSpec, DimensionlessTable
from skinlab.tables.grid import GridDatabase, GridSpec
from skinlab.tables.header import SCHEMA, check_hash, check_kind
from skinlab.tables.model_database import ModelDatabase
from skinlab.tables.model_store import read_model_database


def write_grid(path: Path, database: GridDatabase) -> None:
    """Write the grid; the file appears whole or not at all."""
    spec = database.spec
    with written_whole(path) as file:
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
        check_kind(path, file, "grid")
        axes = {name: tuple(map(float, read_array(file, f"axes/{name}", float))) for name in _AXES}
        spec = GridSpec(
            law=str(file.attrs["law"]),
            kappa="consistent" if file.attrs["kappa"] == "consistent" else "paper",
            geometry=Geometry(float(file.attrs["aperture_mm"]), float(file.attrs["thickness_mm"])),
            **axes,
        )
        database = GridDatabase(
            spec,
            read_array(file, "deflection_mm", float, 4),
            read_array(file, "holds_to_mbar", float, 3),
            read_array(file, "newton_iterations", int, 3),
            str(file.attrs["mesh"]),
            str(file.attrs["solver_version"]),
            int(file.attrs["degrees_of_freedom"]),
        )
        stated = str(file.attrs["content_hash"])
    check_hash(path, database.content_hash, stated)
    return database


_AXES = ("X1_MPa", "X2_MPa", "nu", "pressure_mbar")


def write_table(path: Path, table: DimensionlessTable) -> None:
    """Write the table; the file appears whole or not at all."""
    spec = table.spec
    with written_whole(path) as file:
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
        check_kind(path, file, "dimensionless")
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
            read_array(file, "log_compliance", float, 4),
            read_array(file, "holds_to_load", float, 3),
            str(attrs["mesh"]),
            str(attrs["solver_version"]),
        )
        stated = str(attrs["content_hash"])
    check_hash(path, table.content_hash, stated)
    return table


AnyDatabase = GridDatabase | DimensionlessTable | ModelDatabase


def read_database(path: Path) -> AnyDatabase:
    """Return the database in this file, of whichever kind.

    Raises:
        InputError: the file is no database of this version, or its content hash does not agree.
    """
    with open_hdf5(path) as file:
        kind = file.attrs.get("kind")
    if kind == "model":
        return read_model_database(path)
    return read_table(path) if kind == "dimensionless" else read_grid(path)


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
