"""Help: the keys, and what happens in which order."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

_KEYS = """\
Enter      check the settings, connect if need be, arm
Space      start the armed program
v  Esc     vent: open the valve now, and stop
F3  Tab    the settings, next field; F3 or Esc leaves them
F2         choose a port
s          session: means, joint fit, compare, exclude, notes, undo
d          what the model misses in these curves; what to measure next
up  down   look at another curve (Tab to the list)
t          light or dark
?  F1      this help
q  Ctrl+Q  vent, save the session, quit
"""

_TEXT = """\
In a field v, q, t and ? are text while nothing is armed; Esc vents even then. While armed or \
running the fields are closed, and v always vents.

Bars: stiffness from a third of the value to three times it, nu from 0.2 to 0.5. Grey numbers are \
not final. Below the plot: both channels against time, then what the fit leaves, with twice the \
noise dotted.

With several repeats each follows by itself after the rest; v ends that too. A terminal may hold a \
lone Esc back for a moment: v is the sure key.

In a replay: Space pauses, the full stop steps, + and - change the speed.

The session file is written after each curve, and everything goes to its journal as it happens. \
Another subject or site begins another session; another opening goes on with it: put the other \
head on, type its opening, Enter.

"Not fixed by this curve" means that other values fit as well: read the interval, not the number.

An alarm means: lift the probe from the skin. It stays until you press a.
"""


class HelpScreen(ModalScreen[None]):
    """Keys and order of work."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter,space,question_mark,f1,q", "dismiss", "Close", priority=True),
    ]

    def compose(self) -> ComposeResult:
        """Yield the text."""
        with VerticalScroll(id="help"):
            yield Static("skinlab: keys (Enter closes)", classes="title", markup=False)
            yield Static(_KEYS, markup=False)
            yield Static(_TEXT, markup=False)
