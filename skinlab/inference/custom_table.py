"""Identification by a database of one's own: its model, its axes, its effects' parameters."""

from __future__ import annotations

from dataclasses import replace

from skinlab.inference.identify import Identifier
from skinlab.inference.joint import GaussianPrior
from skinlab.inference.samples import EVERYTHING
from skinlab.mechanics.model_file import Model, Normal, PriorName
from skinlab.tables.model_database import ModelDatabase


def with_own_database(
    identifier: Identifier, database: ModelDatabase, *, phases_said: bool
) -> Identifier:
    """Return the identifier with this database, its model, and its model's priors.

    Where the model has effects of rate or cycle everything is fitted, unless the phases were said.
    """
    spec, space = database.spec, database.space
    model = spec.model
    priors = tuple(
        GaussianPrior(i, prior.mean, prior.sd)
        for i, name in enumerate(space.names)
        if isinstance(prior := _prior(model, name), Normal)
    )
    phases = EVERYTHING if spec.has_history and not phases_said else identifier.phases
    return replace(
        identifier,
        database=database,
        kappa=model.model.kappa,
        space=space,
        priors=priors,
        model=model,
        phases=phases,
    )


def _prior(model: Model, name: str) -> PriorName | Normal | None:
    effect, _, parameter = name.rpartition(".")
    if effect:
        return model.effects[effect][parameter].prior
    own = model.parameters.get(name)
    return None if own is None else own.prior
