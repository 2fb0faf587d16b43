"""A rule that every extension of a kind obeys, and what comes of trying it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from drivers.breakdown import reason
from skinlab.errors import BrokenPluginError
from skinlab.plugins import Named, Registry

T = TypeVar("T", bound=Named)

Rule = Callable[[T], None]  # raises what is wrong; its docstring says what holds


class BrokenRuleError(Exception):
    """An extension is not what its kind has to be: one sentence."""


def expect(holds: object, sentence: str) -> None:
    """Refuse what does not hold.

    Raises:
        BrokenRuleError: with the sentence.
    """
    if not holds:
        raise BrokenRuleError(sentence)


@dataclass(frozen=True)
class Kind(Generic[T]):
    """One kind of extension: where they are, the rules, and the columns of their table."""

    registry: Registry[T]
    rules: tuple[Rule[T], ...]
    head: tuple[str, ...]
    row: Callable[[T], tuple[str, ...]]

    @property
    def name(self) -> str:
        """What it is called: `law`, `effect`, ..."""
        return self.registry.kind

    def markdown(self) -> str:
        """Return the table of what is built in, as docs show it."""
        rows = [self.row(o) for o in self.registry.all() if self.registry.origin(o.name) is None]
        lines = [self.head, ("---",) * len(self.head), *rows]
        cells = ([cell.replace("|", "\\|") for cell in line] for line in lines)
        return "".join(f"| {' | '.join(line)} |\n" for line in cells).replace(" --- ", "---")


def first_line(extension: object) -> str:
    """Return what the module of an extension says first, without its full stop."""
    text = sys.modules[type(extension).__module__].__doc__ or ""
    return text.strip().partition("\n")[0].removesuffix(".")


def in_a_name(unit: str) -> str:
    """Return how a name ends with a unit: um_per_mm2 of µm/mm², per_mm of 1/mm."""
    words = (
        unit.replace("/", "_per_").removeprefix("1_").replace("%", "percent").replace("Hz", "hz")
    )
    return words.translate(str.maketrans("µ²³", "u23"))


def says(rule: Rule[Any]) -> str:
    """Return what holds where a rule is obeyed, without its full stop."""
    return (rule.__doc__ or rule.__name__).strip().splitlines()[0].removesuffix(".")


def broken(rule: Rule[T], extension: T) -> str | None:
    """Return how an extension breaks a rule; None: it obeys."""
    try:
        rule(extension)
    except (BrokenRuleError, BrokenPluginError) as error:
        return str(error)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001 -- whatever an extension raises
        return reason(error)
    return None
