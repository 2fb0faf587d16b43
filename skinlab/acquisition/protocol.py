"""The protocol of a study: what is to be measured, under which conditions, and what is accepted.

A PROTOCOL.toml, decoded strictly; docs/files.md has its keys. It demands, and never refuses: what
is missing or otherwise is said before a measurement, and recorded with it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import msgspec

from drivers.numbers import number_in
from drivers.reading import read_whole
from skinlab.acquisition.measurement_request import MOST_REPEATS, MOST_REST_S
from skinlab.curves.apertures import check_aperture
from skinlab.curves.program import Program, check_measurable, parse_program
from skinlab.errors import InputError
from skinlab.io.documents import decode, read_toml
from skinlab.io.files import named_in_errors
from skinlab.mechanics.names import parameter_names, parameter_of
from skinlab.recording.pseudonym import check_note, check_site
from skinlab.text import did_you_mean

OPERATOR = "operator"
# Conditions that are numbers: (name, words, unit, lowest, highest that can be)
NUMBERS = (
    ("room_temperature_c", "room temperature", "°C", -20.0, 60.0),
    ("humidity_percent", "humidity", "%", 0.0, 100.0),
    ("acclimatisation_min", "acclimatisation", "min", 0.0, 1440.0),
    ("contact_load_n", "contact load", "N", 0.0, 100.0),
)
_WORDS = {name: words for name, words, *_ in NUMBERS} | {OPERATOR: "operator"}
_UNITS = {name: unit for name, _, unit, *_ in NUMBERS}
_MOST_REST_BEFORE_S = 86_400.0


class Study(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[study]: its title, and the sites at which all steps are measured; none: anywhere."""

    title: str
    sites: tuple[str, ...] = ()


class Conditions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[conditions]: (lowest, highest) of each, the least time at rest in the room, who measures."""

    room_temperature_c: tuple[float, float] | None = None
    humidity_percent: tuple[float, float] | None = None
    acclimatisation_min: float | None = None
    contact_load_n: tuple[float, float] | None = None
    operator: bool = False
    thickness_measured: bool = False


class Acceptance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[acceptance]: which curves count.

    `interval_percent`: half the 90 % interval of a parameter at most; `scatter_percent`: the
    standard deviation of a step's accepted repeats at most.
    """

    verdict: Literal["good", "any"] = "good"
    interval_percent: dict[str, float] = msgspec.field(default_factory=dict)
    scatter_percent: dict[str, float] = msgspec.field(default_factory=dict)


