"""How far a protocol is done: which curve serves which step, what is missing or otherwise."""

from __future__ import annotations

import contextlib
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from skinlab.acquisition.protocol import (
    NamedProtocol,
    Protocol,
    ProtocolStep,
    conditions_missing,
    decode_protocol,
    demanded,
    site_not_named,
    stated_words,
)
from skinlab.curves.curve import Setup
from skinlab.errors import InputError
from skinlab.mechanics.names import beyond_zero, plain
from skinlab.recording.audit import entries
from skinlab.recording.session import Session
from skinlab.recording.session_fit import excluded_of
from skinlab.report.measured import Measured
from skinlab.report.page import Section, Table
from skinlab.report.page_one import verdict_of
from skinlab.report.rounding import Interval, half_width_percent
from skinlab.report.verdict import Use, Verdict

_SLACK_S = 1.0  # clocks and vents
DEVIATION = "protocol deviation"


@dataclass(frozen=True)
class Done:
    """A curve that was measured. Times in s of one clock, None where they are unknown."""

    name: str
    setup: Setup
    verdict: Verdict | None  # None: not known yet
    parameters: Mapping[str, Interval]
    left_out: str | None = None  # by the operator: why
    began_s: float | None = None
    ended_s: float | None = None


@dataclass
class StepState:
    """A step, the curves that serve it, and those that were not accepted, with why."""

    number: int  # from 1
    step: ProtocolStep
    accepted: list[Done] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    @property
    def left(self) -> int:
        """Repeats that are still to be measured."""
        return max(self.step.repeats - len(self.accepted), 0)


@dataclass(frozen=True)
class Progress:
    """How far all steps at one site are; `beside` are curves that no step asked for."""

    steps: tuple[StepState, ...]
    beside: tuple[str, ...]

    @property
    def next(self) -> StepState | None:
        """The first step that is not done; None: all are."""
        return next((state for state in self.steps if state.left), None)

    @property
    def words(self) -> str:
        """How far it is, in a clause."""
        state = self.next
        if state is None:
            return f"all {len(self.steps)} steps of the protocol are done at this site"
        done = len(state.accepted)
        repeat = f", repeat {done + 1} of {state.step.repeats}" if state.step.repeats > 1 else ""
        return f"protocol step {state.number} of {len(self.steps)}{repeat}: {state.step.words}"


def progress(protocol: Protocol, curves: Sequence[Done]) -> Progress:
    """Return which curves serve which steps: in order, each the first that still needs one."""
    states = tuple(StepState(n, step) for n, step in enumerate(protocol.step, start=1))
    beside = []
    before: Done | None = None
    for curve in curves:
        fitting = [s for s in states if serves(s.step, curve.setup)]
        state = next((s for s in fitting if s.left), None)
        if state is None:
            beside.append(curve.name)
            before = curve
            continue
        why = _refusal(protocol, curve)
        short = _rest_missing(state, curve, before)
        if short is not None:
            state.remarks.append(short)
        if why is None:
            state.accepted.append(curve)
        else:
            state.refused[curve.name] = why
        before = curve
    for state in states:
        state.remarks += _scatter(protocol, state)
    return Progress(states, tuple(beside))


def serves(step: ProtocolStep, setup: Setup) -> bool:
    """Whether a curve of this setup is what the step asks for."""
    same = setup.program is not None and str(setup.program) == str(step.parsed)
    return same and setup.aperture_mm == step.aperture_mm


def _refusal(protocol: Protocol, curve: Done) -> str | None:
    """Return why a curve is not accepted; a curve without a verdict waits for it as accepted."""
    if curve.left_out is not None:
        return f"left out ({curve.left_out})" if curve.left_out else "left out"
    demand = protocol.acceptance
    if curve.verdict is None:
        return None
    wanted = {Use.GOOD} if demand.verdict == "good" else set(Use) - {Use.NOT}
    if curve.verdict.use not in wanted:
        return curve.verdict.words
    for name, percent in demand.interval_percent.items():
        value = curve.parameters.get(name)
        half = None if value is None else half_width_percent(value)
        if half is None or half > percent:
            shown = "no interval" if half is None else f"± {half:.2g} %"
            return f"{plain(name)[0]} {shown}, not within ± {percent:g} %"
    return None


def rest_due_s(state: StepState, before: Done | None, now_s: float) -> float:
    """Return how long the protocol still lets the site rest before this step's next curve, s."""
    if before is None or before.ended_s is None:
        return 0.0
    return max(_rest_s(state) - (now_s - before.ended_s), 0.0)


def _rest_s(state: StepState) -> float:
    begun = state.accepted or state.refused
    return state.step.rest_s if begun else state.step.rest_before_s


