"""A probe file: the errors of one probe, as a calibration found them, and how sure they are.

The probe reads `gain` × height + offset, `lag` late, and `pressure_gain` × pressure + offset.
Identification takes this off the readings, and carries what the calibration left open as errors
that all samples have in common (columns of the covariance). The readings stay as they are.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.reading import read_whole
from skinlab.curves.apertures import APERTURES_MM
from skinlab.curves.phantoms import Phantom
from skinlab.curves.settings import PROBE
from skinlab.errors import InputError
from skinlab.io.documents import decode, read_json, read_toml, text_of, toml_text
from skinlab.io.files import append_text, named_in_errors
from skinlab.text import counted

Array = NDArray[np.float64]

SCHEMA = "skinlab.probe/1"
# In the order of the covariance; mm where the file's fields say µm
PARAMETERS = (
    "deflection_gain", "deflection_offset_um", "pressure_gain", "pressure_offset_mbar", "lag_s",
)  # fmt: skip
# What a calibration knows too: beside one, such an effect of a model would count the same twice
SENSOR_EFFECTS = frozenset(
    {"deflection_gain", "deflection_offset", "pressure_gain", "pressure_lag"}
)


class Interval(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A value with its 90 % interval."""

    value: float
    low: float
    high: float

    def __post_init__(self) -> None:
        """Refuse what is no interval."""
        numbers = (self.low, self.value, self.high)
        if not all(map(math.isfinite, numbers)) or not self.low <= self.value <= self.high:
            raise ValueError("expected low ≤ value ≤ high, finite")


class CheckCurve(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What this probe read on one phantom: deflection (n,) at readings of the pressure (n,)."""

    phantom: Phantom
    pressure_mbar: list[float]
    deflection_mm: list[float]

    def __post_init__(self) -> None:
        """Refuse what is no curve."""
        p, w = np.array(self.pressure_mbar), np.array(self.deflection_mm)
        if len(p) < 3 or len(p) != len(w) or not (np.isfinite(p).all() and np.isfinite(w).all()):
            raise ValueError("expected as many deflections as pressures, at least 3, finite")
        if not (np.diff(p) > 0).all():
            raise ValueError("expected pressures that increase")


class ProbeFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole PROBE.toml."""

    schema: Literal["skinlab.probe/1"]
    serial_number: str
    model: str
    aperture_mm: float
    calibrated_utc: str
    valid_until_utc: str
    deflection_gain: Interval
    deflection_offset_um: Interval
    pressure_gain: Interval
    pressure_offset_mbar: Interval
    lag_s: Interval
    covariance: list[list[float]]  # of PARAMETERS, in their units
    noise_um: Annotated[float, Meta(ge=0)]
    pressure_noise_mbar: Annotated[float, Meta(ge=0)]
    misfit: Annotated[float, Meta(ge=0)]  # χ² of the calibration, per degree of freedom
    not_determined: list[str]  # of PARAMETERS, which these phantoms cannot show
    phantoms_off: list[str]  # which the readings put far from their sheets
    phantoms: list[Phantom]
    check: CheckCurve | None = None

    def __post_init__(self) -> None:
        """Refuse what is no calibration."""
        if self.aperture_mm not in APERTURES_MM:
            raise ValueError(f"aperture_mm {self.aperture_mm:g}: no probe has this opening")
        matrix = np.array(self.covariance, dtype=float)
        n = len(PARAMETERS)
        if matrix.shape != (n, n) or not np.isfinite(matrix).all():
            raise ValueError(f"covariance: expected {n} rows of {n} finite numbers")
        if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix).min() < -1e-12:
            raise ValueError("covariance: expected a symmetric, positive matrix")
        for name in ("deflection_gain", "pressure_gain"):
            if not 0.5 <= getattr(self, name).value <= 2:
                raise ValueError(f"{name}: expected 0.5 to 2")
        for name in ("calibrated_utc", "valid_until_utc"):
            if datetime.fromisoformat(getattr(self, name)).tzinfo is None:
                raise ValueError(f"{name}: expected a time with its zone")

    @property
    def valid_until(self) -> datetime:
        """Until when the calibration holds."""
        return datetime.fromisoformat(self.valid_until_utc)


