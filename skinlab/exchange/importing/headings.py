"""What a column's heading says: a channel by its name, and a unit."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from skinlab.exchange.importing.units import ROLES, Role, Unit, find_unit

Constant = Literal["opening", "thickness", "curve"]

# Parts of words, without accents, in the languages that such software speaks.
_WORDS: dict[Role, str] = {
    "time": "time zeit temps tiempo tempo tijd elapsed",
    "pressure": "press druck druk presion vacuum vakuum suction unterdruck",
    "deflection": "deflec displac elevat height deform elongat penetrat extens disten auslenk "
    "weg verform hohe abheb eindring elevac hauteur deplac altezza spostam altura desplaz dome",
}
# Whole names of a pressure: a file may have it beside a program that is stated.
_SYMBOLS = frozenset({"p", "p1", "pres", "psuc", "sog", "suc", "vac", "vak"})
_BRACKETED = re.compile(r"(.*?)\s*[(\[{<]\s*([^()\[\]{}<>]*?)\s*[)\]}>]\s*\.?")
_APPENDED = re.compile(r"(.*?)(?:\s*/\s*|\s*,\s*|\s+in\s+|_|\s+|\s*:\s*)([^\s/,:_]+)")
# What is of a whole curve; lengths among them are no deflection.
_OF_A_CURVE: dict[Constant, str] = {
    "opening": r"(?!.*radi).*(aperture|opening|offnung|ouverture|apertura|abertura|orifice).*",
    "thickness": r".*(thickness|dicke|epaisseur|espesor|spessore|dikte).*",
    "curve": r"(curve|kurve|courbe|curva|measurement|messung|mesure|medida|medicion|misura|meting"
    r"|run|trial|versuch|essai|recording|aufnahme|repeat|placement|site|subject|patient|proband"
    r"|series|serie)[ _-]*(no|nr|number|nummer|id|index|name)?\.?",
}
# Headings of a column that has the unit of the one before it
_UNIT = "units?|einheit(en)?|unites?|unidad(es)?|unita|eenheid|eenheden"
# First words of what names sums and means behind a table, without accents.
_SUMMARY = (
    "mean means average avg median max maximum min minimum range sd std stdev stddev stdabw "
    "variance sum total totals subtotal count summary mittel mittelwert durchschnitt summe gesamt "
    "gesamtsumme ergebnis anzahl standardabweichung spannweite moyenne mediane somme nombre ecart "
    "etendue media promedio mediana suma maximo minimo recuento desviacion somma totale massimo "
    "conteggio deviazione gemiddelde mediaan som totaal aantal standaarddeviatie mw stabw"
)
_SUMMARY_SIGNS = ("∑", "σ", "ø", "⌀")  # sum, mean or standard deviation; in lower case
# As a last word these are too short to be a unit without a bracket or a name that fits.
_DOUBTFUL = frozenset({"min", "mb", "bar"})


@dataclass(frozen=True)
class Heading:
    """One heading, taken apart. `role` is None where neither name nor unit tells.

    `constant` is what it tells of a whole curve: another value is of another curve.
    `symbol`: it is that of a pressure, and has no unit: so it is where no other column is.
    """

    text: str
    role: Role | None = None
    unit: Unit | None = None
    constant: Constant | None = None
    symbol: bool = False


@lru_cache(maxsize=1024)
def read_heading(text: str, unit_text: str = "") -> Heading:
    """Return what a heading says; `unit_text` is the cell of a line of units below it.

    >>> read_heading("Druck [mbar]").role
    'pressure'
    """
    text = text.strip(" \t\"'#%")
    name, unit, bracketed = _take_apart(text)
    if unit_text.strip():
        name, unit, bracketed = text, _agreed(unit, find_unit(unit_text), bracketed), True
    named = _named(name)
    if named is None and name.strip(" .").casefold() in _SYMBOLS:
        if unit is not None and unit.role == "pressure":
            named = "pressure"
        elif not bracketed:  # "P (W)" is none
            return Heading(text, symbol=True)
    of_length = not bracketed if unit is None else unit.role == "deflection"
    if named is None and of_length and (constant := _constant(name)) is not None:
        return Heading(text, None, unit, constant)
    if named is None:
        doubtful = not bracketed and unit is not None and unit.name in _DOUBTFUL
        return Heading(text, None if unit is None or doubtful else unit.role, unit)
    # A name and a unit that contradict each other leave the unit open.
    return Heading(text, named, unit if unit is not None and unit.role == named else None)


def is_unit(text: str) -> bool:
    """Return whether a heading says that units stand below it.

    >>> is_unit("Einheit"), is_unit("Unidad 2"), is_unit("United")
    (True, True, False)
    """
    return re.fullmatch(_UNIT, _plain(text).strip(" ._0123456789")) is not None


def is_summary(text: str) -> bool:
    """Return whether this names a sum or a mean, as a line behind a table has it.

    >>> is_summary("Mean:"), is_summary("Écart-type"), is_summary("0.31")
    (True, True, False)
    """
    plain = _plain(text).strip()
    first = re.match("[a-z]*", plain)
    named = first is not None and first[0] in _SUMMARY.split()
    return named or plain.startswith(("standard deviation", *_SUMMARY_SIGNS))


def _agreed(unit: Unit | None, below: Unit | None, bracketed: bool) -> Unit | None:
    """Return the unit of a line of units, unless the heading has another: that leaves it open."""
    if unit is None or below is None or (not bracketed and unit.name in _DOUBTFUL):
        return below
    same = (unit.role, unit.times, unit.over) == (below.role, below.times, below.over)
    return below if same else None


def _take_apart(text: str) -> tuple[str, Unit | None, bool]:
    """Return the name, the unit, and whether the unit is marked as one."""
    match = _BRACKETED.fullmatch(text)
    if match:
        return match[1], find_unit(match[2]), True
    match = _APPENDED.fullmatch(text)
    if match and (unit := find_unit(match[2])) is not None:
        return match[1], unit, False
    return text, find_unit(text), False


def _named(name: str) -> Role | None:
    """Return the one channel that the name speaks of."""
    plain = _plain(name)
    found = [role for role in ROLES if any(word in plain for word in _WORDS[role].split())]
    return found[0] if len(found) == 1 else None


def _constant(name: str) -> Constant | None:
    plain = _plain(name)
    return next((what for what, form in _OF_A_CURVE.items() if re.fullmatch(form, plain)), None)


def _plain(name: str) -> str:
    """Return a name in lower case and without accents."""
    letters = unicodedata.normalize("NFKD", name.lower())
    return "".join(letter for letter in letters if not unicodedata.combining(letter))
