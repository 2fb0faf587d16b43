"""The first minute: what to begin with, and the five keys."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from drivers.link import PortInfo
from skinlab.tui.screens.over import ChoosingScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.hints import Hints

SIMULATED = "sim://?seed=1"
EXAMPLE = "example"

_TOUR = """\
F8     checks the settings and shows what will happen
F9     starts it
v      vents, always and at once
F3     goes to the settings and back
?      lists all keys
"""


class WelcomeScreen(ChoosingScreen):
    """Gives the URL that was chosen, or `EXAMPLE`."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("q", "app.leave", "Quit", priority=True)]

    def __init__(self, board: Board, ports: tuple[PortInfo, ...]) -> None:
        super().__init__(board)
        self._ports = ports

    def compose_box(self) -> ComposeResult:
        """Yield what there is to choose from, and the tour."""
        with Vertical(id="welcome"):
            yield Static("skinlab: measure skin with a suction probe", classes="title")
            yield OptionList(
                Option("Simulated probe: try everything, nothing can happen", id=SIMULATED),
                Option("Recorded example: watch a measurement", id=EXAMPLE),
                *(Option(f"Probe at {p.url}  {p.details}", id=p.url) for p in self._ports),
                markup=False,
            )
            if not self._ports:
                yield Static("no serial port was found on this computer", classes="hint")
            yield Static(_TOUR, id="tour", markup=False)
            yield Hints(("up, down and Enter choose", "enter"), ("q quits", "q"))
