"""The settings: fields that are checked as they are typed."""

from __future__ import annotations

from collections.abc import Mapping

from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.widgets import Input, Label, Static

from drivers.events import Hello
from skinlab.acquisition.measurement_request import DEFAULTS, complaint
from skinlab.tui.widgets.field import Field

# Rows of (field, label, most characters); fields of one row stand side by side.
_ROWS: tuple[tuple[tuple[str, str, int], ...], ...] = (
    (("port", "Port", 200),),
    (("subject", "Subject", 60),),
    (("site", "Site", 60),),
    (("aperture_mm", "Opening", 1), ("thickness_mm", "mm skin", 5), ("thickness_sd_mm", "±", 5)),
    (("cycle", "Cycle", 3), ("repeats", "Times", 2), ("rest_s", "Rest s", 4)),
    (("program", "Program", 200),),
)
_SHORT = 20  # characters of a value that its complaint repeats
_THICKNESS = ("thickness_mm", "thickness_sd_mm")
_HINTS = {
    "subject": "pseudonym, never a name",
    "site": "e.g. forearm",
    "thickness_sd_mm": "?",
    "program": "or mode1 to mode4",
}


class Fields(Vertical):
    """Who, where, which probe, which program, how often; the complaint stands under each row.

    A thickness belongs to a subject and a site: where these change,
    it becomes the one that they had before, or the default, which is then marked as assumed.
    """

    class Named(Message):
        """The fields name this subject and this site now."""

        def __init__(self, who: tuple[str, str]) -> None:
            super().__init__()
            self.who = who

    def __init__(self, port: str, start: Mapping[str, str]) -> None:
        super().__init__(id="fields")
        self._start = {**DEFAULTS, **start, "port": port}
        self._hello: Hello | None = None
        self._who = (self._start["subject"], self._start["site"])
        self._known: dict[tuple[str, str], tuple[str, ...]] = {}  # thickness, by who it is of
        self._put = self._thickness_start  # by the program, not by hand
        self._by_program = True  # what is in the field now
        self._cycle_put = self._start["cycle"]  # as counted, not as typed

    def compose(self) -> ComposeResult:
        """Yield a line of fields and a line for complaints for each row."""
        for row in _ROWS:
            with Horizontal(classes="row"):
                for name, label, most in row:
                    yield Label(label, classes=f"label -{name}")
                    yield Field(
                        self._start[name],
                        id=name,
                        compact=True,
                        max_length=most,
                        placeholder=_HINTS.get(name, ""),
                        validate_on=(),  # `complaint` judges; each judgement styles the field anew
                    )
                if row[-1][0] == "thickness_sd_mm":
                    yield Label("mm", classes="label -unit")
            yield Static("", id=f"wrong-{row[0][0]}", classes="wrong", markup=False)

    def texts(self) -> dict[str, str]:
        """Return what is in the fields."""
        return {str(field.id): field.value for field in self.query(Input)}

    def put(self, name: str, text: str) -> None:
        """Fill in a field."""
        self.query_one(f"#{name}", Input).value = text

    @property
    def _thickness_start(self) -> tuple[str, ...]:
        return tuple(self._start[name] for name in _THICKNESS)

    @property
    def _thickness(self) -> tuple[str, ...]:
        return tuple(self.query_one(f"#{name}", Input).value for name in _THICKNESS)

    @property
    def who(self) -> tuple[str, str]:
        """Subject and site."""
        return self._who

    @property
    def assumed_thickness(self) -> bool:
        """Whether nobody typed the thickness for this subject and site."""
        return self._who not in self._known and self._by_program

    def count(self, next_cycle: int) -> None:
        """Put in which loading of the site comes next, unless somebody typed another one."""
        if self._cycle_put == str(next_cycle):
            return
        field = self.query_one("#cycle", Input)
        by_hand, self._cycle_put = field.value != self._cycle_put, str(next_cycle)
        if not by_hand:
            field.value = self._cycle_put

    def accept(self) -> None:
        """Let the thickness be that of this subject and site from here on, and count on."""
        self._cycle_put = self.query_one("#cycle", Input).value
        if not self.assumed_thickness:
            self._known[self._who] = self._put = self._thickness
            self._by_program = True

    def follow(self) -> None:
        """Let the thickness follow where subject or site have changed."""
        if self._thickness != self._put:
            self._by_program = False
        who = (
            self.query_one("#subject", Input).value.strip(),
            self.query_one("#site", Input).value.strip(),
        )
        if who == self._who:
            return
        self._who = who
        self._cycle_put = self.query_one("#cycle", Input).value  # that was typed for another skin
        if self._by_program:  # else it was typed for whoever is typed now
            self._put = self._known.get(who, self._thickness_start)
            for name, text in zip(_THICKNESS, self._put, strict=True):
                self.put(name, text)
        self.post_message(self.Named(who))

    def go_round(self, by: int) -> None:
        """Go to the next field; after the last one comes the first.

        From elsewhere to the subject, behind the port, which is there already.
        """
        fields = list(self.query(Input))
        # Not `has_focus`, which comes behind keys that wait already, too
        focused = self.screen.focused
        at = fields.index(focused) if focused in fields else 0
        # Not `focus()`, which comes behind keys that wait already: they would go to the old field
        self.screen.set_focus(fields[(at + by) % len(fields)])

    def first_wrong(self) -> Input | None:
        """Return the first field with a complaint."""
        return next((f for f in self.query(Input) if self._complaint(f)), None)

    def know(self, hello: Hello | None) -> None:
        """Check against the limits of this instrument from here on."""
        if hello != self._hello:
            self._hello = hello
            self._judge(_ROWS[-1])

    def _complaint(self, field: Input) -> str | None:
        return complaint(str(field.id), field.value, self._hello)

    @on(Input.Changed)
    def _check(self, event: Input.Changed) -> None:
        event.stop()
        self.follow()
        for row in _ROWS:
            if event.input.id in [name for name, _, _ in row]:
                self._judge(row)

    def _judge(self, row: tuple[tuple[str, str, int], ...]) -> None:
        fields = [self.query_one(f"#{name}", Input) for name, _, _ in row]
        found = [_short(self._complaint(field) or "", field.value) for field in fields]
        for field, wrong in zip(fields, found, strict=True):
            field.set_class(bool(wrong), "-wrong")
        line = self.query_one(f"#wrong-{row[0][0]}", Static)
        text = next((wrong for wrong in found if wrong), "")
        line.update(text)
        line.display = bool(text)


def _short(wrong: str, value: str) -> str:
    """Return a complaint without a long value, which stands above it: a few lines have room."""
    return wrong.replace(value, "…") if len(value) > _SHORT else wrong
