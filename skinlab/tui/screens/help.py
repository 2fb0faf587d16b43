"""Help: the keys, and what happens in which order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.tui.screens.over import OverScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.hints import Hints

_KEYS = """\
F8        check, connect if need be, show what will happen
F9        start what is shown; "yes"; takes an alarm away
v  Esc    vent: open the valve now, and stop
F3  Tab   the settings; Tab and Enter go round, F3 leaves
F4        lists: sites on the body, openings, programs
F6        the site has rested: count loadings from 1
Ins       the probe was put on anew, without a full rest
F2        choose a port
F5        visits: search, compare, trend
s         session: means, joint fit, compare, leave out
d         what the model misses; what to measure next
g  F7     goal of the visit; load what comes next
p         protocol of the study, where one was given
r         R0 to R9 of a step curve, and back
up down   another curve; left right: more of its row
PgUp PgDn more of the card
Ctrl+P    everything, by searching
Ctrl+T Ctrl+G  F8 and F9 for the left hand alone; Tab in lists
w  t      messages again; other colours
q Ctrl+Q  asks, then vents, saves, quits (Ctrl+C vents first)
"""

_VENTS = "vent: open the valve now, and stop"
_GIVES_UP = "give the curve up; end the suction at the instrument"

_TEXT = """\
Letters, Enter and Space only look, or vent. Suction needs F8 and then F9, with what will happen \
in view; where something was typed within a second before, F9 is asked for again. F8 means "no" \
where a question is asked.

In a field v, q, t and ? are text while nothing moves; Esc vents even then. While what will happen \
is shown, and while anything moves, the fields are closed, and v always vents.

The line on top says whether the curve is good, and the next step. Bars are 90 % intervals on the \
scale at their ends; ░ is the usual range, where a reference was given. Grey numbers \
are not final. Below the plot: both channels against time, then what the fit leaves, with \
twice the noise dotted. "last:" means that nothing is being read now.

With several repeats each follows by itself after the rest; v ends that too. A terminal may hold a \
lone Esc back for a moment: v is the sure key.

In a replay: Space pauses, the full stop steps, + and - change the speed, e goes on to the next \
event, j asks for a time, 1 to 9 and a click on the time line go there, back as well.

Whatever names a key can be clicked: the bottom line, windows, the next step, SUCTION (vents).

Loadings are counted for each site, over all sessions of this program: a later one is never taken \
for a first. F6 says that the site has fully rested. Where the probe was lifted and put on again \
without that, Ins says so: the next curve is of another placement, the count goes on.

The session file is written after each curve, and everything goes to its journal as it happens. \
Another subject or site begins another visit, with a thickness of its own; another opening goes on \
with the visit: put the other head on, type its opening, F8.

"Not fixed by this curve" means that other values fit as well: read the interval, not the number.

An alarm means: lift the probe from the skin. It stays until you press F9.
"""


class HelpScreen(OverScreen[None]):
    """Keys and order of work."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter,space,question_mark,f1,f8,q", "dismiss", "Close", priority=True),
    ]

    def __init__(self, board: Board, here: Sequence[tuple[str, str]] = ()) -> None:
        """Tell first of `here`: (key, what it does) of the screen that help was asked for on."""
        super().__init__(board)
        self._here = here

    def compose_box(self) -> ComposeResult:
        """Yield the text."""
        with VerticalScroll(id="help"):
            yield Static("skinlab: keys", classes="title", markup=False)
            yield Hints(("Enter closes", "enter"))
            if self._here:
                lines = ["On the screen that you came from, now:"]
                lines += [f"{key:<10} {what}" for key, what in self._here]
                yield Static("\n".join([*lines, ""]), id="help-here", markup=False)
            keys = _KEYS.replace(_VENTS, _GIVES_UP) if self._board.read_only else _KEYS
            yield Static(keys, markup=False)
            yield Static(_TEXT, markup=False)