class ProtocolStep(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[[step]]: one opening, one program, some repeats."""

    aperture_mm: float
    program: str
    name: str = ""
    repeats: int = 1
    rest_s: float = 5.0  # between two repeats
    rest_before_s: float = 0.0  # since the curve before the first of them

    @property
    def parsed(self) -> Program:
        """The program."""
        return parse_program(self.program)

    @property
    def words(self) -> str:
        """Its name, or what is measured."""
        return self.name or f"{self.aperture_mm:g} mm, {self.program}"


class Protocol(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a PROTOCOL.toml says."""

    study: Study
    step: tuple[ProtocolStep, ...]
    conditions: Conditions = Conditions()
    acceptance: Acceptance = Acceptance()


class NamedProtocol(msgspec.Struct, frozen=True):
    """A protocol, the text that it was read from, and the file's name."""

    protocol: Protocol
    text: str
    file: str


def read_protocol(path: Path) -> NamedProtocol:
    """Return the protocol of this file.

    Raises:
        InputError: it cannot be read, or something in it is unknown, missing or out of range; names
            the file and the field.
    """
    with named_in_errors(path):
        raw = read_whole(path)
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected UTF-8") from None
    return NamedProtocol(decode_protocol(text, str(path)), text, path.name)


def decode_protocol(text: str, where: str) -> Protocol:
    """Return the protocol of this text, which is that of `where`.

    Raises:
        InputError: as `read_protocol`.
    """
    with named_in_errors(where):
        found = decode(read_toml(text), Protocol)
        _check(found)
    return found


def _check(protocol: Protocol) -> None:
    if not protocol.study.title.strip():
        raise InputError("study.title is empty; expected the name of the study")
    check_note(protocol.study.title)
    for site in protocol.study.sites:
        if not check_site(site).strip():
            raise InputError("study.sites: a site is empty; expected e.g. forearm, volar, left")
    if len(set(protocol.study.sites)) != len(protocol.study.sites):
        raise InputError("study.sites: a site is named twice")
    if not protocol.step:
        raise InputError("no [[step]]; expected at least one")
    for number, step in enumerate(protocol.step, start=1):
        try:
            _check_step(step)
        except InputError as error:
            raise InputError(f"step {number}: {error}") from None
    _check_conditions(protocol.conditions)
    for field in ("interval_percent", "scatter_percent"):
        for name, percent in getattr(protocol.acceptance, field).items():
            if parameter_of(name) is None:
                near = did_you_mean(name, parameter_names())
                raise InputError(f"acceptance.{field}.{name}: no such parameter{near}")
            if not 0 < percent < 1000:
                raise InputError(f"acceptance.{field}.{name} is {percent:g}; expected 0 to 1000 %")


def _check_step(step: ProtocolStep) -> None:
    check_aperture(step.aperture_mm)
    check_measurable(step.parsed)
    check_note(step.name)
    if not 1 <= step.repeats <= MOST_REPEATS:
        raise InputError(f"repeats is {step.repeats}; expected 1–{MOST_REPEATS}")
    if not 0 <= step.rest_s <= MOST_REST_S:
        raise InputError(f"rest_s is {step.rest_s:g}; expected 0–{MOST_REST_S:g} s")
    if not 0 <= step.rest_before_s <= _MOST_REST_BEFORE_S:
        raise InputError(
            f"rest_before_s is {step.rest_before_s:g}; expected 0–{_MOST_REST_BEFORE_S:g} s"
        )


def _check_conditions(conditions: Conditions) -> None:
    for name, _, unit, least, most in NUMBERS:
        demanded = getattr(conditions, name)
        if demanded is None:
            continue
        low, high = demanded if isinstance(demanded, tuple) else (demanded, most)
        if not least <= low < high <= most:
            raise InputError(
                f"conditions.{name} is {demanded}; expected "
                f"{'low and high' if isinstance(demanded, tuple) else 'a number'} within "
                f"{least:g} to {most:g} {unit}"
            )


# ---- what it was, as the operator says -----------------------------------------------------------


def demanded(protocol: Protocol) -> dict[str, str]:
    """Return the conditions that are to be stated, by name: what is expected, in words."""
    found = {}
    for name, words, unit, *_ in NUMBERS:
        limits = getattr(protocol.conditions, name)
        if isinstance(limits, tuple):
            found[name] = f"{words}, {limits[0]:g} to {limits[1]:g} {unit}"
        elif limits is not None:
            found[name] = f"{words}, at least {limits:g} {unit}"
    if protocol.conditions.operator:
        found[OPERATOR] = "operator, a code such as OP-1"
    return found


def condition_complaint(name: str, text: str) -> str | None:
    """Return why a text is no statement of this condition, in one sentence; None: it is one."""
    if name == OPERATOR:
        try:
            check_note(text)
        except InputError as error:
            return str(error).replace("note", "operator", 1)
        return None
    _, words, unit, least, most = next(n for n in NUMBERS if n[0] == name)
    value = _number(text)
    if not least <= value <= most:
        return f"{words} {text!r}: expected {least:g} to {most:g} {unit}"
    return None


def _number(text: str) -> float:
    try:
        return number_in(text.replace(",", "."))
    except ValueError:
        return math.nan


def stated_words(name: str, text: str) -> str:
    """Return a stated condition with its unit."""
    return f"{_WORDS.get(name, name)} {text} {_UNITS.get(name, '')}".rstrip()


def conditions_missing(protocol: Protocol, stated: dict[str, str]) -> list[str]:
    """Return what was not stated, or is outside the protocol's limits, in clauses."""
    missing = [_WORDS[name] for name in demanded(protocol) if not stated.get(name)]
    found = [f"not stated: {', '.join(missing)}"] if missing else []
    for name, words, unit, _, most in NUMBERS:
        limits, text = getattr(protocol.conditions, name), stated.get(name)
        if limits is None or not text:
            continue
        low, high = limits if isinstance(limits, tuple) else (limits, most)
        if not low <= _number(text) <= high:
            ends = f"{low:g} to {high:g}" if isinstance(limits, tuple) else f"at least {low:g}"
            found.append(f"{words} {text} {unit}, not {ends}")
    return found


# ---- what is asked for, beside what it says ------------------------------------------------------


def site_not_named(protocol: Protocol, site: str) -> list[str]:
    """Return a clause where the protocol names sites, and not this one."""
    sites = protocol.study.sites
    named = not sites or site in sites
    return [] if named else [f"the protocol does not name the site {site or 'none given'}"]


def step_otherwise(
    step: ProtocolStep, left: int, repeats: int | None, rest_s: float | None
) -> list[str]:
    """Return what is asked for otherwise than a step says, of which `left` repeats are to come.

    None: as it says.
    """
    found = []
    if repeats is not None and repeats != left:
        found.append(f"repeats: {repeats}, not {left}")
    several = (left if repeats is None else repeats) > 1
    if several and rest_s is not None and rest_s < step.rest_s:
        found.append(f"rest {rest_s:g} s, not {step.rest_s:g} s")
    return found
