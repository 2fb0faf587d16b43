"""A small table of the example plugin's law, by a coarse mesh: built in seconds."""

from __future__ import annotations

import os
import shutil

from skinlab.cli.main import run

DIMENSIONLESS = """
[model]
name = "fung"
law = "fung"
[table]
form = "dimensionless"
scale_mpa = [0.05, 0.09]
load_nodes = 30
[axis.thickness_over_radius]
low = 0.24
high = 0.36
nodes = 4
spacing = "log"
[axis.C2]
low = 6.0
high = 24.0
nodes = 4
spacing = "log"
[axis.kappa_over_half_shear]
low = 4.0
high = 14.0
nodes = 4
spacing = "log"
[pressures]
high_mbar = 60
[mesh]
name = "screening-1"
"""


def built(folder, name, text):
    """Return the file of the database of this spec."""
    spec, out = folder / f"{name}.toml", folder / f"{name}.h5"
    spec.write_text(text, encoding="utf-8")
    told = ["--spec", str(spec), "--out", str(out), "--workers", "1"]
    assert run(["database", "build", *told]) == 0
    return out


def dimensionless(factory, folder):
    """Return a copy in `folder` of the database of `DIMENSIONLESS`, built once a run of the tests.

    `factory` is pytest's `tmp_path_factory`. Processes that want it at the same moment build it
    each; the last one's stays.
    """
    base = factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "fung.h5"
    if not shared.exists():
        built(factory.mktemp("fung"), "fung", DIMENSIONLESS).rename(shared)
    return shutil.copy(shared, folder / "fung.h5")