@dataclass(frozen=True)
class ProbeErrors:
    """A probe file as identification uses it; `text` is the file, `path` where it lies."""

    file: ProbeFile
    text: str
    path: Path | None = field(default=None, compare=False)

    @property
    def hash(self) -> str:
        """`sha256:…` over the file."""
        return "sha256:" + hashlib.sha256(self.text.encode()).hexdigest()

    @cached_property
    def _root(self) -> Array:
        """A root (5, 5) of the covariance, mm for µm."""
        scale = np.array([1.0, 1e-3, 1.0, 1.0, 1.0])
        matrix = np.array(self.file.covariance) * np.outer(scale, scale)
        values, vectors = np.linalg.eigh(matrix)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def keep_check(self, when: datetime, *, agrees: bool) -> None:
        """Note beside the file that the probe was checked.

        Raises:
            InputError: it cannot be written.
        """
        assert self.path is not None
        said = {"utc": when.astimezone(UTC).isoformat(), "probe": self.hash, "agrees": agrees}
        append_text(self._checks(self.path), json.dumps(said) + "\n")

    def standing(self, when: datetime) -> tuple[bool, str]:
        """Return whether the probe can be relied on as it was calibrated, and what to say of it.

        A check counts for the visit: 12 hours.
        """
        file, last = self.file, self._last_check()
        who, again = f"probe {file.serial_number}", f"skinlab calibrate --check {self.path}"
        left = file.valid_until.astimezone(UTC) - when.astimezone(UTC)
        soon = f"; its calibration ends in {counted(left.days, 'day')}" if left < PROBE.soon else ""
        if last is not None and not last[1]:
            return False, f"{who} DIFFERED from its calibration at its last check: calibrate again"
        if last is None or not timedelta(0) <= when.astimezone(UTC) - last[0] <= PROBE.visit:
            since = "yet" if last is None else f"since {last[0]:%Y-%m-%d}"
            return False, f"{who} was not checked {since}: before the visit, {again}{soon}"
        return not soon, f"{who} agreed with its calibration when it was checked{soon}"

    def _checks(self, path: Path) -> Path:
        return path.with_suffix(".checks")

    def _last_check(self) -> tuple[datetime, bool] | None:
        """Return when this file was checked last, and whether the probe agreed."""
        try:
            lines = [] if self.path is None else read_whole(self._checks(self.path)).splitlines()
        except OSError:
            return None
        for line in reversed(lines):
            try:
                said = read_json(line)
                if said["probe"] == self.hash:
                    return datetime.fromisoformat(said["utc"]).astimezone(UTC), bool(said["agrees"])
            except (ValueError, KeyError, TypeError, OverflowError):
                continue  # a damaged line costs itself
        return None

    def check_instrument(
        self, serial_number: str, aperture_mm: float | None, when: datetime
    ) -> None:
        """Refuse another probe, another opening, or a calibration that is over.

        Raises:
            InputError: so.
        """
        file = self.file
        if serial_number != file.serial_number:
            raise InputError(
                f"the probe file is of serial number {file.serial_number!r}; connected is "
                f"{serial_number!r}"
            )
        self.check_use(aperture_mm, when)

    def check_use(self, aperture_mm: float | None, when: datetime) -> None:
        """Refuse another opening, or a calibration that is over: no probe need be there.

        Raises:
            InputError: so.
        """
        file = self.file
        if aperture_mm is not None and abs(aperture_mm - file.aperture_mm) > 1e-6:
            raise InputError(
                f"the probe file is of an opening of {file.aperture_mm:g} mm, and not of "
                f"{aperture_mm:g} mm"
            )
        if when.astimezone(UTC) > file.valid_until.astimezone(UTC):
            raise InputError(
                f"the probe file was valid until {file.valid_until_utc[:10]}; calibrate again "
                "(skinlab calibrate), or leave --probe out"
            )

    def columns_mm(
        self, time_s: Array, pressure_mbar: Array, deflection_mm: Array, slope: Array
    ) -> Array:
        """Return what the calibration leaves open, as columns (u, 5) of errors of a curve.

        For samples of one curve in time order: true pressures, deflections, and dw/dp in mm/mbar.
        """
        gain, pressure_gain = self.file.deflection_gain.value, self.file.pressure_gain.value
        each = np.column_stack(
            [
                -deflection_mm / gain,
                np.full(len(time_s), -1.0 / gain),
                slope * pressure_mbar / pressure_gain,
                slope / pressure_gain,
                slope * pressure_rate(time_s, pressure_mbar),
            ]
        )
        return np.asarray(each @ self._root)


def check_counted_once(probe: ProbeErrors | None, effects: Iterable[str]) -> None:
    """Refuse a model's effects that are errors of the probe, beside its calibration.

    Raises:
        InputError: there is one.
    """
    twice = sorted(SENSOR_EFFECTS.intersection(effects))
    if probe is not None and twice:
        raise InputError(
            f"the model's {', '.join(twice)} is what the probe file says too, and would count "
            "twice; leave one of them out (--probe none)"
        )


def pressure_rate(time_s: Array, pressure_mbar: Array) -> Array:
    """Return dp/dt (n,) of the pump, without the readings' noise."""
    if len(time_s) <= PROBE.smooth:
        return np.zeros(len(time_s))
    padded = np.pad(pressure_mbar, PROBE.smooth // 2, mode="reflect", reflect_type="odd")
    return np.gradient(np.convolve(padded, np.ones(PROBE.smooth) / PROBE.smooth, "valid"), time_s)


def read_probe(path: Path) -> ProbeErrors:
    """Return the probe of a PROBE.toml.

    Raises:
        InputError: it cannot be read, or a field is wrong.
    """
    with named_in_errors(path):
        text = text_of(read_whole(path))
    return replace(decode_probe(text, str(path)), path=path)


def decode_probe(text: str, where: str) -> ProbeErrors:
    """Return the probe of this text, which is that of `where`.

    Raises:
        InputError: as `read_probe`.
    """
    with named_in_errors(where):
        return ProbeErrors(decode(read_toml(text), ProbeFile), text)


def probe_text(file: ProbeFile) -> str:
    """Return a probe file as text."""
    return toml_text(msgspec.to_builtins(file))
