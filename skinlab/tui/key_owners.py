"""The screens on which the settings file may add keys."""

from __future__ import annotations

from typing import Any

from textual.app import App
from textual.binding import Binding
from textual.screen import Screen

from skinlab.tui.app import SkinlabApp
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.missing import MissingScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.screens.protocol import ProtocolScreen
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.screens.visits import VisitsScreen


def owners() -> dict[str, list[Binding]]:
    """Return the bindings of these screens, by their name."""
    screens: dict[str, type[App[None]] | type[Screen[Any]]] = {
        "app": SkinlabApp,
        "main": MainScreen,
        "session": SessionScreen,
        "missing": MissingScreen,
        "visits": VisitsScreen,
        "protocol": ProtocolScreen,
        "question": ConfirmScreen,
    }
    return {
        name: [
            binding
            for cls in owner.__mro__
            for binding in vars(cls).get("BINDINGS", ())
            if isinstance(binding, Binding) and cls.__module__.startswith("skinlab")
        ]
        for name, owner in screens.items()
    }