def _rest_missing(state: StepState, curve: Done, before: Done | None) -> str | None:
    if before is None or before.ended_s is None or curve.began_s is None:
        return None
    rest_s, due_s = curve.began_s - before.ended_s, _rest_s(state)
    if rest_s >= due_s - _SLACK_S:
        return None
    return f"{curve.name} began after {max(rest_s, 0.0):.0f} s of rest, not {due_s:g} s"


def _scatter(protocol: Protocol, state: StepState) -> list[str]:
    found = []
    for name, percent in protocol.acceptance.scatter_percent.items():
        values = [c.parameters[name].value for c in state.accepted if name in c.parameters]
        if len(values) < 2 or state.left:
            continue
        size = beyond_zero(name, float(np.mean(values)))
        scatter = 100.0 * float(np.std(values, ddof=1)) / size if size > 0 else math.inf
        if scatter > percent:
            found.append(
                f"{plain(name)[0]} scatters by {scatter:.2g} % over its repeats, not {percent:g} %"
            )
    return found


def protocol_trail(
    named: NamedProtocol, stated: Mapping[str, str], otherwise: Sequence[str] = ()
) -> list[tuple[str, dict[str, Any]]]:
    """Return what a session's audit trail keeps of a protocol: (what, detail)."""
    sha256 = hashlib.sha256(named.text.encode()).hexdigest()
    title = named.protocol.study.title
    about = {"title": title, "file": named.file, "sha256": sha256, "text": named.text}
    deviations = [(DEVIATION, {"text": clause}) for clause in otherwise]
    return [("protocol", about), ("conditions", dict(stated)), *deviations]


# ---- of a session that was recorded --------------------------------------------------------------


def protocol_section(session: Session, curves: Sequence[Measured]) -> list[Section]:
    """Return what the protocol demanded and what was done; nothing where there was no protocol."""
    trail = entries(session.records)
    named = next((e for e in reversed(trail) if e.what == "protocol"), None)
    if named is None:
        return []
    try:
        protocol = decode_protocol(str(named.detail.get("text", "")), "protocol")
    except InputError as error:
        return [Section("Protocol", (f"The protocol of this session cannot be read: {error}.",))]
    stated: dict[str, str] = {}
    for entry in trail:
        if entry.what == "conditions":
            stated = {str(k): str(v) for k, v in entry.detail.items()}
    found = progress(protocol, done_of(session, curves))
    site = str(session.meta.get("site") or "")
    points = [f"Condition {clause}." for clause in conditions_missing(protocol, stated)]
    points += [f"{clause[0].upper()}{clause[1:]}." for clause in site_not_named(protocol, site)]
    points += [f"Step {s.number}: {remark}." for s in found.steps for remark in s.remarks]
    points += [f"{name}: no step asks for it." for name in found.beside]
    points += [f"Before a curve: {e.detail.get('text')}." for e in trail if e.what == DEVIATION]
    state = found.next
    left = sum(s.left for s in found.steps)
    missing = "One curve is missing." if left == 1 else f"{left} curves are missing."
    words = "All steps are done." if state is None else missing
    tables = [Table(("step", "demanded", "accepted", "not accepted"), _rows(found), "Steps")]
    if demanded(protocol):
        rows = [
            (words_, stated_words(name, stated[name]) if stated.get(name) else "not stated")
            for name, words_ in demanded(protocol).items()
        ]
        tables.append(Table(("demanded", "stated"), rows, "Conditions"))
    how = "Otherwise than the protocol says:" if points else "Nothing was otherwise."
    return [Section("Protocol", (f"{protocol.study.title}. {words} {how}",), tables, points=points)]


def _rows(found: Progress) -> list[tuple[str, str, str, str]]:
    return [
        (
            f"{s.number}{f' {s.step.name}' if s.step.name else ''}",
            f"{s.step.repeats} × {s.step.aperture_mm:g} mm, {s.step.program}",
            f"{len(s.accepted)}: {', '.join(c.name for c in s.accepted)}" if s.accepted else "0",
            "; ".join(f"{name}: {why}" for name, why in s.refused.items()) or "–",
        )
        for s in found.steps
    ]


def done_of(session: Session, curves: Sequence[Measured]) -> list[Done]:
    """Return the curves of a session, with when each began and ended by its audit trail."""
    times: dict[tuple[str, str], float] = {}
    for entry in entries(session.records):
        if entry.what in {"run started", "run ended"}:
            with contextlib.suppress(ValueError):  # damaged: the time is not known
                at_s = datetime.fromisoformat(entry.utc).timestamp()
                times[entry.what, f"curve {entry.detail.get('curve')}"] = at_s
    excluded = excluded_of(session)
    return [
        Done(
            m.curve.name,
            m.curve.setup,
            verdict_of(m),
            _values(m.result),
            excluded.get(m.curve.name),
            times.get(("run started", m.curve.name)),
            times.get(("run ended", m.curve.name)),
        )
        for m in curves
    ]


def _values(result: Any) -> Mapping[str, Interval]:
    return {} if result is None else dict(result.parameters or {})
