"""Tables as HDF5 files; docs/files.md describes them field by field."""

from __future__ import annotations

import copyreg
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from skinlab.errors import InputError
from skinlab.io.files import real_path
from skinlab.io.hdf5 import open_hdf5, written_whole
from skinlab.tables.header import SCHEMA, check_hash
from skinlab.tables.table import Table

# Loaded where a file is of the kind: the specs of one's own stand on all finite elements.
_KINDS = {
    "grid": ("grid_spec", "GridSpec"),
    "dimensionless": ("dimensionless_spec", "DimensionlessSpec"),
    "model": ("custom_spec", "CustomSpec"),
}
_DATA = Path(__file__).parents[1] / "data"
_PROTOCOL = 2  # of pickles: the first that knows such classes


def write(path: Path, table: Table) -> None:
    """Write the table; the file appears whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    with written_whole(path) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["kind"] = table.spec.kind
        file.attrs["solver_version"] = table.solver_version
        file.attrs["content_hash"] = table.content_hash
        for name, value in table.spec.attributes(table).items():
            file.attrs[name] = value
        for one in table.spec.datasets(table):
            options: dict[str, Any] = {}
            if one.compression is not None:
                options = {
                    "compression": "gzip", "compression_opts": one.compression, "shuffle": True,
                }  # fmt: skip
            dataset = file.create_dataset(one.name, data=one.values, **options)
            for key, text in (("unit", one.unit), ("axes", one.axes)):
                if text:
                    dataset.attrs[key] = text


def read(path: Path) -> Table:
    """Return the table in this file, whatever its spec; it knows its path.

    Raises:
        InputError: the file is no database of this version, or its content hash does not agree.
    """
    with open_hdf5(path) as file:
        schema, kind = file.attrs.get("schema"), file.attrs.get("kind")
        if schema != SCHEMA or kind not in _KINDS:
            raise InputError(
                f"{path}: schema {schema!r}, kind {kind!r}; expected a database, {SCHEMA!r}"
            )
        try:
            table: Table = _spec(kind).read(file)
            found = table.content_hash
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except (ValueError, TypeError, AttributeError) as error:
            raise InputError(f"{path}: its spec is damaged ({error})") from None
        stated = str(file.attrs["content_hash"])
    check_hash(path, found, stated)
    return replace(table, path=real_path(path))


def _spec(kind: str) -> Any:
    module, name = _KINDS[kind]
    return getattr(import_module(f"skinlab.tables.{module}"), name)


@cache
def shipped_grid() -> Table:
    """Return the paper's grid that ships inside the package."""
    return replace(read(_DATA / "paper_grid.h5"), path=None)


@cache
def shipped_table() -> Table:
    """Return the dimensionless table that ships inside the package."""
    return replace(read(_DATA / "dimensionless.h5"), path=None)


def shipped_again(content_hash: str) -> Table:
    """Return the shipped table, for a pickle that names it.

    Raises:
        InputError: another one ships with this version.
    """
    table = shipped_table()
    if table.content_hash != content_hash:
        raise InputError(
            "pickled by a skinlab with another database; expected the same version on both sides"
        )
    return table


def _pickled(table: Table) -> Any:
    """Return the pickle of a table: of the shipped one its hash, as each result has the table."""
    if shipped_table.cache_info().currsize and table is shipped_table():
        return shipped_again, (table.content_hash,)
    return table.__reduce_ex__(_PROTOCOL)


copyreg.pickle(Table, _pickled)
