"""What can be picked instead of typed: openings, programs by name, sites with their place."""

from __future__ import annotations

from dataclasses import dataclass

from skinlab.curves.apertures import APERTURES_MM

PROGRAMS = (
    ("Standard ramp, 100 mbar in 5 s", "ramp:100@20"),
    ("Standard ramp up and down, 100 mbar in 5 s", "ramp:100@20,ramp:0@20"),
    ("High ramp, 300 mbar in 5 s (narrows X2)", "ramp:300@60"),
    ("Slow ramp, 100 mbar in 10 s", "ramp:100@10"),
    ("Ramp, hold 5 s, and down (creep)", "ramp:100@50,hold:5,ramp:0@50"),
    ("Step, 300 mbar, 2 s on, 2 s off (R0 to R9)", "mode1:300,2,2"),
    ("Three steps, 300 mbar, 2 s on, 2 s off (R3, R4, R9 too)", "mode1:300,2,2,3"),
)


@dataclass(frozen=True)
class Site:
    """A place on the body: its name, and where the map shows it (column, row)."""

    name: str
    column: int
    row: int


# Seen from the front, and from the back at the right; the person's left is at the right in front.
BODY = r"""
     .-.            .-.
    ( o )          (   )
     '-'            '-'
   .-' '-.        .-' '-.
  /|     |\      /|     |\
 / |     | \    / |     | \
 | |     | |    | |     | |
 | |     | |    | |     | |
 ' |--.--| '    ' |--.--| '
   |  |  |        |  |  |
   |  |  |        |  |  |
   |  |  |        |  |  |
   |  |  |        |  |  |
   '--'--'        '--'--'
    front          back
""".strip("\n")

SITES = (
    Site("forehead", 6, 0),
    Site("cheek, right", 5, 1),
    Site("cheek, left", 7, 1),
    Site("neck", 6, 2),
    Site("chest", 6, 4),
    Site("abdomen", 6, 6),
    Site("upper arm, right", 2, 5),
    Site("upper arm, left", 10, 5),
    Site("forearm, volar, right", 1, 6),
    Site("forearm, volar, left", 11, 6),
    Site("hand, palm, right", 1, 8),
    Site("hand, palm, left", 11, 8),
    Site("thigh, right", 4, 9),
    Site("thigh, left", 8, 9),
    Site("lower leg, right", 4, 12),
    Site("lower leg, left", 8, 12),
    Site("upper back", 21, 4),
    Site("lower back", 21, 7),
    Site("forearm, dorsal, left", 16, 6),
    Site("forearm, dorsal, right", 26, 6),
    Site("hand, back, left", 16, 8),
    Site("hand, back, right", 26, 8),
    Site("calf, left", 19, 12),
    Site("calf, right", 23, 12),
)


def choices_for(field: str) -> list[tuple[str, str]]:
    """Return (text for the field, what it is) of a field that has a list."""
    match field:
        case "aperture_mm":
            return [(f"{a:g}", f"{a:g} mm opening") for a in APERTURES_MM]
        case "program":
            return [(program, name) for name, program in PROGRAMS]
        case "site":
            return [(site.name, site.name) for site in SITES]
        case _:
            return []


def body_map(name: str) -> str:
    """Return the body with a mark at the site of this name."""
    rows = [list(line) for line in BODY.splitlines()]
    for site in SITES:
        if site.name == name:
            row = rows[site.row]
            row += " " * (site.column + 1 - len(row))
            row[site.column] = "●"
    return "\n".join("".join(row) for row in rows)


def nearest_site(column: int, row: int) -> Site:
    """Return the site that is nearest to a place of the map; rows are twice as high as wide."""
    return min(SITES, key=lambda s: (s.column - column) ** 2 + 4 * (s.row - row) ** 2)
