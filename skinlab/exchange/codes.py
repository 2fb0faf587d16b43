"""Codes and units of what is measured: UCUM units, and a code system of our own.

No public code system has the parameters of a suction law or the Cutometer's numbers;
docs/exchange.md lists these. A parameter's code is its name; law or effect declare its meaning.
"""

from __future__ import annotations

from skinlab.curves.cutometer import FORMULAS
from skinlab.mechanics.materials.base import KAPPA, NU_CONSISTENT
from skinlab.mechanics.names import parameter_of

SYSTEM = "urn:x-skinlab:codes"
INTERVAL = "urn:x-skinlab:interval-90"
SESSION_FILE = "urn:x-skinlab:session-file"
UCUM = "http://unitsofmeasure.org"

CODES: dict[str, tuple[str, str]] = {  # code: (words, UCUM unit)
    "suction-curve": ("Suction curve of the skin, and the parameters identified from it", ""),
    "time": ("Time since the curve began", "s"),
    "pressure": ("Suction under the probe", "mbar"),
    "deflection": ("Height of the dome's apex", "mm"),
    "aperture": ("Diameter of the probe's opening", "mm"),
    "thickness": ("Thickness of the skin, epidermis and dermis", "mm"),
    KAPPA: ("Resistance to a change of volume", "MPa"),
    NU_CONSISTENT: ("Poisson's ratio of linear elasticity at rest", "1"),
    "rms_um": ("Root mean square residual of the fit", "um"),
    "noise_um": ("Standard deviation of one deflection sample", "um"),
    **{
        name: (f"Cutometer's number {name}", "mm" if unit == "mm" else "1")
        for name, (_, unit, _, _) in FORMULAS.items()
    },
}

_ENDINGS = (("_MPa", "MPa"), ("_kPa", "kPa"), ("_mm", "mm"), ("_um", "um"), ("_mbar", "mbar"))
_MORE_ENDINGS = (("_s", "s"), ("_hz", "Hz"))


def unit_of(name: str) -> str:
    """Return the UCUM unit of a quantity by its name, which carries it."""
    if name in CODES:
        return CODES[name][1]
    if (declared := parameter_of(name)) is not None:
        return declared.unit.replace("µ", "u") or "1"  # UCUM has letters of ASCII
    for ending, unit in (*_ENDINGS, *_MORE_ENDINGS):
        if name.endswith(ending):
            return unit
    return "1"


def words_of(name: str) -> str:
    """Return what a code means."""
    if name in CODES:
        return CODES[name][0]
    declared = parameter_of(name)
    if declared is None:
        return f"Parameter {name} of the law"
    return f"{declared.label}: {declared.meaning}"
