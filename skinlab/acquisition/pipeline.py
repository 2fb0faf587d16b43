"""One pipeline for live, replayed and recovered data: items in, messages to listeners."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from skinlab.acquisition.monitor import Monitor
from skinlab.curves.curve import Curve
from skinlab.curves.growing import GrowingCurve
from skinlab.recording.assembler import CurveAssembler
from skinlab.recording.stream import (
    CurveCompleted,
    CurveStarted,
    Identified,
    Item,
    Message,
    Planned,
)

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Identification

Listener = Callable[[Message], None]
HandOver = Callable[[int, Curve], None]


class Pipeline:
    """Assembles curves, judges them, identifies each as it completes; tells all in order.

    The names of the quality gates that a curve fails are among the flags of its identification.

    One thread owns it. A listener must be quick; one that raises stops the pipeline, so that no
    error is lost.
    """

    def __init__(
        self,
        identifier: Identifier | None,
        listeners: Iterable[Listener] = (),
        hand_over: HandOver | None = None,
    ) -> None:
        """Without an identifier curves are assembled only.

        With `hand_over` each completed curve goes there, so that its identification holds nothing
        up; `identified` takes the answer.
        """
        self._hand_over = hand_over
        self._assembler = CurveAssembler()
        self._monitor = Monitor()
        self._identifier = identifier
        self._listeners = list(listeners)

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
        self._tell(CurveStarted(index, GrowingCurve(curve.setup)))
        self._tell(CurveCompleted(index, curve, None, 0))

    def end(self, reason: str = "the stream ended") -> None:
        """Complete what is under way: there are no more items."""
        for message in self._assembler.end(reason):
            self._tell(message)

    def identified(self, index: int, curve: Curve, result: Identification) -> None:
        """Tell the answer for curve number `index`, with the names of the gates that it fails."""
        names = [finding.gate for finding in self._monitor.findings(index)]
        new = tuple(name for name in names if name not in result.flags)
        result = replace(result, flags=(*result.flags, *new))
        self._tell(Identified(index, curve, result))

    def _tell(self, message: Message) -> None:
        for listener in self._listeners:
            listener(message)
        for flagged in self._monitor.see(message):
            self._tell(flagged)
        if not isinstance(message, CurveCompleted):
            return
        if self._hand_over is not None:
            self._hand_over(message.index, message.curve)
        elif self._identifier is not None:
            self.identified(message.index, message.curve, self._identifier(message.curve))
