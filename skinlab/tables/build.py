"""Build a table: compute its rows with the finite elements, and put them in order; verify one."""

from __future__ import annotations

import numpy as np

from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SOLVER_VERSION
from skinlab.tables.meshes import MESHES
from skinlab.tables.parallel_build import How, compute_rows
from skinlab.tables.table import Spec, Table
from skinlab.versions import only_plugins, versions

HERE = How()


def build(spec: Spec, how: How = HERE) -> Table:
    """Return the built table.

    Raises:
        InputError: see `compute_rows`.
    """
    entries, width = spec.rows
    made_with = versions()
    identity = " ".join([spec.identity, SOLVER_VERSION, *only_plugins(made_with).values()])
    rows = compute_rows(spec.row, identity, entries, width, how)
    return spec.table(rows, SOLVER_VERSION, made_with)


def rebuilt_differences(table: Table, samples: int, seed: int) -> list[str]:
    """Return a sentence for each entry, of `samples` random ones, that comes out differently.

    Raises:
        InputError: samples is not within 1 and the number of entries.
    """
    spec = table.spec
    if not 1 <= samples <= spec.entries:
        raise InputError(f"samples {samples}: expected 1–{spec.entries}")
    here = spec.mesh_name if spec.mesh_name in MESHES else MESH_OF_RECORD.name
    if (table.mesh_name, table.solver_version) != (here, SOLVER_VERSION):
        return [
            f"built with mesh {table.mesh_name}, solver {table.solver_version}; "
            f"this is {here}, {SOLVER_VERSION}"
        ]
    entries = np.random.default_rng(seed).choice(spec.entries, samples, replace=False).tolist()
    found = [spec.difference(table, entry) for entry in entries]
    return [sentence for sentence in found if sentence]


def describe(table: Table) -> str:
    """Return what is in a table, in a few lines."""
    head = f"law {table.law}, mesh {table.mesh_name}, solver version {table.solver_version}"
    return "\n".join([head, *table.spec.describe(table), table.content_hash])
