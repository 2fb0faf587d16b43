"""What the keys of the session do, and the goal of the visit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from skinlab.errors import InputError, SkinlabError
from skinlab.mechanics.materials import get_law
from skinlab.recording.curve_selection import Deed
from skinlab.recording.session_fit import comparable
from skinlab.recording.visit_index import visit_before
from skinlab.tui.goal import ChangeGoal, change_distance, choices, distance
from skinlab.tui.part import Part
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.shown import Aimed
from skinlab.tui.text import undone_words
from skinlab.tui.ui_state import Level

if TYPE_CHECKING:
    from skinlab.curves.curve import Curve
    from skinlab.inference.identify import Identifier
    from skinlab.tui.screens.session import SessionScreen


class SessionKeys(Part):
    """Decisions, joint fits, comparisons, and how far the visit is from its goal."""

    def decide(self, message: SessionScreen.Decided) -> None:
        """Record what the operator decided, or took back."""
        deed = message.deed
        what = f"undone: {deed.what}" if message.undone else deed.what
        # What is undone is put right in the trail as well, whoever reads it
        if message.undone and deed.curve is not None:
            back = self.board.ledger.excluded.get(deed.curve)
            what = "curve included" if back is None else "curve excluded"
            deed = Deed(what, deed.curve, back or "")
        try:
            self.bench.audit(what, curve=deed.curve, text=deed.text)
        except SkinlabError as error:
            if self.board.playing is None:  # else it holds for this replay
                self._take_back(message)
            self.board.refuse(str(error))
        else:
            # More than a note: not to be covered by "saved"
            level = Level.WARNING if message.undone else Level.INFO
            undone = f"undone: {undone_words(message.deed)}"
            self.board.answer(level, undone if message.undone else f"recorded: {what}")

    def _take_back(self, message: SessionScreen.Decided) -> None:
        """Undo what could not be recorded: it would hold on this screen and nowhere else."""
        if message.undone:
            self.board.ledger.redo(message.deed)
        else:
            self.board.ledger.undo()

    def do(self, message: SessionScreen.Wanted) -> None:
        """Begin a joint fit or a comparison."""
        board = self.board
        curves = comparable(board.used)
        if not curves:
            board.refuse("no whole curve is there to be fitted")
        elif message.what == "joint":
            self.app.perform("fitting", lambda: self.bench.analysis.fit_together(curves))
        else:
            typed = message.path
            self.app.perform("comparing", lambda: self._compare(typed, curves))

    def _compare(self, typed: str, curves: Sequence[Curve]) -> None:
        """Post whether the skin changed since another session, or the visit before; slow."""
        from skinlab.tui.comparing import compare_with

        path = self.app.folder / Path(typed).expanduser() if typed else self._before()
        if path is None:
            raise InputError("there is no earlier visit of this subject and site here")
        board = self.board
        self.app.post(compare_with(path, *self._known(curves), board.study, board.visit))

    def _known(self, curves: Sequence[Curve]) -> tuple[list[Curve], Identifier, str]:
        """Return those that are identified, by what, and by which probe."""
        board = self.board
        found = {e.curve.name for e in board.entries.values() if e.result is not None}
        serial = "" if board.hello is None else board.hello.serial_number
        identifier = self.bench.analysis.identifier
        return [curve for curve in curves if curve.name in found], identifier, serial

    def _before(self) -> Path | None:
        """Return the last visit of the same subject and site before the open one."""
        board = self.board
        return visit_before(self.app.folder, board.visit, board.path, simulated=board.simulated)

    def choose_goal(self) -> None:
        """Offer what a visit can aim at."""
        law = self.bench.analysis.law
        if law is None:
            self.board.answer(Level.INFO, "still preparing: g again in a moment")
            return
        offered = {goal.words: goal for goal in choices(get_law(law))}

        def chosen(text: str | None) -> None:
            if text is None:
                return
            self.board.goal = offered.get(text)
            self.board.goal_is = None
            self.board.touch()
            self.aim()

        lines = [(words, words) for words in ("no goal", *offered)]
        self.app.push_screen(PickScreen(self.board, "Goal of this visit", lines), chosen)

    def aim(self) -> None:
        """Find out beside how far the visit is from its goal."""
        board, goal = self.board, self.board.goal
        curves = comparable(board.used)
        if goal is None or not curves or board.playing is not None:
            return
        known = self._known(curves)

        def work() -> None:
            if not isinstance(goal, ChangeGoal):
                self.app.post(Aimed(distance(goal, curves, known[1])))
                return
            self.app.post(Aimed(change_distance(goal, self._before(), *known, board.study)))

        self.app.perform("aiming", work)

    def load_advice(self) -> None:
        """Put into the fields what would narrow the goal's interval most."""
        found = self.board.goal_is
        if found is None or found.following is None:
            self.board.answer(Level.INFO, "no measurement is suggested (g sets a goal)")
            return
        following = found.following
        self.load(following.aperture_mm, following.program)
        self.note_advice(following.aperture_mm, following.program, found.goal.words)
