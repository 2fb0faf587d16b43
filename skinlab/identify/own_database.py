"""Identification by a database of one's own: its model, its axes, its effects' parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from skinlab.database.model_database import ModelDatabase
from skinlab.identify.identifier import Identifier
from skinlab.identify.joint import GaussianPrior
from skinlab.identify.result import Provenance
from skinlab.model_file import Model, Normal, PriorName

EVERYTHING = ("load", "hold", "unload", "rest")


@dataclass(frozen=True)
class OwnDatabaseIdentifier(Identifier):
    """The same identification; only what is said of the model differs."""

    def provenance(self) -> Provenance:
        """Return what a reader of the result must know to repeat it."""
        return replace(
            super().provenance(),
            model_name=self.model.model.name,
            model_hash=self.model.hash,
            effects=tuple(sorted(self.model.effects)),
        )


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
    given = {f.name: getattr(identifier, f.name) for f in fields(identifier)}
    phases = EVERYTHING if spec.has_history and not phases_said else identifier.phases
    return OwnDatabaseIdentifier(
        **given
        | {
            "database": database,
            "kappa": model.model.kappa,
            "space": space,
            "priors": priors,
            "model": model,
            "phases": phases,
        }
    )


def _prior(model: Model, name: str) -> PriorName | Normal | None:
    effect, _, parameter = name.rpartition(".")
    if effect:
        return model.effects[effect][parameter].prior
    own = model.parameters.get(name)
    return None if own is None else own.prior
