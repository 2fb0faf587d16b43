"""SKIN.toml: what skin and what sensor the simulated probe has. Decoded strictly."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta, field

from drivers.reading import read_whole

_MOST_DOTS = 5_000  # of one line

Form = TypeVar("Form", bound=msgspec.Struct)


class SkinSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The true skin: parameters of the paper's law, or of another one by name; its thickness."""

    X1_MPa: Annotated[float, Meta(gt=0, le=100)] = 0.025
    X2_MPa: Annotated[float, Meta(ge=0, le=10_000)] = 2.95
    nu: Annotated[float, Meta(ge=0, lt=0.5)] = 0.28
    kappa: Literal["paper", "consistent"] = "paper"
    thickness_mm: Annotated[float, Meta(gt=0, le=50)] = 1.0
    law: str | None = None
    parameters: dict[str, float] = {}  # of that law

    def __post_init__(self) -> None:
        """Refuse what is not finite, and parameters of no law."""
        _finite(self)
        if self.parameters and self.law is None:
            raise ValueError(
                f"parameters.{next(iter(self.parameters))} is of no law; expected law beside it, "
                "or X1_MPa, X2_MPa and nu in [skin]"
            )


class SensorSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Sampling rate, noise (one standard deviation) and resolution (0: none) of both channels."""

    rate_hz: Annotated[float, Meta(ge=1, le=1000)] = 20.0
    noise_um: Annotated[float, Meta(ge=0, le=10_000)] = 3.0
    resolution_um: Annotated[float, Meta(ge=0, le=1000)] = 1.0
    pressure_noise_mbar: Annotated[float, Meta(ge=0, le=100)] = 0.2
    pressure_resolution_mbar: Annotated[float, Meta(ge=0, le=100)] = 0.1

    def __post_init__(self) -> None:
        """Refuse what is not finite."""
        _finite(self)


class ProbeSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What this one probe makes of the truth, which a calibration is to find.

    It reads `deflection_gain` × height + offset, `lag_s` late, and `pressure_gain` × pressure +
    offset; its firmware believes the pressure that it reads.
    """

    serial_number: Annotated[str, Meta(min_length=1, max_length=40)] = "SIM-1"
    deflection_gain: Annotated[float, Meta(ge=0.5, le=2)] = 1.0
    deflection_offset_um: Annotated[float, Meta(ge=-400, le=400)] = 0.0
    pressure_gain: Annotated[float, Meta(ge=0.5, le=2)] = 1.0
    pressure_offset_mbar: Annotated[float, Meta(ge=-1.5, le=1.5)] = 0.0
    lag_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not finite."""
        _finite(self)


class SkinFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole SKIN.toml; everything has a default. `effects`: name -> parameter -> value."""

    skin: SkinSection = field(default_factory=SkinSection)
    effects: dict[str, dict[str, Any]] = field(default_factory=dict)
    sensor: SensorSection = field(default_factory=SensorSection)
    probe: ProbeSection = field(default_factory=ProbeSection)

    def __post_init__(self) -> None:
        """Refuse what is no finite number; here, so that the message can say which it is."""
        for effect, parameters in self.effects.items():
            for name, value in parameters.items():
                if isinstance(value, bool) or not isinstance(value, int | float):
                    raise ValueError(f"effects.{effect}.{name} must be a number, not {value!r}")
                if not math.isfinite(value):
                    raise ValueError(f"effects.{effect}.{name} must be finite, not {value}")


def load_skin_file(path: str | Path) -> SkinFile:
    """Read and check a SKIN.toml.

    Raises ValueError, one sentence that names the file and the field or line.
    """
    return load_toml(path, SkinFile)


def load_toml(path: str | Path, form: type[Form]) -> Form:
    """Read a TOML file of this form.

    Raises ValueError, one sentence that names the file and the field or line.
    """
    try:
        raw = read_whole(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror or error})") from error
    # A key of thousands of parts takes the parser a time that grows with their square.
    if any(line.count(b".") > _MOST_DOTS for line in raw.split(b"\n")):
        raise ValueError(f"{path}: nested too deeply")
    try:
        found = msgspec.toml.decode(raw, type=form)
        _check_law(msgspec.toml.decode(raw).get("skin"))
        return found
    except RecursionError:
        raise ValueError(f"{path}: nested too deeply") from None
    except ValueError as error:  # msgspec's, tomllib's and Unicode's all are
        raise ValueError(f"{path}: {_plain(str(error))}") from error


def _check_law(skin: Any) -> None:
    """Refuse parameters of the paper's law beside another law, which does not read them."""
    if isinstance(skin, dict) and "law" in skin:
        for name in ("X1_MPa", "X2_MPa", "nu"):
            if name in skin:
                raise ValueError(
                    f"skin.{name}: not read where skin.law is; expected the parameters of law "
                    f"{skin['law']!r} in [skin.parameters]"
                )


def _finite(section: msgspec.Struct) -> None:
    for name in section.__struct_fields__:
        value = getattr(section, name)
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{name} must be finite, not {value}")


def _plain(message: str) -> str:
    """Put msgspec's `... - at `$.skin.nu`` in front, where a reader looks for the field."""
    match = re.fullmatch(r"(.*) - at `\$\.?(.*)`", message, re.DOTALL)
    if match is None:
        return message
    what, where = match.groups()
    return f"{where.replace('[...]', '.*')}: {what[:1].lower()}{what[1:]}" if where else what


TRUTHFUL = ProbeSection()
