"""Whether the two effects of a pair nearly cancel: then they imitate something else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.candidates import Candidate
from skinlab.discrepancy.discipline import Trial
from skinlab.discrepancy.fit import Fitter
from skinlab.discrepancy.settings import NAMES
from skinlab.mechanics.fem.suction import SCREENING_MESH

Array = NDArray[np.float64]


def against_cancelling(fitter: Fitter, base: Candidate, best: Candidate) -> Trial | None:
    """Return whether two effects do more together than a little of what one does alone.

    Sizes are counted by the errors, what the law's parameters absorb taken out. Two effects that
    have nothing to do with one another cancel by chance alone; what a library lacks is imitated by
    differences of what it has (docs/decisions/0141-two-that-cancel.md). None where fewer were
    added, or where a model does not hold with one of them alone.
    """
    own = base.effects
    added = [name for name in best.effects if name not in own]
    if len(added) < 2:
        return None
    parts: list[list[str]] = [[], *([name] for name in added), added]
    curves = [_curves_mm(fitter, best, [*own, *each]) for each in parts]
    found = [one for one in curves if one is not None]
    if len(found) < len(curves):
        return None
    without, *others = found
    changes = fitter.errors.whiten(np.column_stack(others) - without[:, None])
    absorbed = np.linalg.qr(best.fit.jacobian[:, : best.fit.unknowns.count])[0]
    changes -= absorbed @ (absorbed.T @ changes)
    *alone, together = np.linalg.norm(changes, axis=0)
    share = float(together / max(*alone, 1e-12))
    passed = share >= NAMES.cancelling
    return Trial(
        "cancelling",
        passed,
        "the effects do not cancel one another"
        if passed
        else f"the effects cancel one another: both do {100 * share:.0f} % of what one does alone",
    )


def _curves_mm(fitter: Fitter, best: Candidate, effects: Sequence[str]) -> Array | None:
    """Return the curves (n,) at an explanation's unknowns with some of its effects alone."""
    unknowns = replace(best.fit.unknowns, effects=tuple(effects))
    u = unknowns.among(best.fit.unknowns, best.fit.u)
    model = fitter.model(unknowns, SCREENING_MESH)
    if not fitter.prepare(model, u, memory=False):
        return None
    found = np.concatenate(model.predict(u))
    return found if np.isfinite(found).all() else None
