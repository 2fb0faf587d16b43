"""One pipeline for live, replayed and recovered data: items in, messages to listeners."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from skinlab.assembler import CurveAssembler
from skinlab.curve import Curve
from skinlab.identify.identifier import Identifier
from skinlab.stream import CurveCompleted, CurveStarted, Identified, Item, Message, Planned

Listener = Callable[[Message], None]


class Pipeline:
    """Assembles curves, identifies each as it completes, and tells the listeners in order.

    One thread owns it. A listener must be quick; one that raises stops the pipeline, so that no
    error is lost.
    """

    def __init__(self, identifier: Identifier | None, listeners: Iterable[Listener] = ()) -> None:
        """Without an identifier curves are assembled only."""
        self._assembler = CurveAssembler()
        self._identifier = identifier
        self._listeners = list(listeners)

    @property
    def running(self) -> bool:
        """Whether a curve is being measured."""
        return self._assembler.running

    def handle(self, item: Item) -> None:
        """Take one item of a source."""
        if isinstance(item, Planned):
            self._assembler.plan(item.setup)
            return
        for message in self._assembler.feed(item.event):
            self._tell(message)

    def complete(self, index: int, curve: Curve) -> None:
        """Take a curve that is complete already, and of which there are no items: an imported one.

        index: counts the curves from 1.
        """
        self._tell(CurveStarted(index, curve.setup))
        self._tell(CurveCompleted(index, curve, None, 0))

    def end(self, reason: str = "the stream ended") -> None:
        """Complete what is under way: there are no more items."""
        for message in self._assembler.end(reason):
            self._tell(message)

    def _tell(self, message: Message) -> None:
        for listener in self._listeners:
            listener(message)
        if isinstance(message, CurveCompleted) and self._identifier is not None:
            result = self._identifier(message.curve)
            self._tell(Identified(message.index, message.curve, result))
