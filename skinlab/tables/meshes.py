"""The discretisations that a spec can name."""

from __future__ import annotations

from skinlab.mechanics.fem.suction import (
    LINEAR_DILATATION_MESH,
    MESH_OF_RECORD,
    SCREENING_MESH,
    VERIFICATION_MESH,
)

MESHES = {
    mesh.name: mesh
    for mesh in (MESH_OF_RECORD, LINEAR_DILATATION_MESH, SCREENING_MESH, VERIFICATION_MESH)
}
