"""From a verdict to a model that others take: MODEL.toml with the effect that was missing."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

from skinlab.discrepancy.outcome import Outcome
from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import SOLVER_VERSION
from skinlab.mechanics.model_file import (
    EffectRange,
    Header,
    Model,
    Normal,
    Provenance,
    Range,
)
from skinlab.mechanics.model_plugins import plugins_of
from skinlab.versions import __version__

ADOPTED = 0.1  # of its size an effect differs at least: stiffness does by 6 to 12 % from day to day


def adopted(
    base: Model,
    outcome: Outcome,
    *,
    data: Mapping[str, str],
    database_hash: str,
    now: datetime,
) -> Model:
    """Return the base model with what was missing: values, priors as wide as they are sure.

    `data` are hashes by file; those that the base model was learned from are kept beside them.

    Raises:
        InputError: the verdict names no effect.
    """
    if not outcome.verdict.explains:
        raise InputError(f"the verdict is {outcome.verdict.name}: there is nothing to adopt")
    explanation = outcome.posteriors[outcome.best.effects]
    effects: dict[str, dict[str, EffectRange]] = {}
    unknowns = explanation.unknowns
    best, deviations = (x[unknowns.count :] for x in (explanation.best, explanation.deviations))
    stated = {(k.effect, k.parameter) for k in unknowns.known if k.stated}
    for axis, u, deviation in zip(unknowns.axes, best, deviations, strict=True):
        if (axis.effect, axis.parameter.name) in stated:
            continue  # the thickness' uncertainty is that of these data, not of the model
        value = axis.to_value(float(u))
        # Another site of the same kind of skin is not the same to a thousandth.
        size = abs(value - (axis.parameter.zero or 0.0))
        sd = max(abs(axis.slope(float(u))) * float(deviation), ADOPTED * size, 1e-9)
        effects.setdefault(axis.effect, {})[axis.parameter.name] = EffectRange(
            value, axis.parameter.low, axis.parameter.high, Normal(value, sd)
        )
    for name, ranges in base.effects.items():
        for parameter, at in ranges.items():
            effects.setdefault(name, {}).setdefault(parameter, at)
    for known in unknowns.known:
        if known.effect in effects and not known.stated:  # what is fixed: a function's range
            effects[known.effect].setdefault(known.parameter, EffectRange(known.value))
    names = " and ".join(sorted(set(effects) - set(base.effects)))
    versions = {"skinlab": __version__, "solver": SOLVER_VERSION, "database": database_hash}
    return Model(
        Header(f"{base.model.name} with {names}", base.model.law, base.model.kappa),
        dict(base.parameters) or _law_ranges(base),
        effects,
        Provenance(
            _all_data(base, data),
            versions | plugins_of(base.model.law, effects),
            outcome.verdict.name,
            now.astimezone(UTC).date().isoformat(),
            base.hash,
        ),
    )


def _all_data(base: Model, data: Mapping[str, str]) -> dict[str, str]:
    """Return hashes by file of these data, and of those that the base model's effects are from."""
    found = dict(data)
    for file, content in base.provenance.data.items():
        if content not in found.values():
            name = file
            while name in found:  # another file of the same name
                name = f"earlier {name}"
            found[name] = content
    return found


def _law_ranges(base: Model) -> dict[str, Range]:
    """Return where the law's parameters were looked for."""
    space = base.space
    low, high = space.bounds
    return {
        name: Range(float(low[i]), float(high[i]), "uniform" if kind == "linear" else "log-uniform")
        for i, (name, kind) in enumerate(zip(space.names, space.transforms, strict=True))
    }
