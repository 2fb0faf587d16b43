"""What the palette offers from the main screen, on every screen."""

from __future__ import annotations

from dataclasses import replace

from skinlab.tui.screens.palette import Command
from skinlab.tui.ui_state import Board

COMMANDS = (
    Command("app.help", "Help: all keys", "?"),
    Command("want('session')", "Session: means, joint fit, compare, notes", "s"),
    Command("want('visits')", "Visits: search, compare, trend", "F5"),
    Command("want('missing')", "Look for what the model misses", "d"),
    Command("want('protocol')", "Protocol: its steps, conditions, what is missing", "p"),
    Command("want('goal')", "Set the goal of this visit", "g"),
    Command("want('next')", "Load the next step of the protocol, or what the goal needs", "F7"),
    Command("want('card')", "R0 to R9 of a step curve, or the values", "r"),
    Command("want('rested')", "The site has rested: count loadings from 1", "F6"),
    Command("want('placed')", "The probe was put on anew, without a full rest", "Ins"),
    Command("settings", "Edit the settings", "F3"),
    Command("want('pick')", "Choose a program by its name", "F4"),
    Command("app.ports", "Choose a port", "F2"),
    Command("app.messages", "Read the messages again", "w"),
    Command("app.theme", "Other colours: dark, light, high contrast, colour-blind safe", "t"),
    Command("app.vent", "Vent", "v"),
    Command("app.leave", "Quit", "q"),
)

_VENT = "app.vent"
_OF_A_PROBE = frozenset({
    _VENT, "app.ports", "settings",
    *(f"want('{what}')" for what in ("goal", "next", "pick", "placed", "protocol", "rested")),
})  # fmt: skip


def commands_for(board: Board) -> tuple[Command, ...]:
    """Return those that mean something here: a replay has no probe, and measures nothing."""
    if board.playing is not None:
        return tuple(command for command in COMMANDS if command.action not in _OF_A_PROBE)
    if board.read_only:
        return tuple(
            replace(command, words="Give the curve up") if command.action == _VENT else command
            for command in COMMANDS
        )
    return COMMANDS
