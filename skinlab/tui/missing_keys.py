"""What the keys of the screen of missing effects do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.recording.advised import MISSING_EFFECT
from skinlab.tui.part import Part
from skinlab.tui.screens.missing import MissingScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.shown import Missing
from skinlab.tui.text import adoption_lines
from skinlab.tui.ui_state import EXPLAINING, Level

if TYPE_CHECKING:
    from skinlab.discrepancy.outcome import Outcome


class MissingKeys(Part):
    """Looks for what the model misses, adopts it, loads what to measure next."""

    def show(self) -> None:
        """Open the screen; the first time, look."""
        self.app.push_screen(MissingScreen(self.board))
        if self.board.missing is None:
            self._look()

    def _look(self) -> None:
        board = self.board
        curves = [curve for curve in board.used if not curve.partial]
        if not curves:
            board.refuse("no whole curve is there to be looked at")
            return
        board.missing = Missing(tuple(curve.name for curve in curves))
        board.touch()
        self.app.perform(EXPLAINING, lambda: self.bench.analysis.explain(curves))

    def do(self, message: MissingScreen.Wanted) -> None:
        """Do what a key of the screen asks for."""
        missing = self.board.missing
        outcome = None if missing is None else missing.outcome
        match message.what:
            case "begin":
                self._look_again()
            case "cancel":
                self.bench.analysis.stop_explaining()
            case "adopt" if outcome is not None:
                self._ask_to_adopt(outcome)
            case "undo":
                self.app.perform("undoing", self.bench.analysis.undo_adoption)
            case "load" if outcome is not None and outcome.next_measurement is not None:
                following = outcome.next_measurement
                self.fields.put("repeats", "1")
                self.board.advise(following.aperture_mm, following.program)
                self.load(following.aperture_mm, following.program, following.placements)
                self.note_advice(following.aperture_mm, following.program, MISSING_EFFECT)
            case _:
                pass

    def _look_again(self) -> None:
        """Look anew, unless the same curves would give the same answer."""
        missing = self.board.missing
        curves = tuple(curve.name for curve in self.board.used if not curve.partial)
        if missing is not None and missing.outcome is not None and missing.curves == curves:
            self.board.say(Level.INFO, "these curves have been looked at: measure another one")
        else:
            self._look()

    def _ask_to_adopt(self, outcome: Outcome) -> None:
        session = Path(self.board.port) if self.board.playing else self.board.saved

        def answered(yes: bool | None) -> None:
            if yes:
                self.app.perform("adopting", lambda: self.bench.analysis.adopt(outcome, session))

        lines = adoption_lines(outcome, "model" if session is None else session.stem)
        title = "Identify with this model from now on?"
        question = ConfirmScreen(self.board, self.app.guard, title, "\n".join(lines))
        self.app.push_screen(question, answered)
