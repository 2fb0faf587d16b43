"""Databases of one's own as HDF5 files; docs/files.md describes them field by field."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from skinlab.errors import InputError
from skinlab.io.documents import read_json_object
from skinlab.io.hdf5 import open_hdf5, read_array, written_whole
from skinlab.tables.abscissa import course_of
from skinlab.tables.header import SCHEMA, check_hash, check_kind
from skinlab.tables.model_database import ModelDatabase
from skinlab.tables.model_spec import spec_from_json, unit_of

_CURVES = (("deflection_mm", "mm"), ("slope_mm_per_mbar", "mm/mbar"))


def write_model(path: Path, database: ModelDatabase) -> None:
    """Write the database; the file appears whole or not at all."""
    spec, course = database.spec, database.course
    with written_whole(path) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["kind"] = "model"
        file.attrs["spec"] = spec.to_json()
        file.attrs["solver_version"] = database.solver_version
        file.attrs["versions"] = json.dumps(database.versions, sort_keys=True)
        file.attrs["content_hash"] = database.content_hash
        for name, axis in spec.axis.items():
            nodes = file.create_dataset(f"axes/{name}", data=axis.values())
            nodes.attrs["unit"] = unit_of(name)
        abscissa = "pressure_mbar" if course.unit == "mbar" else "time_s"
        file.create_dataset(f"axes/{abscissa}", data=course.nodes).attrs["unit"] = course.unit
        blocks = np.split(database.curves, course.width // len(course.nodes), axis=-1)
        for (name, unit), block in zip(_CURVES, blocks, strict=False):
            data = file.create_dataset(name, data=block, compression="gzip", shuffle=True)
            data.attrs["unit"] = unit
            data.attrs["axes"] = ", ".join([*spec.axis, abscissa])
        errors = file.create_dataset("interpolation_error", data=database.errors)
        errors.attrs["unit"] = "mm; slopes mm/mbar"
        holds = file.create_dataset(f"holds_to_{course.unit}", data=database.holds_to)
        holds.attrs["unit"] = course.unit


def read_model_database(path: Path) -> ModelDatabase:
    """Return the database in this file.

    Raises:
        InputError: the file is no such database of this version, or its content hash does not
            agree.
    """
    with open_hdf5(path) as file:
        check_kind(path, file, "model")
        try:
            spec = spec_from_json(str(file.attrs["spec"]))
            versions = {str(k): str(v) for k, v in read_json_object(file.attrs["versions"]).items()}
        except (ValueError, AttributeError) as error:
            raise InputError(f"{path}: its spec is damaged ({error})") from None
        course = course_of(spec)
        wide = len(spec.shape) + 1
        curves = [read_array(file, name, float, wide) for name, _ in _CURVES if name in file]
        holds_to = read_array(file, f"holds_to_{course.unit}", float, len(spec.shape))
        errors = read_array(file, "interpolation_error", float, 2)
        shapes = [(*spec.shape, len(course.nodes))] * (course.width // len(course.nodes))
        if [c.shape for c in curves] != shapes or (holds_to.shape, errors.shape[1:]) != (
            spec.shape,
            (course.width,),
        ):
            raise InputError(f"{path}: its arrays are not of its spec's shape; it is damaged")
        database = ModelDatabase(
            spec,
            np.concatenate(curves, axis=-1),
            holds_to,
            errors,
            str(file.attrs["solver_version"]),
            versions,
        )
        stated = str(file.attrs["content_hash"])
    check_hash(path, database.content_hash, stated)
    return database
