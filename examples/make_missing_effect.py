"""Make the campaign of docs/missing-effect.md: a skin under tension, which the plain model ignores.

    python examples/make_missing_effect.py          (writes examples/missing_effect/)
    skinlab discrepancy examples/missing_effect --report report

The curves are computed on the simulated probe's own mesh, with its sensor's noise: X1 0.04 MPa,
X2 1.5 MPa, ν 0.32, 1.1 mm thick, stretched by 2.5 % in its plane before the tape was put on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sim_device.skin import MESH
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.mechanics.effects.model import Skin, response
from skinlab.mechanics.fem.suction import Geometry

FOLDER = Path(__file__).parent / "missing_effect"
SKIN = Skin((0.04, 1.5, 0.32))
EFFECTS = {"natural_tension": {"stretch": 1.025}}
THICKNESS_MM = 1.1
CURVES = (
    ("d6_ramp20.csv", 6.0, "ramp:100@20,ramp:0@20"),
    ("d6_hold.csv", 6.0, "ramp:100@80,hold:5,ramp:0@80"),
    ("d2_ramp60.csv", 2.0, "ramp:300@60,ramp:0@60"),
    ("d8_ramp20.csv", 8.0, "ramp:100@20,ramp:0@20"),
    # The probe put on again: without these a thin layer on top is as likely.
    ("d2_again.csv", 2.0, "ramp:300@60,ramp:0@60"),
    ("d8_again.csv", 8.0, "ramp:100@20,ramp:0@20"),
)


def main() -> None:
    """Write the curves and campaign.toml."""
    rng = np.random.default_rng(1)
    FOLDER.mkdir(exist_ok=True)
    lines = ["[campaign]", 'title = "one site, three openings"', "noise_um = 3.0"]
    lines.append("pressure_noise_mbar = 0.2")
    for file, aperture, text in CURVES:
        program = parse_program(text)
        time = np.arange(int(program.duration_s * 20.0 + 1e-9) + 1) / 20.0
        path = PressurePath.of_program(program)
        found = response(
            SKIN, EFFECTS, Geometry(aperture, THICKNESS_MM), path, time, discretisation=MESH
        )
        deflection = np.round(found.deflection_mm + rng.normal(0.0, 3e-3, len(time)), 3)
        pressure = np.round(path(time) + rng.normal(0.0, 0.2, len(time)), 1)
        setup = Setup(aperture, THICKNESS_MM, program)
        with (FOLDER / file).open("w", encoding="utf-8") as stream:
            write_curve(stream, Curve(file, setup, time, pressure, deflection))
        lines += ["", "[[curve]]", f'file = "{file}"', f"aperture_mm = {aperture}"]
        lines += [f"thickness_mm = {THICKNESS_MM}", f'program = "{text}"']
    (FOLDER / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
