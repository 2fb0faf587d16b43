"""The answer for one curve, and its JSON form (`skinlab.identification/1`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Setup
from skinlab.curves.heights import Height
from skinlab.inference.settings import INTERVALS
from skinlab.mechanics.materials import get_law

if TYPE_CHECKING:  # slow to import, and a screen shows answers before it makes any
    from drivers.dose import Dose
    from skinlab.inference.error_judgement import ErrorModelSummary, PlacementSummary
    from skinlab.inference.uncertainty import Uncertainty

Array = NDArray[np.float64]

SCHEMA = "skinlab.identification/1"


@dataclass(frozen=True)
class Value:
    """One identified parameter with its interval; None where the method gives none."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, eq=False)
class Identification:
    """What was identified from one curve, how, and whether to trust it."""

    file: str
    setup: Setup | None  # None where the input could not be read, and for several curves together
    error: str | None  # one sentence where nothing could be identified
    points: int = 0
    phases: tuple[str, ...] = ("load",)
    parameters: dict[str, Value] | None = None  # by name, with unit; the order is `order`
    optimum: dict[str, float] | None = None  # the best fit, which E, rms and `model_mm` are of
    # What the law's reports show besides: κ, and the ν of linear elasticity.
    derived: dict[str, float | None] = field(
        default_factory=lambda: dict.fromkeys(get_law().derived_names)
    )
    correlation: tuple[tuple[float, ...], ...] | None = None
    error_um: float | None = None  # the paper's E
    rms_um: float | None = None  # root mean square residual
    noise_um: float | None = None
    iterations: int = 0
    evaluations: int = 0
    seconds: float = 0.0
    flags: tuple[str, ...] = ()
    fitted: NDArray[np.bool_] | None = None  # (points,) which samples were fitted
    model_mm: Array | None = None  # (points,) the fitted curve; NaN where there is no model
    outliers: NDArray[np.bool_] | None = None  # (points,) left out, since they do not belong
    # The same of curves together: numbers by file, of those that have any.
    outliers_by_file: dict[str, list[int]] = field(default_factory=dict)
    # Flags of curves together that are of some of them: by file, of those that have any.
    flags_by_file: dict[str, list[str]] = field(default_factory=dict)
    # Of the samples' errors, with intervals, or where a noise is stated.
    error_model: ErrorModelSummary | None = None
    placement: PlacementSummary | None = None  # of several curves, where placements may differ
    fitted_points: int = 0
    files: tuple[str, ...] | None = None  # of a joint identification
    uncertainty: Uncertainty | None = None  # where the method gives intervals
    heights: tuple[Height, ...] = ()  # of a program that stops at heights
    own_bounds: tuple[str, ...] = ()  # parameters whose bounds are a model's, not the database's

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `curves` in the identification document."""
        values = self.parameters or {}
        name = {"file": self.file} if self.files is None else {"files": list(self.files)}
        return {
            **name,
            "error": self.error,
            "points": self.points,
            "fitted_points": self.fitted_points,
            "phases": list(self.phases),
            "aperture_mm": self.setup and self.setup.aperture_mm,
            "thickness_mm": self.setup and self.setup.thickness_mm,
            "parameters": {
                name: {"value": v.value, "low": v.low, "high": v.high} for name, v in values.items()
            }
            or None,
            "optimum": self.optimum,
            **self.derived,
            "order": list(values),
            "correlation": None
            if self.correlation is None
            else [list(r) for r in self.correlation],
            "error_um": self.error_um,
            "rms_um": self.rms_um,
            "noise_um": self.noise_um,
            "error_model": self.error_model and asdict(self.error_model),
            "placement": self.placement and asdict(self.placement),
            "outliers": []
            if self.outliers is None
            else [int(i) for i in self.outliers.nonzero()[0]],
            **({"outliers_by_file": self.outliers_by_file} if self.outliers_by_file else {}),
            "iterations": self.iterations,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "flags": list(self.flags),
            **({"flags_by_file": self.flags_by_file} if self.flags_by_file else {}),
            **({"heights": [one.to_json() for one in self.heights]} if self.heights else {}),
        }


def not_trustworthy(result: Identification) -> bool:
    """Return whether the numbers should not be used: what `--strict` refuses.

    An optimum at a bound of the database may well lie outside of it.
    """
    doubtful = ("outside_database", "not_converged", "at_bound:")
    return result.error is not None or any(flag.startswith(doubtful) for flag in result.flags)


@dataclass(frozen=True)
class Advice:
    """A further measurement, and by what factor it would narrow the intervals."""

    aperture_mm: float
    program: str
    narrows: dict[str, float]  # by parameter; the expected ratio of interval widths

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `advice`."""
        return {
            "aperture_mm": self.aperture_mm,
            "program": self.program,
            "narrows": dict(self.narrows),
        }


@dataclass(frozen=True)
class Provenance:
    """With which model, database, method and seed."""

    model_name: str
    model_hash: str
    kappa: str
    database_hash: str
    method: str
    seed: int
    effects: tuple[str, ...] = ()
    probe: tuple[str, str] | None = None  # serial number and hash of its calibration


def document(
    provenance: Provenance,
    results: Sequence[Identification],
    session: str | None = None,
    *,
    joint: Identification | None = None,
    advice: Sequence[Advice] | None = None,
    dose: Dose | None = None,
) -> dict[str, Any]:
    """Return the whole identification document; `dose` is what the site of a session has had."""
    whole: dict[str, Any] = {
        "schema": SCHEMA,
        "model": {
            "name": provenance.model_name,
            "hash": provenance.model_hash,
            "kappa": provenance.kappa,
            "effects": list(provenance.effects),
        },
        "database": {"hash": provenance.database_hash},
        "method": provenance.method,
        "seed": provenance.seed,
        "interval": INTERVALS.level,
        "curves": [result.to_json() for result in results],
        "joint": None if joint is None else joint.to_json(),
        "advice": None if advice is None else [a.to_json() for a in advice],
    }
    if provenance.probe is not None:
        serial_number, hashed = provenance.probe
        whole["probe"] = {"serial_number": serial_number, "hash": hashed}
    if session is not None:
        whole["session"] = session
    if dose is not None:
        whole["dose"] = {
            "suction_mbar_s": round(dose.suction_mbar_s, 1),
            "time_s": round(dose.time_s, 2),
        }
    return whole
