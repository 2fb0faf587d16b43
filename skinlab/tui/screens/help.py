"""Help: the keys, and what happens in which order."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from skinlab.tui.screens.over import OverScreen

_KEYS = """\
F8         check the settings, connect if need be, show what will happen
F9         start what is shown; also "yes" to a question, and takes an alarm away
v  Esc     vent: open the valve now, and stop
F3  Tab    the settings; there Tab and Enter go round; F3 or Esc leaves them
F2         choose a port
s          session: means, joint fit, compare, leave out (Del), notes, undo (Ctrl+Z)
d          what the model misses in these curves; what to measure next
up  down   look at another curve
t          light or dark
?  F1      this help
q  Ctrl+Q  asks, then vents, saves the session, quits (Ctrl+C vents first)
"""

_TEXT = """\
Letters, Enter and Space only look, or vent. Suction needs F8 and then F9, with what will happen \
in view; where something was typed within a second before, F9 is asked for again. F8 means "no" \
where a question is asked.

In a field v, q, t and ? are text while nothing moves; Esc vents even then. While what will happen \
is shown, and while anything moves, the fields are closed, and v always vents.

Bars: stiffness from a third of the value to three times it, nu from 0.2 to 0.5. Grey numbers are \
not final. Below the plot: both channels against time, then what the fit leaves, with twice the \
noise dotted. "last:" means that nothing is being read now.

With several repeats each follows by itself after the rest; v ends that too. A terminal may hold a \
lone Esc back for a moment: v is the sure key.

In a replay: Space pauses, the full stop steps, + and - change the speed.

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

    def compose_box(self) -> ComposeResult:
        """Yield the text."""
        with VerticalScroll(id="help"):
            yield Static("skinlab: keys (Enter closes)", classes="title", markup=False)
            yield Static(_KEYS, markup=False)
            yield Static(_TEXT, markup=False)
