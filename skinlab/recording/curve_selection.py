"""What the operator decides about the curves of a session, apart from what was measured.

Everything here can be undone; nothing here can touch a measurement.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Deed:
    """Something that was decided, for the audit trail too."""

    what: str  # "curve excluded", "curve included", "note"
    curve: int | None = None
    text: str = ""


@dataclass(slots=True)
class Ledger:
    """Exclusions with their reasons, and notes."""

    excluded: dict[int, str] = field(default_factory=dict)  # by curve: why
    notes: list[str] = field(default_factory=list)
    _done: list[tuple[Deed, str]] = field(default_factory=list)  # with what there was before

    def exclude(self, curve: int, reason: str) -> Deed:
        """Leave a curve out of means, joint fits and comparisons."""
        return self._do(Deed("curve excluded", curve, reason), self.excluded.get(curve, ""))

    def include(self, curve: int) -> Deed:
        """Take it in again."""
        return self._do(Deed("curve included", curve), self.excluded.get(curve, ""))

    def note(self, text: str) -> Deed:
        """Write something down."""
        return self._do(Deed("note", text=text), "")

    def undo(self) -> Deed | None:
        """Take the last deed back; None: there is none. Returns what was taken back."""
        if not self._done:
            return None
        deed, before = self._done.pop()
        if deed.what == "note":
            self.notes.pop()
        elif deed.curve is not None:
            self._put(deed.curve, before)
        return deed

    def redo(self, deed: Deed) -> None:
        """Do again what was taken back."""
        self._do(deed, "" if deed.curve is None else self.excluded.get(deed.curve, ""))

    def _do(self, deed: Deed, before: str) -> Deed:
        self._done.append((deed, before))
        if deed.what == "note":
            self.notes.append(deed.text)
        elif deed.curve is not None:
            self._put(deed.curve, deed.text)
        return deed

    def _put(self, curve: int, reason: str) -> None:
        if reason:
            self.excluded[curve] = reason
        else:
            self.excluded.pop(curve, None)
