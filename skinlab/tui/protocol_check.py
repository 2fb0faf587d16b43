"""An order against the protocol of the study: what is otherwise is said, and nothing refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinlab.tui.ui_state import Board

if TYPE_CHECKING:
    from skinlab.acquisition.measurement_request import Order


def against_protocol(
    board: Board, order: Order, *, assumed_thickness: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return which step an order is, and what is otherwise than the protocol says."""
    named, walk = board.protocol, board.walk
    if named is None or walk is None:
        return (), ()
    from skinlab.acquisition.protocol import conditions_missing, site_not_named, step_otherwise
    from skinlab.report.protocol import rest_due_s, serves

    protocol, otherwise = named.protocol, []
    fitting = [s for s in walk.steps if serves(s.step, order.setup)]
    state = next((s for s in fitting if s.left), None)
    step = "no step asks for this"
    if state is not None:
        step = f"step {state.number} of {len(walk.steps)}: {state.step.words}"
        if walk.next is not None and state is not walk.next:
            otherwise.append(f"step {walk.next.number} comes before it")
        otherwise += step_otherwise(state.step, state.left, order.repeats, order.rest_s)
        done = board.done_curves
        due_s = rest_due_s(state, done[-1] if done else None, board.now_s)
        if due_s > 1:
            otherwise.append(f"the site is to rest {due_s:.0f} s more")
    elif fitting:
        step = f"step {fitting[-1].number} is done: this is one more"
    if state is None:
        otherwise.append(step)
    otherwise += site_not_named(protocol, order.site)
    otherwise += conditions_missing(protocol, board.stated)
    if protocol.conditions.thickness_measured and assumed_thickness:
        otherwise.append("the thickness is not measured")
    return ((step,) if state is not None else ()), tuple(otherwise)
