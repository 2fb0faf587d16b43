"""How long the tables take: CPU time of a sample of their curves, and all of them from that.

    OPENBLAS_NUM_THREADS=1 python benchmarks/tables.py [--curves 40] [--out FILE.json]

Each curve of the sample is computed with the compiled kernel and without, in turns, so that a busy
machine slows both; the table's time on two cores is half of the sum over all its curves.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from skinlab.mechanics.fem import kernel, skin, suction
from skinlab.tables.dimensionless_spec import DimensionlessSpec
from skinlab.tables.grid_spec import GridSpec

FOLDER = Path(__file__).resolve().parent


def cpu_s(spec: GridSpec | DimensionlessSpec, entry: int, *, compiled: bool) -> float:
    """Return what one row costs; the mesh is prepared before."""
    found = kernel.library
    if not compiled:
        kernel.library = lambda: None  # type: ignore[assignment]
    suction.assembly_for.cache_clear()
    skin._assembly.cache_clear()
    try:
        spec.row(entry)
        start = time.process_time()
        spec.row(entry)
        return time.process_time() - start
    finally:
        kernel.library = found


def main() -> None:
    """Measure, print, and write down."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--curves", type=int, default=40)
    parser.add_argument("--out", type=Path, default=FOLDER / "results" / "tables.json")
    options = parser.parse_args()
    report = {}
    for name, spec in (("paper_grid", GridSpec()), ("dimensionless", DimensionlessSpec())):
        rng = np.random.default_rng(0)
        entries = rng.choice(spec.entries, options.curves, replace=False)
        pairs = [[cpu_s(spec, int(e), compiled=c) for c in (True, False)] for e in entries]
        mean_compiled, mean_numpy = np.mean(pairs, axis=0)
        report[name] = {
            "curves": spec.entries,
            "sample": options.curves,
            "cpu_ms": {"compiled": mean_compiled * 1e3, "numpy": mean_numpy * 1e3},
            "ratio": mean_numpy / mean_compiled,
            "seconds_on_2_cores": 0.5 * spec.entries * mean_compiled,
        }
    text = json.dumps(report, indent=1)
    print(text)
    options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
