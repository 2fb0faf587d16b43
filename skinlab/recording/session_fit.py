"""One answer for a whole session: its good curves, fitted together."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.recording.audit import entries
from skinlab.recording.session import Session

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Identification


def comparable(curves: Sequence[Curve], excluded: Collection[str] = ()) -> list[Curve]:
    """Return the curves of one skin in one state: whole, not excluded by name, first loadings.

    Where no curve is of a first loading, all of them are taken.
    """
    whole = [c for c in curves if not c.partial and c.name not in excluded]
    return [c for c in whole if c.setup.cycle == 1] or whole


def fit_session(identifier: Identifier, path: Path, session: Session) -> Identification:
    """Return the answer that all comparable curves of a session give together.

    Those that the operator excluded are left out.

    Raises:
        InputError: there is none.
    """
    return fit_curves(identifier, str(path), comparable(session.curves, excluded_of(session)))


def fit_curves(identifier: Identifier, name: str, curves: Sequence[Curve]) -> Identification:
    """Return the answer that curves give together.

    Raises:
        InputError: there is none.
    """
    if not curves:
        raise InputError(f"{name}: no whole curve is in it; expected at least one")
    return replace(identifier.together(curves), file=name)


def left_out_of(session: Session) -> dict[str, str]:
    """Return why curves do not count together with others, by their names.

    Because the operator excluded them, or because they were cut short, unless all others were too.
    """
    names = [curve.name for curve in session.curves]
    found = {
        name: f"who measured it said so ({why})"
        for name, why in excluded_of(session).items()
        if name in names
    }
    cut = {c.name: "it was cut short" for c in session.curves if c.partial}
    return found | cut if set(names) - {*found, *cut} else found


def excluded_of(session: Session) -> dict[str, str]:
    """Return why the operator excluded curves, by their names, from the audit trail."""
    found: dict[str, str] = {}
    for entry in entries(session.records):
        name = f"curve {entry.detail.get('curve')}"
        if entry.what == "curve excluded":
            found[name] = str(entry.detail.get("text") or "")
        elif entry.what == "curve included":
            found.pop(name, None)
    return found
