"""The settings: fields that are checked as they are typed."""

from __future__ import annotations

from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Input, Label, Static

from skinlab.tui.order import DEFAULTS, complaint

# Rows of (field, label, most characters); fields of one row stand side by side.
_ROWS: tuple[tuple[tuple[str, str, int], ...], ...] = (
    (("port", "Port", 200),),
    (("subject", "Subject", 60),),
    (("site", "Site", 60),),
    (("aperture_mm", "Opening", 1), ("thickness_mm", "Skin", 5), ("cycle", "Cycle", 3)),
    (("program", "Program", 200),),
)
_HINTS = {"subject": "pseudonym, never a name", "site": "e.g. forearm"}


class Fields(Vertical):
    """Port, subject, site, opening, thickness, cycle, program; the complaint stands under each."""

    def __init__(self, port: str) -> None:
        super().__init__(id="fields")
        self._start = {**DEFAULTS, "port": port}

    def compose(self) -> ComposeResult:
        """Yield a line of fields and a line for complaints for each row."""
        for row in _ROWS:
            with Horizontal(classes="row"):
                for name, label, most in row:
                    yield Label(label, classes=f"label -{name}")
                    yield Input(
                        self._start[name],
                        id=name,
                        compact=True,
                        max_length=most,
                        placeholder=_HINTS.get(name, ""),
                    )
            yield Static("", id=f"wrong-{row[0][0]}", classes="wrong", markup=False)

    def texts(self) -> dict[str, str]:
        """Return what is in the fields."""
        return {str(field.id): field.value for field in self.query(Input)}

    def put(self, name: str, text: str) -> None:
        """Fill in a field."""
        self.query_one(f"#{name}", Input).value = text

    def first_wrong(self) -> Input | None:
        """Return the first field with a complaint."""
        return next((f for f in self.query(Input) if complaint(str(f.id), f.value)), None)

    @on(Input.Changed)
    def _check(self, event: Input.Changed) -> None:
        event.stop()
        for row in _ROWS:
            names = [name for name, _, _ in row]
            if event.input.id in names:
                found = [complaint(n, self.query_one(f"#{n}", Input).value) for n in names]
                for name, wrong in zip(names, found, strict=True):
                    self.query_one(f"#{name}", Input).set_class(wrong is not None, "-wrong")
                line = self.query_one(f"#wrong-{names[0]}", Static)
                text = next((wrong for wrong in found if wrong), "")
                line.update(text)
                line.display = bool(text)
