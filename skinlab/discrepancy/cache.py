"""Outcomes kept by the content of what they were computed from: a second run is instant.

Files are MessagePack, decoded by type: whoever can write there can spoil a number, and run nothing.
JSON would do as well, but has no infinity, and no arrays.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_origin

import msgspec
import numpy as np
import platformdirs
from numpy.typing import NDArray

from skinlab.discrepancy.candidates import Candidate, Found
from skinlab.discrepancy.discipline import Shares, Trial
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.next_measurement import NextMeasurement
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.posterior import Posterior
from skinlab.discrepancy.records import Record, coarsened, without
from skinlab.discrepancy.screen import Signature
from skinlab.discrepancy.settings import ERRORS
from skinlab.discrepancy.verdict import Name, Verdict
from skinlab.errors import InputError
from skinlab.inference.covariance import Covariance
from skinlab.inference.error_judgement import ErrorModelSummary, PlacementSummary
from skinlab.io.files import make_folder, without_leftovers, write_file
from skinlab.mechanics.effects import EFFECTS
from skinlab.mechanics.materials import LAWS
from skinlab.tables.model_errors import SeenErrors
from skinlab.versions import versions

_SUFFIX = ".msgpack"
_DIGEST_BYTES = 32  # in front: SHA-256 of the rest


class _KeptRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a search found out of a record."""

    pressure_mbar: NDArray[np.float64]
    off_path_mm: NDArray[np.float64]
    bend_mm: NDArray[np.float64]
    creases_mbar: float
    table_errors: SeenErrors | None

    @classmethod
    def of(cls, record: Record) -> _KeptRecord:
        each = np.zeros(len(record.curve))
        return cls(
            record.pressure_mbar, each + record.off_path_mm, each + record.bend_mm,
            record.creases_mbar, record.table_errors,
        )  # fmt: skip

    def back_to(self, record: Record) -> Record:
        if len(self.pressure_mbar) != len(record.curve):
            raise ValueError("of other samples")
        return replace(
            record, pressure_mbar=self.pressure_mbar, off_path_mm=self.off_path_mm,
            bend_mm=self.bend_mm, creases_mbar=self.creases_mbar, table_errors=self.table_errors,
        )  # fmt: skip


class _Kept(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An outcome without the measured curves, which whoever asks has at hand."""

    verdict: Name
    explanations: list[int]  # places among the candidates
    base: Candidate
    candidates: list[Candidate]
    signatures: dict[str, Signature]
    not_screened: dict[str, str]
    errors: Covariance
    kept: list[NDArray[np.bool_]]
    implausible: str
    trials: list[Trial]
    doubted: Candidate | None
    kinds: tuple[str, ...]
    shares: Shares | None
    error_model: ErrorModelSummary | None
    placement: PlacementSummary | None
    repeats_um: float | None
    gap_before: HeldOut
    gap_after: HeldOut
    held_out: dict[tuple[str, ...], float]
    next_measurement: NextMeasurement | None
    seed: int
    alike: list[tuple[str, str]]
    posteriors: dict[tuple[str, ...], Posterior]
    learned_from_these: bool
    unlike_model: tuple[str, ...]
    records: list[_KeptRecord]


def key(parts: Iterable[str]) -> str:
    """Return the name under which an outcome is kept, from all that it depends on.

    `parts` are the data, the model and the database; the state of the program, its libraries and
    its plugins, and which effects and laws there are, come with it.
    """
    software = (f"{name} {version}" for name, version in versions().items())
    registered = (f"{r.kind} {n} {r.origin(n)}" for r in (EFFECTS, LAWS) for n in r.names())
    return hashlib.sha256("\n".join([*parts, *software, *registered]).encode()).hexdigest()


def load(name: str, records: Sequence[Record], folder: Path | None = None) -> Outcome | None:
    """Return the outcome of this name, None where there is none that can be read.

    `records` are the curves that were explained.
    """
    try:
        raw = (_folder(folder) / f"{name}{_SUFFIX}").read_bytes()
        digest, content = raw[:_DIGEST_BYTES], raw[_DIGEST_BYTES:]
        if hashlib.sha256(content).digest() != digest:
            return None  # damaged: a number that is off by a bit decodes as well as a right one
        kept = msgspec.msgpack.decode(content, type=_Kept, dec_hook=_array)
        chosen = [kept.candidates[i] for i in kept.explanations]
        explained = without([coarsened(r, ERRORS.coarse_hz) for r in records], kept.kept)
        explained = [k.back_to(r) for k, r in zip(kept.records, explained, strict=True)]
    except (OSError, ValueError, IndexError):  # whatever is wrong with a cache: compute again
        return None
    return Outcome(
        Verdict(kept.verdict, chosen),
        Found(
            kept.base, kept.signatures, kept.candidates, explained, kept.not_screened, kept.errors,
            tuple(kept.kept), kept.implausible,
        ),
        kept.gap_before,
        kept.gap_after,
        kept.held_out,
        kept.next_measurement,
        seed=kept.seed,
        alike=kept.alike,
        posteriors=kept.posteriors,
        trials=tuple(kept.trials),
        doubted=kept.doubted,
        kinds=kept.kinds,
        shares=kept.shares,
        error_model=kept.error_model,
        placement=kept.placement,
        repeats_um=kept.repeats_um,
        learned_from_these=kept.learned_from_these,
        unlike_model=kept.unlike_model,
    )  # fmt: skip


def save(name: str, outcome: Outcome, folder: Path | None = None) -> None:
    """Keep the outcome; where that fails, nothing is lost but time.

    What was half written when a process was killed goes.
    """
    found = outcome.found
    places = {id(candidate): i for i, candidate in enumerate(found.candidates)}
    kept = _Kept(
        outcome.verdict.name,
        [places[id(candidate)] for candidate in outcome.verdict.explanations],
        found.base,
        found.candidates,
        found.signatures,
        found.not_screened,
        found.errors,
        list(found.kept),
        found.implausible,
        list(outcome.trials),
        outcome.doubted,
        outcome.kinds,
        outcome.shares,
        outcome.error_model,
        outcome.placement,
        outcome.repeats_um,
        outcome.gap_before,
        outcome.gap_after,
        outcome.held_out,
        outcome.next_measurement,
        outcome.seed,
        outcome.alike,
        outcome.posteriors,
        outcome.learned_from_these,
        outcome.unlike_model,
        [_KeptRecord.of(r) for r in found.records],
    )
    content = msgspec.msgpack.encode(kept, enc_hook=_plain)
    raw = hashlib.sha256(content).digest() + content
    with contextlib.suppress(OSError, InputError):
        to = _folder(folder)
        make_folder(to)
        with without_leftovers(to):
            write_file(to / f"{name}{_SUFFIX}", raw, replace=True)


def _plain(value: Any) -> Any:
    """Return an array as its type, shape and bytes; a number of numpy as Python's."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "fib":
        return (value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes())
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not kept")


def _array(kind: type, plain: Any) -> Any:
    """Be the other way round. Raises ValueError for what is no array."""
    if (get_origin(kind) or kind) is not np.ndarray:
        raise ValueError(f"{kind} is not expected")
    dtype, shape, data = msgspec.convert(plain, tuple[str, tuple[int, ...], bytes])
    if np.dtype(dtype).kind not in "fib":
        raise ValueError(f"{dtype} is no type of numbers")
    return np.frombuffer(data, np.dtype(dtype)).reshape(shape)


def _folder(folder: Path | None) -> Path:
    return (
        Path(platformdirs.user_cache_dir("skinlab")) / "discrepancy" if folder is None else folder
    )
