"""The whole: compute everything that the parts need, then make the parts."""

from __future__ import annotations

from collections.abc import Callable

from skinlab.reproduction import blind_test, many_curves, principle, stand_in, tables
from skinlab.reproduction.jobs import execute
from skinlab.reproduction.part import Part, Table
from skinlab.reproduction.study import Study

# In the order of the paper.
ORDER = (
    "figure_4a", "figure_6", "table_1", "figure_7", "figure_8a", "figure_8b", "table_2",
    "figure_9", "figure_10", "figure_11", "figure_12", "figure_13", "valley",
)  # fmt: skip
_GROUPS = (principle, tables, blind_test, stand_in, many_curves)


def reproduce(
    study: Study, workers: int = 1, progress: Callable[[float], None] = lambda _: None
) -> tuple[list[Part], Table]:
    """Return the parts in the paper's order, and the times; only these depend on the machine.

    `progress` is told of each job's share of the work, as it is done.

    Raises:
        SkinlabError: a worker process died.
    """
    todo = [job for group in _GROUPS for job in group.jobs(study)]
    results = execute(todo, workers, progress)
    made = {part.name: part for group in _GROUPS for part in group.parts(study, results)}
    return [made[name] for name in ORDER], tables.times(study, results)
