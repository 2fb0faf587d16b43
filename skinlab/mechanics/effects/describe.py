"""The effects as a table: what docs/effects.md shows.

`python -m skinlab.mechanics.effects.describe` makes it.
"""

from __future__ import annotations

import sys

from skinlab.mechanics.effects.base import Effect, Parameter
from skinlab.mechanics.effects.registry import all_effects

HEADER = "| name | what it is | definition | acts on | parameters: bounds, zero, typical | source |"


def markdown() -> str:
    """Return the table of all effects, one row each, from what they declare."""
    rows = [HEADER, "|---|---|---|---|---|---|", *(_row(effect) for effect in all_effects())]
    return "\n".join(rows) + "\n"


def _row(effect: Effect) -> str:
    acts_on = "the skin" if effect.physical else "the record"
    parameters = "<br>".join(_parameter(p) for p in effect.parameters)
    sources = "; ".join(dict.fromkeys([effect.source, *(p.source for p in effect.parameters)]))
    cells = (f"`{effect.name}`", effect.meaning, effect.formula, acts_on, parameters, sources)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _parameter(p: Parameter) -> str:
    unit = f" {p.unit}" if p.unit else ""
    zero = "no zero" if p.zero is None else f"zero {p.zero:g}"
    optional = "" if p.default is None else f", {p.default:g} where it is not given"
    return (
        f"`{p.name}` {p.meaning}: {p.low:g} to {p.high:g}{unit}, {zero}, "
        f"typical {p.typical:g}{optional}"
    )


if __name__ == "__main__":
    sys.stdout.write(markdown())
