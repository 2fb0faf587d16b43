"""A law whose energy is the sum of others'."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from skinlab.mechanics.materials.base import Array, Law, Potential


@dataclass(frozen=True)
class Total:
    """The sum of laws whose parameters have different names."""

    parts: tuple[Law, ...]

    @property
    def name(self) -> str:
        """Names of the parts."""
        return " + ".join(part.name for part in self.parts)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Parameters of all parts, in their order."""
        return tuple(dict.fromkeys(name for part in self.parts for name in part.parameter_names))

    @property
    def source(self) -> str:
        """Sources of the parts."""
        return "; ".join(part.source for part in self.parts)

    def potential(self, i1: Array, i2: Array, j: Array, parameters: Mapping[str, Any]) -> Potential:
        """Return energy and derivatives, each the sum of the parts'."""
        each = [part.potential(i1, i2, j, parameters) for part in self.parts]
        return Potential(*(sum(getattr(p, f.name) for p in each) for f in fields(Potential)))
