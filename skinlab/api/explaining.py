"""The missing-effect workflow on a campaign, with the cache, and the model that it leads to."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from skinlab.api.arguments import check_workers
from skinlab.api.identifiers import find_model
from skinlab.api.paths import PathLike
from skinlab.curves.campaign import Campaign
from skinlab.curves.distinct import check_distinct, named_apart
from skinlab.curves.placement import placements_of
from skinlab.discrepancy import cache, workflow
from skinlab.discrepancy.adopt import adopted
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.records import records_of
from skinlab.errors import InputError
from skinlab.io.files import write_file
from skinlab.mechanics.model_file import Model, model_of_law
from skinlab.tables.table import Table


def base_model(model: PathLike | Model | None, table: Table) -> Model:
    """Return the model to start from: the one given, else the table's law as it is.

    Raises:
        InputError: the file cannot be read.
    """
    return find_model(model) or model_of_law(table.law)


def hashes_of(campaign: Campaign) -> dict[str, str]:
    """Return `sha256:…` of what each curve says, and of its file, by name."""
    found = {}
    for number, curve in enumerate(campaign.curves, start=1):
        columns = (curve.time_s, curve.pressure_mbar, curve.deflection_mm, curve.segment)
        arrays = [b"-" if a is None else np.ascontiguousarray(a).tobytes() for a in columns]
        text = repr((curve.name, curve.setup, str(curve.setup.program), curve.partial))
        found[f"curve {number} {curve.name}"] = _hash(text, *arrays)
        if curve.source is not None:
            found[f"file of curve {number}"] = curve.source
    return found


def _hash(text: str, *arrays: bytes) -> str:
    digest = hashlib.sha256(text.encode("utf-8", "backslashreplace"))
    for array in arrays:
        digest.update(array)
    return f"sha256:{digest.hexdigest()}"


def outcome_of(
    campaign: Campaign,
    base: Model,
    table: Table,
    *,
    workers: int | None = None,
    cached: bool = True,
    progress: Callable[[str], None] = lambda _: None,
    partial: workflow.Partial | None = None,
) -> Outcome:
    """Return what the workflow finds, from the cache where nothing has changed.

    workers: processes; None: one a core. The answer is the same for any number.

    Raises:
        InputError: the curves or the model cannot be explained.
        NotTrustworthyError: the model does not hold for them.
    """
    check_workers(workers)
    check_distinct(campaign.curves)
    placements = placements_of(campaign.curves)
    noise = campaign.noise_um, campaign.pressure_noise_mbar
    stated = repr((*noise, campaign.placement_scatter, placements))
    probes = ("" if c.probe is None else f"probe {c.probe.hash}" for c in campaign.curves)
    curves = hashes_of(campaign).values()
    learned = f"learned from these: {base.learned_from(curves)}"
    name = cache.key([base.hash, learned, table.content_hash, *curves, stated, *probes])
    campaign = replace(campaign, curves=named_apart(campaign.curves))
    known = cache.load(name, records_of(campaign)) if cached else None
    if known is not None:
        return known
    outcome = workflow.explain(
        campaign,
        table,
        model=base,
        workers=workers or os.cpu_count() or 1,
        data=curves,
        progress=progress,
        partial=workflow.Partial() if partial is None else partial,
    )
    cache.save(name, outcome)
    return outcome


def adopt(outcome: Outcome, to: Path, base: Model, table: Table, data: Mapping[str, str]) -> Model:
    """Write the model with the missing effect to a new MODEL.toml; return it.

    Raises:
        InputError: the verdict names no effect, or the file cannot be written.
    """
    if to.exists():
        raise InputError(f"{to}: exists already; expected a new file")
    now = datetime.now(UTC)
    model = adopted(base, outcome, data=data, database_hash=table.content_hash, now=now)
    write_file(to, model.to_toml())
    return model
