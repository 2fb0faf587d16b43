"""Codes and units of what is measured: UCUM units, and a code system of our own.

No public code system has the parameters of a suction law or the Cutometer's numbers;
docs/exchange.md lists these. A parameter that a plugin's law adds gets its name as its code.
"""

from __future__ import annotations

from skinlab.curves.cutometer import FORMULAS

SYSTEM = "urn:x-skinlab:codes"
INTERVAL = "urn:x-skinlab:interval-90"
UCUM = "http://unitsofmeasure.org"

CODES: dict[str, tuple[str, str]] = {  # code: (words, UCUM unit)
    "suction-curve": ("Suction curve of the skin, and the parameters identified from it", ""),
    "time": ("Time since the curve began", "s"),
    "pressure": ("Suction under the probe", "mbar"),
    "deflection": ("Height of the dome's apex", "mm"),
    "aperture": ("Diameter of the probe's opening", "mm"),
    "thickness": ("Thickness of the skin, epidermis and dermis", "mm"),
    "X1_MPa": ("Stiffness at small stretch, X1", "MPa"),
    "X2_MPa": ("Stiffness at large stretch, X2", "MPa"),
    "nu": ("Poisson's ratio as the law defines it", "1"),
    "kappa_MPa": ("Resistance to a change of volume", "MPa"),
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
    for ending, unit in (*_ENDINGS, *_MORE_ENDINGS):
        if name.endswith(ending):
            return unit
    return "1"


def words_of(name: str) -> str:
    """Return what a code means."""
    return CODES[name][0] if name in CODES else f"Parameter {name} of the law"
