"""The forward problem as users state it: law, convention and effects from a model or a database."""

from __future__ import annotations

from collections.abc import Callable

from skinlab.api.identifiers import called, check_kappa, find_model, find_table
from skinlab.api.paths import PathLike
from skinlab.curves.curve import Curve, Setup
from skinlab.errors import InputError
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.materials import DEFAULT_LAW, get_law
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_file import Model
from skinlab.tables.forward import simulate, simulate_from
from skinlab.tables.table import Table


def simulated(
    setup: Setup,
    values_of: Callable[[str], tuple[float, ...]],
    *,
    law: str | None = None,
    kappa: KappaConvention | None = None,
    rate_hz: float = 20.0,
    direct: bool = False,
    model: PathLike | Model | None = None,
    database: PathLike | Table | None = None,
) -> tuple[Curve, str | None]:
    """Return the simulated curve, and a warning where it creases or had to end early.

    `values_of` gives the parameters' values, in the order of the law whose name it gets. law,
    kappa: None: those of the model, else of the database, else the default.

    Raises:
        InputError: a value is out of its range, or two statements contradict each other.
        NotTrustworthyError: the model does not hold even for the first samples.
    """
    if database is not None and direct:
        raise InputError("a database answers, or the finite elements directly: not both")
    table = None if database is None else find_table(database)
    check_kappa(kappa)
    asked = find_model(model)
    effects = {}
    if asked is not None:
        where = called(model, "the model")
        check_kappa(kappa, asked, where)
        if law not in (None, asked.model.law):
            raise InputError(f"{where}: law is {asked.model.law!r}, and {law!r} was asked for")
        law, kappa, effects = asked.model.law, asked.model.kappa, asked.values
    if table is not None:
        law = table.law if law is None else law
        if kappa is None and table.spec.model is not None:
            kappa = table.spec.model.model.kappa
    law = DEFAULT_LAW if law is None else law
    get_law(law)
    skin = Skin(values_of(law), "paper" if kappa is None else kappa, law)
    if table is not None:
        return simulate_from(table, skin, effects, setup, rate_hz)
    return simulate(skin, setup, rate_hz, direct=direct, effects=effects)
