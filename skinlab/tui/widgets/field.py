"""A line of text whose keys do what they do in the order in which they came."""

from __future__ import annotations

from textual import events
from textual.binding import Binding
from textual.widgets import Input

_EDITS = {
    key: binding.action
    for binding in Input.BINDINGS
    if isinstance(binding, Binding)
    for key in binding.key.split(",")
}


class Field(Input):
    """Textual's, but for one thing: a key that edits is no slower than one that is text.

    There the first goes up to the app and comes back as an action, behind letters that were typed
    after it: of P-20, Backspace and 1 in one burst nothing was left, or P-20.
    """

    async def _on_key(self, event: events.Key) -> None:
        action = _EDITS.get(event.key)
        if action is not None:  # else Textual's own, which is called next
            event.stop()
            event.prevent_default()
            await self.run_action(action)
