"""The main screen: settings, live curve, result, list of curves."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.events import DescendantBlur, DescendantFocus
from textual.message import Message
from textual.screen import Screen
from textual.widgets import DataTable, Input, Static

from skinlab.tui.shown import Review
from skinlab.tui.text import settings_line
from skinlab.tui.typing_guard import CHECK_KEY, CONFIRM_KEY, TypingGuard
from skinlab.tui.ui_state import PLACED_KEY, Board
from skinlab.tui.widgets.card import Card
from skinlab.tui.widgets.curve_plot import CurvePlot
from skinlab.tui.widgets.curves import Curves
from skinlab.tui.widgets.fields import Fields
from skinlab.tui.widgets.header import Top
from skinlab.tui.widgets.intervals import Intervals
from skinlab.tui.widgets.keys import Keys
from skinlab.tui.widgets.note import Note
from skinlab.tui.widgets.reading import Reading
from skinlab.tui.widgets.strip import Strip
from skinlab.tui.widgets.verdict import VerdictLine

if TYPE_CHECKING:
    from skinlab.inference.result import Identification

_FRAMES_PER_S = 24
_REPLAYS = frozenset({"play", "step", "faster", "slower", "event", "time"})
_ANSWER_S = 0.3  # longer than an identification takes
# What app.tcss styles by -review and -folded: to style all of the screen takes as long as a frame
_FOLDING = "#left, #right, #intervals, #curves, #verdict-next, #settings-line, #reading, #fields"
_FOLDING += ", #card-title"


class MainScreen(Screen[None]):
    """Shows the board, so often a second; says what the operator wants."""

    class Wanted(Message):
        """A key asked for something: check, start, edit, session, missing, a replay's controls."""

        def __init__(self, what: str) -> None:
            super().__init__()
            self.what = what

    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("v", "app.vent_probe", "Vent", priority=True, id="vent"),
        Binding("v", "app.give_up_probe", "Give up", priority=True, id="vent"),
        # No word contains these two, so that nothing that is typed can start anything
        Binding(CHECK_KEY, "want('check')", "Check", key_display="F8", priority=True, id="check"),
        Binding(
            CONFIRM_KEY, "want('start')", "Start", key_display="F9", priority=True, id="confirm"
        ),
        Binding(CONFIRM_KEY, "want('early')", show=False, priority=True, id="confirm"),
        Binding("space", "want('play')", "Play", key_display="Space", priority=True),
        Binding("enter,space", "nothing", show=False),
        Binding("full_stop", "want('step')", "Step", key_display="."),
        Binding("plus,equals_sign", "want('faster')", "Faster", key_display="+"),
        Binding("minus", "want('slower')", "Slower", key_display="-"),
        Binding("j", "want('time')", "Time", id="time"),
        Binding("e", "want('event')", "Event", id="event"),
        *(Binding(str(n), f"want('to {n}')", show=False) for n in range(1, 10)),
        Binding("f3", "settings", "Edit", key_display="F3", priority=True, id="settings"),
        # With priority: keys that wait behind one of these already go to the next field
        Binding("tab", "form(1)", show=False, priority=True),
        Binding("shift+tab", "form(-1)", show=False, priority=True),
        Binding("enter", "next", show=False, priority=True),
        Binding(
            "f6",
            "want('rested')",
            "Rested",
            key_display="F6",
            show=False,
            priority=True,
            id="rested",
        ),
        Binding(
            "insert",
            "want('placed')",
            "Put on anew",
            key_display=PLACED_KEY,
            show=False,
            priority=True,
            id="placed",
        ),
        Binding("f5", "want('visits')", "Visits", key_display="F5", priority=True, id="visits"),
        Binding(
            "f4", "want('pick')", "Pick", key_display="F4", show=False, priority=True, id="pick"
        ),
        Binding(
            "f7",
            "want('next')",
            "Load next",
            key_display="F7",
            show=False,
            priority=True,
            id="load",
        ),
        Binding("p", "want('protocol')", "Protocol", show=False, id="protocol"),
        Binding("g", "want('goal')", "Goal", show=False, id="goal"),
        Binding("up", "look(-1)", show=False),
        Binding("down", "look(1)", show=False),
        Binding("left", "across(-1)", show=False),
        Binding("right", "across(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown", "page(1)", show=False),
        Binding("r", "want('card')", "R0–R9", show=False, id="card"),
        Binding("s", "want('session')", "Session", id="session"),
        Binding("d,D", "want('missing')", "Missing", key_display="d", id="missing"),
    ]

    def __init__(self, board: Board, settings: Mapping[str, str], guard: TypingGuard) -> None:
        super().__init__()
        self._board = board
        self._guard = guard
        self._asked: Review | None = None  # what is in view to be confirmed, and since when is told
        self._settings = settings
        self._drawn = -1  # version of the board
        self._keys: tuple[bool, ...] = ()
        self._answer: Identification | None = None  # drawn last
        self._due_s: float | None = None  # until when the answer is waited for

    def compose(self) -> ComposeResult:
        """Yield the parts, from top to bottom."""
        yield Top(self._board)
        yield VerdictLine()
        with Horizontal(id="middle"):
            with Vertical(id="left"):
                yield Static("", id="settings-line", markup=False)
                yield Fields(self._board.port, self._settings)
                yield Static("", id="card-title", markup=False)
                yield Card(id="card")
            with Vertical(id="right"):
                yield CurvePlot()
                yield Strip()
            yield Intervals()
        yield Reading(id="reading")
        yield Curves()
        yield Note(self._board)
        yield Keys()

    def begin(self) -> None:
        """Begin to draw, once all parts are there."""
        self.set_interval(1 / _FRAMES_PER_S, self.draw)

    def draw(self) -> None:
        """Draw the board where it changed; nothing before the parts are there, or once they go."""
        board = self._board
        if not self.is_mounted or not self.display or self._answer_is_near():
            return
        if board.version == self._drawn:
            self._look()  # the layout may have followed by now
            return
        self._drawn = board.version
        if self._fields_closed:
            self.close_fields(closed=True)
        self.fold()
        self.query_one(Top).draw()
        self.query_one(VerdictLine).show(board)
        self.query_one(Card).show(board)
        self._ask()
        self.query_one(CurvePlot).show(board)
        self.query_one(Strip).show(board)
        self.query_one(Reading).show(board)
        self.query_one(Note).draw()
        answer = None if board.entry is None else board.entry.result
        if answer is None or answer is self._answer:
            self._draw_rest()
        else:  # which is waited for, and the rest takes as long as that
            self.call_after_refresh(self._draw_rest)
        self._answer = answer

    def _draw_rest(self) -> None:
        """Draw what nobody waits for."""
        board = self._board
        if not self.display or not self.is_mounted:
            return
        self.close_fields(closed=self._fields_closed)
        self.query_one(Fields).count(board.next_cycle)
        self.query_one(Fields).know(board.hello)
        self.query_one(Intervals).show(board)
        self.query_one(Curves).show(board)
        keys = (
            board.can_arm,
            board.review is None,
            board.playing is not None,
            bool(board.entries),
            board.read_only,
        )
        if keys != self._keys:
            self._keys = keys
            self.refresh_bindings()

    @property
    def _fields_closed(self) -> bool:
        """Whether the fields take no text now."""
        return self._board.moving or self._board.review is not None

    def _ask(self) -> None:
        """Tell the guard once what will happen is in view, to the last line."""
        review = self._board.review
        if review is None or review is not self._asked:
            self._asked = None
            if self.app.screen is self:  # else another question is in view
                self._guard.hidden()
        if review is not None and self._asked is None:
            self.call_after_refresh(self._look)

    def _look(self) -> None:
        review = self._board.review
        if review is not None and self._asked is None and self.summary_in_view:
            self._asked = review
            self._guard.asked()

    def on_screen_resume(self) -> None:
        """Count from now on: something else was in view."""
        self._asked = None
        if self._board.review is not None:
            self._ask()

    @property
    def summary_in_view(self) -> bool:
        """Whether all of what will happen can be read on this screen, and nothing lies over it."""
        reviewed = self._board.review is not None and self.app.screen is self
        return reviewed and self.query_one(Card).shows_whole(self._board)

    def _answer_is_near(self) -> bool:
        """Whether a curve is complete and its answer due: what is drawn meanwhile delays it."""
        entry = self._board.entry
        if entry is None or entry.result is not None or self._board.alarm is not None:
            self._due_s = None
            return False
        if self._due_s is None:
            self._due_s = time.monotonic() + _ANSWER_S
        return time.monotonic() < self._due_s

    def fold(self) -> None:
        """Leave the room, and the time of a frame, to what is measured and found; F3 unfolds."""
        board = self._board
        busy = board.moving or any((board.live, board.entry, board.review))
        folded = busy and not isinstance(self.focused, Input)
        before = self.classes
        self.update_classes({"-review": board.review is not None, "-folded": folded}, update=False)
        if self.classes != before:
            self.app.stylesheet.update_nodes(self.query(_FOLDING))
        if folded:
            line = settings_line(board, self.query_one(Fields).texts())
            self.query_one("#settings-line", Static).update(line, layout=False)

    @on(DescendantFocus)
    @on(DescendantBlur)
    def _focus_moved(self) -> None:
        if self.is_mounted and self.display and self.query(Fields):
            self.fold()

    def action_settings(self) -> None:
        """Go to the fields, or leave them."""
        if isinstance(self.focused, Input):
            self.set_focus(None)
            return
        self._board.withdraw()
        self.close_fields(closed=False)
        self.set_focus(self.query_one("#program", Input))

    def action_form(self, by: int) -> None:
        """Go to the fields, and round in them."""
        self.query_one(Fields).go_round(by)

    def action_next(self) -> None:
        """Go to the next field."""
        self.action_form(1)

    def action_look(self, by: int) -> None:
        """Look at the curve before or after."""
        curves = self.query_one(Curves)
        if not curves.row_count:
            self._board.tell("there is no curve yet")
        curves.move_cursor(row=curves.cursor_row + by)

    def action_across(self, by: int) -> None:
        """Move the list of curves sideways."""
        self.query_one(Curves).scroll_relative(x=8 * by, animate=False, force=True, immediate=True)

    def action_page(self, by: int) -> None:
        """Show more of the card."""
        card = self.query_one(Card)
        if not card.max_scroll_y:
            self._board.tell("the card shows all of it")
        card.scroll_relative(y=by * max(card.size.height - 1, 1), animate=False, immediate=True)

    def on_resize(self) -> None:
        """Draw again once the new layout is there."""
        self.call_after_refresh(self.redraw)

    def redraw(self) -> None:
        """Draw all of it again: the size or the colours are others."""
        self._drawn = -1
        self.draw()

    def action_nothing(self) -> None:
        """Say which key means what Enter and Space do not."""
        if self._board.can_arm:
            self._board.tell("F8 shows what will happen; F9 then starts it")

    def close_fields(self, *, closed: bool) -> None:
        """Let the fields take no text, or text again."""
        fields = self.query_one(Fields)
        if closed and isinstance(self.focused, Input):
            self.set_focus(None)
        fields.disabled = closed

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Let keys pass where they mean nothing here."""
        if action == "want":
            what = str(parameters[0])
            if what in _REPLAYS or what.startswith("to "):
                return self._board.playing is not None
            if what == "start":
                return self._board.review is not None
            if what in {"session", "goal", "protocol"}:
                return not self.typing
            if what == "visits":
                return True
            if what in {"missing", "card"}:
                return bool(self._board.entries) and not self.typing
            return self._board.can_arm
        if action == "settings":
            return self._board.can_arm
        if action == "next":
            return self.typing
        if action == "form":  # Tab is typing: it does not leave what is shown
            return self._board.can_arm and self._board.review is None
        return super().check_action(action, parameters)

    def action_want(self, what: str) -> None:
        """Pass on what a key asked for, behind what was typed before it.

        Such a key is heard at once, while letters still wait in the queue of their field.
        """
        (self.focused or self).call_later(self.post_message, self.Wanted(what))

    def on_click(self, event: events.Click) -> None:
        """Unfold the settings, or show more of the card, where that was clicked."""
        match event.widget and event.widget.id:
            case "settings-line" if self._board.can_arm:
                self.action_settings()
            case "card-title":
                self.query_one(Card).turn()

    @on(DataTable.RowHighlighted)
    def _look_at(self, event: DataTable.RowHighlighted) -> None:
        # The key is None where the rows are gone by now, whatever its type says
        index: str | None = getattr(event.row_key, "value", None)
        if index is not None:
            self._board.show(int(index))

    @property
    def typing(self) -> bool:
        """Whether a key is text for a field."""
        return isinstance(self.focused, Input) and not self._board.moving
