"""What the parts of the app have in common."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from textual.app import App

from skinlab.recording.advised import ADVISED
from skinlab.tui.ui_state import PLACED_KEY, Level

if TYPE_CHECKING:
    from skinlab.acquisition.messages import News
    from skinlab.acquisition.probe_session import ProbeSession
    from skinlab.acquisition.replayer import Replayer
    from skinlab.tui.screens.main import MainScreen
    from skinlab.tui.shown import Aimed
    from skinlab.tui.typing_guard import TypingGuard
    from skinlab.tui.ui_state import Board
    from skinlab.tui.widgets.fields import Fields


class PartedApp(App[None]):
    """What the parts may ask of the app that they belong to."""

    board: Board
    bench: ProbeSession | Replayer
    guard: TypingGuard
    folder: Path  # of the sessions

    @property
    def main(self) -> MainScreen:
        """The main screen, whatever lies over it."""
        raise NotImplementedError

    @property
    def fields(self) -> Fields:
        """The settings on it."""
        raise NotImplementedError

    def post(self, news: News | Aimed) -> None:
        """Hand news over to the thread that draws; from any thread."""
        raise NotImplementedError

    def perform(self, doing: str, call: Callable[[], None]) -> None:
        """Do something slow in a thread; its end is news, whichever it is."""
        raise NotImplementedError

    def audit(self, what: str, **detail: Any) -> None:
        """Record in the session what the operator did; say so where that cannot be."""
        raise NotImplementedError


class Part:
    """One thing that the app does, with the board, the probe and the screens of that app."""

    def __init__(self, app: PartedApp) -> None:
        self.app = app

    @property
    def board(self) -> Board:
        """What is known."""
        return self.app.board

    @property
    def bench(self) -> ProbeSession | Replayer:
        """The probe, or a replay in its place."""
        return self.app.bench

    @property
    def main(self) -> MainScreen:
        """The main screen, whatever lies over it."""
        return self.app.main

    @property
    def fields(self) -> Fields:
        """The settings on it."""
        return self.app.fields

    def load(self, aperture_mm: float, program: str, placements: int = 1) -> None:
        """Put a measurement into the settings; F8 shows it."""
        self.fields.put("aperture_mm", f"{aperture_mm:g}")
        self.fields.put("program", program)
        self.to_main()
        what = f"{program}, {aperture_mm:g} mm opening"
        again = ""
        if placements > 1:
            again = (
                f"; put the probe on {placements} times ({PLACED_KEY} says so, or F6 once rested)"
            )
        self.board.answer(Level.INFO, f"loaded: {what}; F8 goes on{again}")

    def note_advice(self, aperture_mm: float, program: str, because: str) -> None:
        """Record that an advised measurement was loaded, for replay and report."""
        if self.board.playing is None:
            said = {"aperture_mm": aperture_mm, "program": program, "because": because}
            self.app.audit(ADVISED, **said)

    def to_main(self) -> None:
        """Close what is open over the main screen."""
        while self.app.screen is not self.main:
            self.app.pop_screen()
