"""The protocol: its steps one under the other, what is missing, and the conditions as stated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from textual import on
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Static

from skinlab.acquisition.protocol import (
    condition_complaint,
    conditions_missing,
    demanded,
    stated_words,
)
from skinlab.tui.screens.board_screen import BoardScreen
from skinlab.tui.text import who_text
from skinlab.tui.typing_guard import CHECK_KEY
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.field import Field


def protocol_lines(board: Board) -> list[str]:
    """Return the walk through the protocol: done ✔, next ►, to come ○, otherwise !."""
    named, walk = board.protocol, board.walk
    if named is None or walk is None:
        return ["There is no protocol: skinlab ui --protocol PROTOCOL.toml"]
    protocol, lines = named.protocol, []
    for state in walk.steps:
        step = state.step
        sign = "►" if state is walk.next else "○" if state.left else "✔"
        what = f"{step.repeats} × {step.aperture_mm:g} mm, {step.program}"
        name = f"{step.name}: " if step.name else ""
        lines.append(f"{sign} {state.number}  {name}{what}: {len(state.accepted)} accepted")
        lines += [f"     ! {name}: {why}" for name, why in state.refused.items()]
        lines += [f"     ! {remark}" for remark in state.remarks]
    lines += [f"! {name}: no step asks for it" for name in walk.beside]
    if protocol.study.sites:
        lines += ["", "Sites:"]
        lines += [
            f"{'✔' if board.site_done(site) else '►' if site == board.who[1] else '○'} {site}"
            for site in protocol.study.sites
        ]
    expected = demanded(protocol)
    if expected:
        lines += ["", "Conditions (e states them):"]
        for name, words in expected.items():
            text = board.stated.get(name)
            shown = stated_words(name, text) if text else f"! not stated: {words}"
            lines.append(f"  {shown}")
        lines += [
            f"! {clause}"
            for clause in conditions_missing(protocol, board.stated)
            if not clause.startswith("not stated")
        ]
    return lines


class ProtocolScreen(BoardScreen):
    """Shows the board's protocol; says what was stated, and that its next step is wanted."""

    class Stated(Message):
        """The conditions are now as the board says."""

    class Wanted(Message):
        """The next step is to be put into the fields."""

    SAYS = "#protocol-says"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("p,b,q", "back", "Back", key_display="p"),
        Binding("f7", "load", "Load next", key_display="F7", priority=True, id="load"),
        Binding("e", "state", "State conditions"),
        Binding(CHECK_KEY, "cancel", "No", key_display="F8", priority=True, id="check"),
        Binding("tab,shift+tab", "nothing", show=False, priority=True),
        Binding("up", "page(-1)", show=False),
        Binding("down", "page(1)", show=False),
    ]

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        self._asking: list[str] = []  # conditions that are still to be asked for

    def parts(self) -> Iterator[Widget]:
        """Yield title, steps, and the line for a condition."""
        yield Static("", id="protocol-title", markup=False)
        text = Static("", id="protocol-text", markup=False)
        yield VerticalScroll(text, id="protocol-says", can_focus=False)
        yield Static("", id="protocol-question", markup=False)
        line = Field(id="protocol-line", compact=True, max_length=60)
        line.display = False
        yield line

    def show(self) -> None:
        """Draw the steps."""
        board = self._board
        named = board.protocol
        title = "" if named is None else named.protocol.study.title
        whose = who_text(board.who)
        self.query_one("#protocol-title", Static).update(f"Protocol: {title} ({whose})")
        self.query_one("#protocol-text", Static).update("\n".join(protocol_lines(board)))

    # ---- keys ---------------------------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Letters are text while a condition is typed."""
        if action in {"state", "back"}:
            return not self._asking
        if action in {"cancel", "nothing"}:
            return bool(self._asking)
        if action == "load":
            return not self._asking and self._board.can_arm
        return super().check_action(action, parameters)

    def action_load(self) -> None:
        """Ask for the next step."""
        self.post_message(self.Wanted())

    def action_nothing(self) -> None:
        """Stay in the line."""

    # ---- the conditions, one by one -----------------------------------------------------------

    def action_state(self) -> None:
        """Ask for each condition; an empty answer leaves it as it is."""
        named = self._board.protocol
        self._asking = [] if named is None else list(demanded(named.protocol))
        self._ask("" if self._asking else "the protocol asks for no conditions")

    def action_cancel(self) -> None:
        """Leave the rest as it is."""
        self.leave_line()

    def leave_line(self) -> None:
        """Ask no more."""
        self._asking = []
        line = self.query_one(Input)
        line.display = False
        self.query_one("#protocol-question", Static).update("")
        self.set_focus(None)
        self.refresh_bindings()

    def _ask(self, remark: str) -> None:
        named = self._board.protocol
        question = self.query_one("#protocol-question", Static)
        if not self._asking or named is None:
            self.leave_line()
            question.update(remark)
            return
        name = self._asking[0]
        keeps = self._board.stated.get(name)
        then = f"Enter keeps {keeps}" if keeps else "Enter goes on without"
        question.update(f"{remark}{demanded(named.protocol)[name]}? ({then}, F8 ends)")
        line = self.query_one(Input)
        line.value, line.display = "", True
        self.set_focus(line)
        self.refresh_bindings()

    @on(Input.Submitted)
    def _answered(self, event: Input.Submitted) -> None:
        event.stop()
        text = event.value.strip()
        if not self._asking:
            return
        complaint = condition_complaint(self._asking[0], text) if text else None
        if complaint is not None:
            self._ask(f"{complaint}. ")
            return
        name = self._asking.pop(0)
        if text:
            self._board.state(name, text)
            self.post_message(self.Stated())
        self._ask("")
