"""Choose a port: those of this computer, and the simulated probes."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from drivers.link import list_ports
from skinlab.curves.apertures import APERTURES_MM
from skinlab.tui.screens.over import ChoosingScreen
from skinlab.tui.widgets.hints import Hints


def choices() -> list[tuple[str, str]]:
    """Return (url, description) of what can be connected to."""
    found = [(port.url, port.details) for port in list_ports()]
    simulated = [
        (f"sim://?seed=1&aperture_mm={a:g}", f"simulated probe, {a:g} mm opening")
        for a in APERTURES_MM
    ]
    return found + simulated


class PortsScreen(ChoosingScreen):
    """A list of ports; gives the chosen URL, or None."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f2,f8", "dismiss(None)", "Close", priority=True),
    ]

    def compose_box(self) -> ComposeResult:
        """Yield the list."""
        with Vertical(id="ports"):
            yield Static("Port", classes="title", markup=False)
            yield OptionList(
                *(Option(_line(url, text), id=url) for url, text in choices()), markup=False
            )
            yield Hints(("Enter chooses", "enter"), ("F2 closes", "f2"))


def _line(url: str, text: str) -> str:
    return url if text in {url, "n/a"} else f"{url:<28} {text}"
