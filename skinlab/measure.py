"""Measure without a screen: acquire repeats, identify each curve as it completes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from drivers.errors import DriverError
from drivers.events import Alarm, HostVented, InstrumentState, LinkLost, TimedEvent
from skinlab.curve import Setup
from skinlab.errors import AcquisitionError
from skinlab.pipeline import Pipeline
from skinlab.sources import LiveSource

_SETTLED = frozenset({InstrumentState.IDLE, InstrumentState.LOADED, InstrumentState.FAULT})
_POLL_S = 0.1
_VENT_PATIENCE_S = 3.0


@dataclass(frozen=True)
class Plan:
    """What to measure: the same setup, several times."""

    setup: Setup  # of the first repeat
    repeats: int = 1
    rest_s: float = 5.0  # between repeats
    rate_hz: float | None = None  # None: the instrument's usual one


def measure(
    source: LiveSource,
    plan: Plan,
    pipeline: Pipeline,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Run the plan; curves and results go to the pipeline's listeners.

    Each repeat counts as the next cycle of the site. Whatever goes wrong, the probe is told to vent
    and what was measured has reached the pipeline.

    Raises:
        AcquisitionError: the probe or its link failed, or the driver had to vent.
    """
    watch = _Watch()
    try:
        for repeat in range(plan.repeats):
            if repeat:
                _rest(source, pipeline, watch, clock, plan.rest_s)
            setup = replace(
                plan.setup, cycle=plan.setup.cycle + repeat, repeat=plan.setup.repeat + repeat
            )
            source.arm(setup, plan.rate_hz)
            source.start()
            _until_vented(source, pipeline, watch)
    except DriverError as error:
        raise AcquisitionError(str(error)) from error
    finally:
        # An error or Ctrl-C: vent at once, then take in what is still on its way.
        if source.probe.state not in _SETTLED:
            source.probe.vent("the measurement ended")
            end = clock() + _VENT_PATIENCE_S
            while source.probe.state not in _SETTLED and source.probe.is_open and clock() < end:
                _take(source, pipeline, watch, _POLL_S)
        while _take(source, pipeline, watch, 0.0):
            pass
        pipeline.end()


class _Watch:
    """What went wrong, in the driver's words."""

    def __init__(self) -> None:
        self.trouble: str | None = None

    def see(self, event: object) -> None:
        match event:
            case HostVented(reason):
                self.trouble = self.trouble or f"{reason}; the probe was told to vent"
            case LinkLost(reason):
                # Nobody can confirm a vent over a dead link; the instrument's own limit vents.
                self.trouble = f"{reason}; no vent is confirmed: look at the probe, lift it"
            case Alarm(text):
                self.trouble = text
            case _:
                pass

    def check(self) -> None:
        if self.trouble is not None:
            raise AcquisitionError(self.trouble)


def _take(source: LiveSource, pipeline: Pipeline, watch: _Watch, timeout_s: float) -> bool:
    item = source.next_item(timeout_s)
    if item is None:
        return False
    if isinstance(item, TimedEvent):
        watch.see(item.event)
    pipeline.handle(item)
    return True


def _until_vented(source: LiveSource, pipeline: Pipeline, watch: _Watch) -> None:
    """Take items until the run is over and the instrument says that the pressure has fallen."""
    ran = False
    while True:
        took = _take(source, pipeline, watch, _POLL_S)
        watch.check()
        ran = ran or pipeline.running
        if ran and not pipeline.running and not took and source.probe.state in _SETTLED:
            return
        if not took and not source.probe.is_open:
            raise AcquisitionError("the link to the probe is closed")


def _rest(
    source: LiveSource,
    pipeline: Pipeline,
    watch: _Watch,
    clock: Callable[[], float],
    rest_s: float,
) -> None:
    end = clock() + rest_s
    while (left := end - clock()) > 0:
        _take(source, pipeline, watch, min(left, _POLL_S))
        watch.check()
