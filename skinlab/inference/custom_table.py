"""Identification by a custom table: its model, its axes, its effects' parameters."""

from __future__ import annotations

from dataclasses import replace

from skinlab.inference.identify import Identifier
from skinlab.inference.joint import GaussianPrior
from skinlab.inference.samples import EVERYTHING
from skinlab.tables.table import Table


def with_custom_table(identifier: Identifier, database: Table, *, phases_said: bool) -> Identifier:
    """Return the identifier with this table of a model (`Spec.model`), and the model's priors.

    Where the model has effects of rate or cycle everything is fitted, unless the phases were said.
    """
    model = database.spec.model
    assert model is not None
    space = database.spec.space(database, model.model.kappa)
    priors = tuple(GaussianPrior(*known) for known in model.normal_priors(space))
    phases = EVERYTHING if model.needs_history and not phases_said else identifier.phases
    return replace(
        identifier,
        database=database,
        kappa=model.model.kappa,
        space=space,
        priors=priors,
        model=model,
        phases=phases,
    )
