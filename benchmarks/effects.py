"""The effects against campaigns whose truth is known, against a finer mesh, and their speed.

    python benchmarks/effects.py [CAMPAIGNS]

CAMPAIGNS is a folder of campaigns, each with the `truth.toml` that they were computed from by
another finite-element program: base parameters, effects, noise. Nothing is fitted: what is left
after the model at the truth is the noise and the difference of the two programs. Without it, only
the meshes and the speed. Prints and saves JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
import tomllib
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from skinlab.curves.campaign import read_campaign
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.effects import all_effects, effect_names
from skinlab.mechanics.effects import model as effects_model
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.element import QUAD9_FULL
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SCREENING_MESH, Discretisation, Geometry

RESULT = Path(__file__).parent / "results" / "effects.json"
FINE = Discretisation("fine", QUAD9_FULL, 0.005 / 3, 1.35, 0.1, 0.1, 0.2)
QUANTISATION_UM = 1 / np.sqrt(12)  # of readings rounded to 1 µm


def campaign(folder: Path) -> list[dict[str, Any]]:
    """Return a row for each curve of a campaign: what is left at the truth, µm."""
    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
    known = set(effect_names())
    if set(truth.get("effects", {})) - known:
        return []  # hidden on purpose: not in the library
    effects = {}
    for effect in all_effects():
        if effect.name in truth.get("effects", {}):
            given = truth["effects"][effect.name]
            names = [p.name for p in effect.parameters if p.name in given]
            effects[effect.name] = {name: given[name] for name in names}
    base = truth["base"]
    skin = Skin((base["X1_MPa"], base["X2_MPa"], base["nu"]), base["kappa_convention"])
    noise = np.hypot(truth["noise"]["deflection_sigma_um"], QUANTISATION_UM)
    rows = []
    for curve in read_campaign(folder / "campaign.toml").curves:
        setup = curve.setup
        assert setup.program is not None
        path = PressurePath.of_program(setup.program)
        geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
        found = response(skin, effects, geometry, path, curve.time_s, cycle=setup.cycle)
        left = 1e3 * (curve.deflection_mm - found.deflection_mm)
        dome = 1e3 * float(np.max(found.deflection_mm))
        rms = float(np.sqrt(np.mean(left**2)))
        theirs = truth["curves"][Path(curve.name).name]["w_max_um"]
        rows.append(
            {
                "campaign": folder.name, "curve": Path(curve.name).name, "effects": list(effects),
                "rms_um": rms, "noise_um": float(noise), "mean_um": float(left.mean()),
                "beyond_noise_um": float(np.sqrt(max(0.0, rms**2 - noise**2))),
                "top_um": dome, "top_percent": 100 * (dome / theirs - 1),
            }
        )  # fmt: skip
    return rows


def meshes() -> list[dict[str, Any]]:
    """Return, for each effect at its typical size, how far the mesh of record is from a finer one.

    In per cent of the dome, the largest at 10, 30 and 60 mbar; and the same for what the effect
    does to the dome, which is what naming it rests on, here of the screening mesh too.
    """
    skin, geometry = Skin((0.04, 2.0, 0.32)), Geometry(6.0, 1.0)
    path = PressurePath((0.0, 3.0), (0.0, 60.0))
    times = np.array([0.5, 1.5, 3.0])
    kinds = (MESH_OF_RECORD, SCREENING_MESH, FINE)
    base = {d.name: _dome(skin, {}, geometry, path, times, d) for d in kinds}
    rows = []
    for effect in all_effects():
        if not effect.physical:
            continue
        effects = {effect.name: effect.typical}
        dome = {d.name: _dome(skin, effects, geometry, path, times, d) for d in kinds}
        change = {name: dome[name] - base[name] for name in dome}
        exact = change[FINE.name]
        rows.append(
            {
                "effect": effect.name,
                "dome_percent": float(
                    100 * np.abs(dome[MESH_OF_RECORD.name] / dome[FINE.name] - 1).max()
                ),
                "change_um": float(1e3 * np.abs(exact).max()),
                "change_off_um": float(1e3 * np.abs(change[MESH_OF_RECORD.name] - exact).max()),
                "screening_off_um": float(1e3 * np.abs(change[SCREENING_MESH.name] - exact).max()),
            }
        )
    return rows


def _dome(skin, effects, geometry, path, times, discretisation):  # type: ignore[no-untyped-def]
    return response(
        skin, effects, geometry, path, times, cycle=2, discretisation=discretisation
    ).deflection_mm


def speed(repeats: int) -> list[dict[str, Any]]:
    """Return the median processor time of a curve with each effect, with nothing kept."""
    skin, geometry = Skin((0.03, 1.0, 0.32)), Geometry(6.0, 1.0)
    path = PressurePath.of_program(parse_program("ramp:100@80,hold:8,ramp:0@80,hold:4"))
    times = np.arange(0, 14.5, 0.05)
    rows = []
    for effects in ({}, *({e.name: e.typical} for e in all_effects() if e.physical)):
        row: dict[str, Any] = {"effect": next(iter(effects), "none")}
        for key, mesh in (("ms", MESH_OF_RECORD), ("screening_ms", SCREENING_MESH)):
            taken = []
            for _ in range(repeats + 1):
                effects_model.forget()
                begin = time.process_time()
                response(skin, effects, geometry, path, times, cycle=2, discretisation=mesh)
                taken.append(time.process_time() - begin)
            row[key] = 1e3 * statistics.median(taken[1:])
        rows.append(row)
    return rows


def main() -> None:
    """Print and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaigns", nargs="?", type=Path)
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    result: dict[str, Any] = {}
    if RESULT.exists():
        result = json.loads(RESULT.read_text())
    if arguments.campaigns:
        folders = sorted(p.parent for p in arguments.campaigns.glob("*/truth.toml"))
        rows = [row for folder in folders for row in campaign(folder)]
        result["campaigns"] = rows
        print("campaign                        curve             rms   noise  beyond  top %")
        for r in rows:
            print(
                f"{r['campaign']:31s} {r['curve']:16s} {r['rms_um']:5.2f}  {r['noise_um']:5.2f}"
                f"  {r['beyond_noise_um']:5.2f}  {r['top_percent']:+.2f}"
            )
        tops = [abs(r["top_percent"]) for r in rows]
        print(
            f"{len(rows)} curves: top in {max(tops):.2f} % (median {statistics.median(tops):.2f}"
            f" %), beyond noise at most {max(r['beyond_noise_um'] for r in rows):.2f} µm"
        )
    result["meshes"] = meshes()
    for r in result["meshes"]:
        print(
            f"{r['effect']:18s} dome off by {r['dome_percent']:.2f} %, "
            f"its change of {r['change_um']:.1f} µm by {r['change_off_um']:.2f} µm, "
            f"on the screening mesh by {r['screening_off_um']:.2f} µm"
        )
    result["speed"] = speed(arguments.repeats)
    for r in result["speed"]:
        print(f"{r['effect']:18s} {r['ms']:.0f} ms, screening mesh {r['screening_ms']:.0f} ms")
    RESULT.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
