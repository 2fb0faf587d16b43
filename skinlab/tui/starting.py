"""From the settings to a start: what F8 shows and F9 does, and the connection that it needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from textual.widgets import Input

from drivers.events import InstrumentState
from skinlab.acquisition.measurement_request import Order, check_limits, read_order, with_opening
from skinlab.acquisition.messages import Connected
from skinlab.acquisition.settings import remember
from skinlab.errors import InputError
from skinlab.recording.dose import loaded_before
from skinlab.tui.part import Part, PartedApp
from skinlab.tui.protocol_check import against_protocol
from skinlab.tui.protocol_steps import ProtocolSteps
from skinlab.tui.shown import Review
from skinlab.tui.ui_state import MEASURING, WHOSE, Board, Level


class Starting(Part):
    """Shows what will happen, starts it, and connects first where that must be.

    Settings are kept for the next time in `settings`; None: nowhere. `now` is local time.
    """

    def __init__(
        self,
        app: PartedApp,
        settings: Path | None,
        protocol: ProtocolSteps,
        now: Callable[[], datetime],
    ) -> None:
        super().__init__(app)
        self._protocol, self._now = protocol, now
        self._settings = settings
        self._queued: Order | None = None  # to be shown once its port is connected
        self._unnamed: tuple[str, str] | None = None  # visit that may do without a subject
        self._next_port: str | None = None  # to be connected once the present one is closed
        self.anew = False  # what is connected next begins another session

    def forget(self) -> None:
        """Do not show what was to be shown once its port is connected."""
        self._queued = None

    def disconnected(self) -> None:
        """Go on to the next port, where one waits."""
        if self._next_port is not None:
            port, self._next_port = self._next_port, None
            self.connect(port)

    def connected(self, news: Connected) -> None:
        """Show what was to be shown once this probe is connected, if it is the right one."""
        order, self._queued = self._queued, None
        aperture_mm = news.hello.aperture_mm
        if self.board.playing is not None:
            return
        if order is not None and order.setup.aperture_mm == aperture_mm:
            self._show(order)
            return
        if aperture_mm is None:  # it does not say; the field holds
            if order is not None:
                self._show(order)
            return
        self.fields.put("aperture_mm", f"{aperture_mm:g}")
        if order is not None:
            self.board.say(
                Level.WARNING,
                f"this probe has an opening of {aperture_mm:g} mm, as set now; F8 goes on",
            )

    def count_anew(self) -> None:
        """Take the next loading for a first one, because the operator says so."""
        self.board.withdraw()
        self.fields.put("cycle", "1")
        counted = self.board.next_cycle
        seen = f" (by count it would be loading {counted})" if counted > 1 else ""
        note = f"the next curve is a first loading: fully rested, or another spot{seen}"
        self.board.answer(Level.INFO, note)

    def put_on_anew(self) -> None:
        """Take the next curve for one of another placement, or not, because the operator says so.

        The count of loadings goes on: the site has not rested.
        """
        self.board.withdraw()
        self.fields.follow()  # what was typed last may not have come through
        self.board.name(self.fields.who)
        self.board.put_on_anew(self._now())

    def check(self) -> None:
        """Show what will happen; connect first where that must be. Nothing moves yet."""
        self.board.withdraw()
        if self.board.instrument is InstrumentState.FAULT:
            self.board.begin("resetting", "the fault is acknowledged")
            self.app.perform("resetting", self.bench.reset)
            return
        self.fields.follow()  # what was typed last may not have come through
        if not self.anew and self.board.is_over(self._now()):
            self.anew = True
            self.board.begin_day()
        self.board.name(self.fields.who)
        self.fields.count(self.board.next_cycle)
        try:
            texts = self.fields.texts()
            order = read_order(texts)
            if self.board.hello is not None and order.port == self.board.port:
                assert order.setup.program is not None
                check_limits(order.setup.program, self.board.hello)
        except InputError as error:
            self.board.refuse(str(error))
            wrong = self.fields.first_wrong()
            if wrong is not None:
                self.main.set_focus(wrong)
            return
        if self._must_be_named(order):
            return
        remember(self._settings, texts)
        board = self.board
        board.name(order.visit)
        if board.visit is not None and board.visit != order.visit:
            self.anew = True  # another person or site: another session
        if board.hello is None or order.port != board.port:
            self._reconnect(order.port, order)
        elif board.hello.aperture_mm not in {None, order.setup.aperture_mm}:
            # Another head was put on, so the instrument must be asked again
            port = with_opening(order.port, order.setup.aperture_mm)
            self.fields.put("port", port)
            self._reconnect(port, replace(order, port=port))
        elif (self.anew and board.visit is not None) or self.bench.recording_failed:
            self._reconnect(order.port, order)
        else:
            self._show(order)

    def _must_be_named(self, order: Order) -> bool:
        """Ask for a subject where there is none, once a visit."""
        if order.subject or order.visit in {self.board.visit, self._unnamed}:
            return False
        self._unnamed = order.visit
        self.main.set_focus(self.fields.query_one("#subject", Input))
        self.board.answer(Level.WARNING, WHOSE)
        return True

    def _show(self, order: Order) -> None:
        """Show what will happen; `confirm` does it."""
        fields, board, asked = self.fields, self.board, order
        # The same once more after a lost link is what was left, not all from the beginning
        left = board.left if _is_rest(order, board) else None
        if left is not None:
            order = order.with_left(left)
        placement, placed = board.next_placement(order.setup, self._now())
        if left is not None and board.put_on is None:
            placement = order.setup.placement
        goes_on = left is not None and placement == order.setup.placement
        order = replace(order, setup=replace(order.setup, placement=placement))
        counted = None if left is not None else board.next_cycle
        protocol: tuple[str, ...] = ()
        otherwise: tuple[str, ...] = ()
        if left is None:
            assumed = fields.assumed_thickness
            protocol, otherwise = against_protocol(board, order, assumed_thickness=assumed)
        review = Review(
            order,
            fields.texts(),
            goes_on,
            fields.assumed_thickness,
            counted,
            protocol,
            otherwise,
            asked,
            self.bench.analysis.complaint(order.setup),
            placed,
            "" if left is not None else self._loaded_before(order),
        )
        self.main.set_focus(None)
        self.app.guard.hidden()
        self.board.propose(review)
        self.main.draw()

    def _loaded_before(self, order: Order) -> str:
        """Return a clause where a first loading is none, by sessions of before the start."""
        board = self.board
        if order.setup.cycle != 1 or board.next_cycle != 1:
            return ""  # it is stated, or counted
        names = loaded_before(
            self.app.folder,
            *order.visit,
            self._now().timestamp(),
            simulated=board.simulated,
        )
        if not names:
            return ""
        return f"suction here in the last 12 h ({names[-1]}): unless it has rested, set Cycle"

    def confirm(self) -> None:
        """Arm and start what was shown, if it was read and nobody types."""
        board, review = self.board, self.board.review
        if review is None:
            board.answer(Level.WARNING, "F8 first: it shows what F9 would start")
            return
        why = self.app.guard.refusal()
        if not self.main.summary_in_view:
            why = "the window does not show all that will happen: make it larger"
        elif review.texts != self.fields.texts():
            why = "the settings have changed: F8 shows them"
        if why is not None:
            board.answer(Level.WARNING, f"not started: {why}")
            return
        board.review = None
        self.fields.accept()
        begun = board.path is not None and not self.anew
        self._protocol.note(review.otherwise, begun=begun)
        self._run(review)

    def _run(self, review: Review) -> None:
        """Measure; repeats follow by themselves. A vent that is ordered later ends it."""
        board, order, vents = self.board, review.order, self.bench.vents
        board.series, board.order, board.visit = order, order, order.visit
        board.begin("arming", "")
        self.main.close_fields(closed=True)
        board.asked = review.asked
        if review.goes_on:
            self.app.perform(MEASURING, lambda: self.bench.go_on(vents))
        else:
            self.app.perform(MEASURING, lambda: self.bench.measure(order, vents))

    def port_chosen(self, port: str | None) -> None:
        """Connect to another port."""
        if port is not None:
            self.fields.put("port", port)
            self._reconnect(port, None)

    def _reconnect(self, port: str, order: Order | None) -> None:
        self._queued = order
        if self.board.hello is None:
            self.connect(port)
        else:
            self._next_port = port
            self.board.begin("connecting", f"leaving {self.board.port} …")
            self.app.perform("leaving", self.bench.leave)

    def connect(self, port: str) -> None:
        """Connect, and pass on all that comes, in a thread."""
        self.board.port = port
        self.board.begin("connecting", f"connecting to {port} …")
        anew, self.anew = self.anew, False
        self.app.perform("connecting", lambda: self.bench.serve(port, anew=anew))


def _is_rest(order: Order, board: Board) -> bool:
    """Return whether this was asked for and is not over; loadings were counted meanwhile."""
    asked, left = board.asked, board.left
    if asked is None or left is None:
        return False
    cycle = order.setup.cycle
    same = order == replace(asked, setup=replace(asked.setup, cycle=cycle))
    return same and cycle in {left.setup.cycle, board.next_cycle}
