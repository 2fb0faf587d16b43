"""Which curves of a session were measured as was advised: its audit trail says what was loaded."""

from __future__ import annotations

from skinlab.curves.curve import Setup
from skinlab.curves.program import Program, parse_program
from skinlab.errors import InputError
from skinlab.recording.audit import entries
from skinlab.recording.session import Session
from skinlab.recording.stream import setup_from_json

ADVISED = "measurement advised"  # detail: aperture_mm, program, because
MISSING_EFFECT = "missing effect"  # because the search for it advised; else a goal, in its words


def advised_curves(session: Session) -> dict[str, str]:
    """Return why curves were measured, by their names, where it was advised and loaded.

    Those are of the opening and the program, and begun behind it.
    """
    loaded: dict[tuple[float, Program], str] = {}
    found: dict[str, str] = {}
    for entry in entries(session.records):
        try:
            if entry.what == ADVISED:
                said = entry.detail
                program = parse_program(str(said["program"]))
                loaded[float(said["aperture_mm"]), program] = str(said["because"])
            elif entry.what == "run started" and (because := _why(entry.detail["setup"], loaded)):
                found[f"curve {entry.detail['curve']}"] = because
        except (InputError, LookupError, TypeError, ValueError):  # a damaged entry says nothing
            continue
    return found


def _why(said: dict[str, object], loaded: dict[tuple[float, Program], str]) -> str | None:
    setup: Setup = setup_from_json(said)
    if setup.program is None:
        return None
    return loaded.get((setup.aperture_mm, setup.program))
