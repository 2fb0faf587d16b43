"""One file to the rows of its curves. Runs in any process; the same bits wherever it runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.cutometer import step_numbers
from skinlab.errors import InputError, SkinlabError
from skinlab.exchange.importing.questions import Answers
from skinlab.exchange.importing.reader import MOST_BYTES, read_any
from skinlab.inference.batch import judged, with_stated_noise
from skinlab.inference.identify import Identifier
from skinlab.inference.result import Identification
from skinlab.io.log import log_exception
from skinlab.recording.labels import labels_of
from skinlab.recording.load_inputs import NONE_LEFT
from skinlab.recording.session import Session, read_session, stated_noise
from skinlab.recording.session_fit import excluded_of
from skinlab.recording.session_names import is_session_name
from skinlab.recording.stream import setup_to_json
from skinlab.studies.copies import readings_hash
from skinlab.studies.facts import PARTIAL, Facts, setup_of
from skinlab.studies.settings import PRIORS
from skinlab.studies.sources import sha256_of

Array = NDArray[np.float64]

SESSION_NOISE = "noise as the session states it"  # answers that knew less are computed again


@dataclass(frozen=True)
class Task:
    """A file to compute; `facts` are what is known of it beforehand."""

    number: int
    path: Path
    facts: Facts


@dataclass(frozen=True)
class Row:
    """One curve: what is known of it as JSON, and its draws (n, p) as float32 bytes."""

    text: str
    draws: bytes


@dataclass(frozen=True)
class Computed:
    """What became of a file: its rows, or why there are none.

    `again`: not the file's fault, so that the next run tries again.
    """

    number: int
    sha256: str
    rows: tuple[Row, ...]
    error: str | None = None
    again: bool = False


def compute(identifier: Identifier, tasks: Sequence[Task]) -> list[Computed]:
    """Return what each file gives; whatever is wrong with one of them, the others are computed."""
    return [_computed(identifier, task) for task in tasks]


def _computed(identifier: Identifier, task: Task) -> Computed:
    digest = ""
    try:
        digest = sha256_of(task.path)
        return Computed(task.number, digest, tuple(_rows(identifier, task)))
    except SkinlabError as error:
        return Computed(task.number, digest, (), str(error))
    except OSError as error:
        return Computed(task.number, digest, (), f"{task.path}: {error.strerror or error}")
    except Exception as error:  # noqa: BLE001 -- one file never stops the rest; the log has details
        where = log_exception(error)
        reason = f"{task.path}: internal error ({type(error).__name__}: {error}); see {where}"
        return Computed(task.number, digest, (), reason, again=True)


def _rows(identifier: Identifier, task: Task) -> list[Row]:
    path, facts = task.path, task.facts
    if is_session_name(path):
        session = read_session(path)
        known = labels_of(session)
        knowing = with_stated_noise(identifier, *noise_of(facts, session))
        return [_row(knowing, one, known | _placement(one)) for one in _used(path, session)]
    (curve,), noise = curves_and_noise(path, facts)
    return [_row(with_stated_noise(identifier, *noise), curve, {})]


def noise_of(facts: Facts, session: Session | None = None) -> tuple[float | None, float | None]:
    """Return the stated noise of a file, µm and mbar: a table's comes first, then the session's.

    Raises:
        InputError: what the session says of it is damaged.
    """
    own = (None, None) if session is None else stated_noise(session.meta)
    return facts.get("noise_um", own[0]), facts.get("pressure_noise_mbar", own[1])


def curves_and_noise(
    path: Path, facts: Facts
) -> tuple[list[Curve], tuple[float | None, float | None]]:
    """Return the curves of a file, and the stated noise (µm, mbar), given what is known of it.

    Raises:
        InputError: it cannot be read, or too little is known of it.
    """
    if is_session_name(path):
        session = read_session(path)
        return _used(path, session), noise_of(facts, session)
    return [_curve_of(path, facts)], noise_of(facts)


def _used(path: Path, session: Session) -> list[Curve]:
    out = excluded_of(session)
    used = [curve for curve in session.curves if curve.name not in out]
    if session.curves and not used:
        raise InputError(f"{path}: {NONE_LEFT}")
    return used


def _curve_of(path: Path, facts: Facts) -> Curve:
    try:
        setup = setup_of(facts)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: larger than {MOST_BYTES >> 20} MB; expected one curve")
    curve = read_any(path, setup, Answers(command="skinlab import"))
    return replace(curve, name=path.name, partial=facts.get(PARTIAL) == "true")


def _placement(curve: Curve) -> dict[str, Any]:
    stated = curve.setup.placement
    return {} if stated is None else {"placement": stated}


def _row(identifier: Identifier, curve: Curve, known: dict[str, Any]) -> Row:
    result = judged(identifier, curve)
    answer = result.to_json()
    for name in ("file", "seconds"):  # the first is the table's, the second differs every time
        answer.pop(name, None)
    said = {
        "curve": curve.name,
        "partial": curve.partial,
        "setup": setup_to_json(curve.setup),
        "known": known,
        "result": answer,
        "step": _step(curve),
        "readings": readings_hash(curve),
    }
    return Row(json.dumps(said, allow_nan=False), draws_of(result).astype("<f4").tobytes())


def _step(curve: Curve) -> dict[str, float]:
    """Return the Cutometer's own numbers of a step curve; nothing for any other."""
    try:
        found = step_numbers(curve)
    except (InputError, IndexError, ValueError):
        return {}
    return {
        name: float(number.value)
        for name, number in found.numbers.items()
        if number.value is not None and np.isfinite(number.value)
    }


def draws_of(result: Identification, count: int = PRIORS.draws) -> Array:
    """Return equally weighted draws (count, p) of a curve's posterior, its parameters in order.

    The one place that knows how an identification keeps its draws. (0, 0) where it has none. Same
    answer, same draws: they are taken at even steps of the weight along the first parameter.
    """
    left = result.uncertainty
    if left is None or not result.parameters:
        return np.zeros((0, 0))
    parameters, weight = left.draws.parameters, left.draws.weight
    order = np.argsort(parameters[:, 0], kind="stable")
    share = np.cumsum(weight[order])
    at = (np.arange(count) + 0.5) / count * share[-1]
    chosen = order[np.minimum(np.searchsorted(share, at), len(order) - 1)]
    return np.asarray(parameters[chosen, : len(result.parameters)])
