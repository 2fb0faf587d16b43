"""A study's protocol: its steps into the settings, what was otherwise into the session."""

from __future__ import annotations

from collections.abc import Sequence

from skinlab.tui.part import Part, PartedApp
from skinlab.tui.ui_state import Level


class ProtocolSteps(Part):
    """Walks through the protocol; without one it does nothing."""

    def __init__(self, app: PartedApp) -> None:
        super().__init__(app)
        self._otherwise: list[str] = []  # than the protocol says, to be recorded

    def go_to_step(self) -> None:
        """Load the next step, and show the settings."""
        self.to_main()
        if not self.load_step():
            self.board.answer(Level.INFO, "all steps of the protocol are done")

    def state_conditions(self) -> None:
        """Record the conditions that were stated, once there is a session of this subject."""
        board = self.board
        if board.path is not None and board.visit == board.who:
            self.app.audit("conditions", **board.stated)

    def load_step(self) -> bool:
        """Put the next step of the protocol into the fields; False: there is none."""
        board = self.board
        named, walk = board.protocol, board.walk
        if named is None or walk is None:
            return False
        sites = named.protocol.study.sites
        state = walk.next
        site = board.who[1]
        if sites and (state is None or site not in sites):
            left = [s for s in sites if not board.site_done(s) and s != site]
            if left:  # another visit begins there, with the first step
                self.fields.put("site", left[0])
                self.fields.follow()
                board.name(self.fields.who)
                walk = board.walk
                state = None if walk is None else walk.next
        if state is None:
            return False
        step = state.step
        self.fields.put("aperture_mm", f"{step.aperture_mm:g}")
        self.fields.put("program", step.program)
        self.fields.put("repeats", str(state.left))
        self.fields.put("rest_s", f"{step.rest_s:g}")
        board.answer(Level.INFO, f"loaded: {walk.words if walk else ''}; F8 shows it")
        return True

    def record(self) -> None:
        """Write what is demanded, and under which conditions it begins, into the new session."""
        named = self.board.protocol
        if named is None:
            return
        from skinlab.report.protocol import protocol_trail

        for what, detail in protocol_trail(named, self.board.stated):
            self.app.audit(what, **detail)
        self._record_otherwise()

    def note(self, otherwise: Sequence[str], *, begun: bool) -> None:
        """Record what is otherwise than the protocol says; `begun`: there is a session for it."""
        self._otherwise = list(otherwise)
        if begun:
            self._record_otherwise()

    def _record_otherwise(self) -> None:
        from skinlab.report.protocol import DEVIATION

        clauses, self._otherwise = self._otherwise, []
        for clause in clauses:
            self.app.audit(DEVIATION, text=clause)
