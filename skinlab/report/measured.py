"""A session's curves with all that a report says of them."""

from __future__ import annotations

from dataclasses import dataclass

from skinlab.acquisition.pipeline import Pipeline
from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.stored_results import StoredResult, stored_result
from skinlab.quality.gates.base import Finding
from skinlab.recording.advised import MISSING_EFFECT, advised_curves
from skinlab.recording.recorded_items import dialect_of, recorded_items
from skinlab.recording.session import Session
from skinlab.recording.stream import CurveCompleted, Flagged, Message
from skinlab.report.fitted import Fit, fit_again
from skinlab.report.verdict import FEW


@dataclass(frozen=True)
class Judged:
    """What the quality gates found about a curve, and why it ended early, where it did."""

    findings: tuple[Finding, ...] = ()
    cut: str | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """One curve; `fit` is a sentence where there is no fitted curve."""

    number: int  # from 1
    curve: Curve
    judged: Judged
    result: StoredResult | None
    fit: Fit | str
    advised: str = ""  # why it was measured, where that was advised

    @property
    def for_effect(self) -> bool:
        """Whether it was measured to tell what is missing, and need not tell parameters."""
        return self.advised == MISSING_EFFECT


def measured_curves(session: Session, identifier: Identifier | str) -> tuple[Measured, ...]:
    """Return the curves; `identifier` is that of the session, or a sentence why it is unknown.

    Raises:
        InputError: a stored result is damaged.
    """
    judged = _judged(session)
    advised = advised_curves(session)
    found = []
    for number, (curve, stored) in enumerate(
        zip(session.curves, session.results, strict=True), start=1
    ):
        result = stored_result(number, stored)
        fit = _fit(curve, result, identifier)
        because = advised.get(curve.name, "")
        found.append(Measured(number, curve, judged[number - 1], result, fit, because))
    return tuple(found)


def scolded(measured: Measured) -> tuple[Finding, ...]:
    """Return what the gates found, but for the few samples of what was advised for an effect."""
    findings = measured.judged.findings
    if not measured.for_effect:
        return findings
    return tuple(finding for finding in findings if finding.gate != FEW)


def _fit(curve: Curve, result: StoredResult | None, identifier: Identifier | str) -> Fit | str:
    if result is None:
        return "The session stores no values of this curve."
    if result.error is not None:
        return f"Not identified: {result.error}."
    if isinstance(identifier, str):
        return f"There is no fitted curve to draw: {identifier}."
    try:
        return fit_again(curve, result, identifier)
    except InputError as error:
        return f"There is no fitted curve to draw: {error}."


def _judged(session: Session) -> list[Judged]:
    """Return what the gates say: of the recorded bytes, where the curves come from them."""
    listener = _Listener()
    pipeline = Pipeline(None, [listener])
    for item in recorded_items(session.records, dialect_of(session.meta)):
        pipeline.handle(item)
    pipeline.end("the record ends here")
    if len(listener.judged) != len(session.curves):  # imported: there are no bytes
        listener = _Listener()
        pipeline = Pipeline(None, [listener])
        for number, curve in enumerate(session.curves, start=1):
            pipeline.complete(number, curve)
    return [*listener.judged.values()]


class _Listener:
    def __init__(self) -> None:
        self.judged: dict[int, Judged] = {}
        self._findings: dict[int, tuple[Finding, ...]] = {}

    def __call__(self, message: Message) -> None:
        match message:
            case Flagged(index, finding):
                self._findings[index] = (*self._findings.get(index, ()), finding)
                if index in self.judged:  # gates speak once more after the curve is complete
                    self.judged[index] = Judged(self._findings[index], self.judged[index].cut)
            case CurveCompleted(index, _, cut):
                self.judged[index] = Judged(self._findings.get(index, ()), cut)
            case _:
                pass
