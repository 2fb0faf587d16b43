"""Write the campaigns of the challenge, and their truth apart.

    python benchmarks/challenge/generate.py CAMPAIGNS TRUTH [--first 0] [--count 200]

CAMPAIGNS gets a folder for each, with campaign.toml and its curves: all that a program may see.
TRUTH gets a JSON document for each. The same seeds give the same campaigns (to the last digits that
the processor rounds); a campaign that is there already with its truth is left alone, and one that
was cut short is written anew.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import tomli_w
from challenge.campaigns import FAMILIES, Made, Truth, make

from skinlab.curves.csv import write_curve

SEED = 20_411  # never developed on
# Parts and how many: numbers run on within each.
PLAN = (("life_none", 80), ("life_single", 60), ("life_double", 20), ("life_outside", 40))


def entries() -> list[tuple[str, str, int]]:
    """Return name, part and number of each campaign, the parts mixed evenly."""
    found = []
    for part, count in PLAN:
        found += [((number + 0.5) / count, part, number) for number in range(count)]
    return [(f"c{i:03d}", part, number) for i, (_, part, number) in enumerate(sorted(found))]


def write_campaign(folder: Path, made: Made) -> None:
    """Write what a program may see; the file names tell nothing of the truth.

    A folder with `campaign.toml` is a whole campaign: that file is the last, and takes its name
    when all of it is there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    campaign = made.campaign
    head: dict[str, Any] = {"title": folder.name}
    if campaign.noise_um is not None:
        head["noise_um"] = campaign.noise_um
        head["pressure_noise_mbar"] = campaign.pressure_noise_mbar
    rows = []
    for i, curve in enumerate(campaign.curves):
        file, setup = f"curve{i:02d}.csv", curve.setup
        with (folder / file).open("w", newline="") as stream:
            write_curve(stream, curve)
        rows.append(
            {
                "file": file, "aperture_mm": setup.aperture_mm,
                "thickness_mm": setup.thickness_mm, "program": str(setup.program),
                "cycle": setup.cycle, "repeat": setup.repeat,
            }
        )  # fmt: skip
    text = tomli_w.dumps({"campaign": head, "curve": rows})
    partial = folder / ".campaign.toml.partial"
    partial.write_text(text)
    partial.replace(folder / "campaign.toml")


def truth_document(name: str, part: str, truth: Truth) -> dict[str, Any]:
    """Return the truth of one campaign."""
    return {
        "name": name, "part": part, "effects": sorted(truth.effects), "values": truth.effects,
        "outside": truth.distortion, "families": list(FAMILIES.get(truth.distortion, ())),
        "skin": list(truth.skin.values), "thickness_mm": truth.thickness_mm,
        "noise_um": truth.noise_um, "life": None if truth.life is None else asdict(truth.life),
    }  # fmt: skip


def main() -> None:
    """Write those that are missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaigns", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=200)
    arguments = parser.parse_args()
    if arguments.truth.resolve().is_relative_to(arguments.campaigns.resolve()):
        parser.error("the truth has to be apart from the campaigns")
    every = entries()
    if not 0 <= arguments.first < len(every):
        parser.error(f"--first {arguments.first}: expected 0 to {len(every) - 1}")
    if arguments.count < 1:
        parser.error(f"--count {arguments.count}: expected 1 or more")
    try:
        write(arguments.campaigns, arguments.truth, every[arguments.first :][: arguments.count])
    except OSError as error:
        parser.error(f"{error.filename}: {error.strerror}")


def write(campaigns: Path, truths: Path, every: Sequence[tuple[str, str, int]]) -> None:
    """Write those of them that are missing."""
    truths.mkdir(parents=True, exist_ok=True)
    for name, part, number in every:
        folder, told = campaigns / name, truths / f"{name}.json"
        if (folder / "campaign.toml").exists() and told.exists():
            continue
        truth, made = make(part, SEED, number)
        document = truth_document(name, part, truth)
        told.write_text(json.dumps(document, indent=1) + "\n")
        write_campaign(folder, made)
        print(folder, flush=True)


if __name__ == "__main__":
    main()
