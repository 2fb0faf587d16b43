"""Measure without a screen: acquire repeats, identify each curve as it completes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from drivers.errors import DriverError, LinkError
from drivers.events import (
    Alarm,
    Hello,
    HostVented,
    InstrumentState,
    LinkLost,
    LinkRestored,
    State,
    TimedEvent,
    VentConfirmed,
)
from drivers.reconnect import reconnect
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.sources import LiveSource
from skinlab.curves.curve import Setup
from skinlab.curves.program import check_measurable
from skinlab.errors import AcquisitionError

_SETTLED = frozenset({InstrumentState.IDLE, InstrumentState.LOADED, InstrumentState.FAULT})
_POLL_S = 0.1
_VENT_PATIENCE_S = 3.0
MOST_OUTAGES = 3  # lost links that one measurement gets over


@dataclass(frozen=True)
class Plan:
    """What to measure: the same setup, several times.

    Raises:
        InputError: no probe can be asked for its program.
    """

    setup: Setup  # of the first repeat
    repeats: int = 1
    rest_s: float = 5.0  # between repeats
    rate_hz: float | None = None  # None: the instrument's usual one

    def __post_init__(self) -> None:
        """Refuse before anything is connected."""
        if self.setup.program is not None:
            check_measurable(self.setup.program)


def measure(
    source: LiveSource,
    plan: Plan,
    pipeline: Pipeline,
    clock: Callable[[], float] = time.monotonic,
    reconnect: Callable[..., Hello] = reconnect,
) -> None:
    """Run the plan; curves and results go to the pipeline's listeners.

    Each loading counts as the next cycle of the site. Where the link is lost and comes back, the
    curve that was cut stays, as a partial one, and its repeat is taken again after the rest.
    Whatever goes wrong, the probe is told to vent and what was measured has reached the pipeline.

    Raises:
        AcquisitionError: the probe or its link failed, or the driver had to vent.
    """
    watch = _Watch()
    setup = plan.setup
    outages = 0
    repeat = 0
    try:
        while repeat < plan.repeats:
            watch.ran = False
            try:
                if setup is not plan.setup:
                    _rest(source, pipeline, watch, clock, plan.rest_s)
                source.arm(setup, plan.rate_hz)
                source.start()
                _until_vented(source, pipeline, watch)
            except LinkError:
                outages += 1
                if (watch.lost is None and source.probe.is_open) or outages > MOST_OUTAGES:
                    raise
                _get_back(source, pipeline, watch, reconnect, clock)
                setup = replace(setup, cycle=setup.cycle + int(watch.ran))
                continue
            repeat += 1
            setup = replace(setup, cycle=setup.cycle + 1, repeat=setup.repeat + 1)
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
        self.lost: str | None = None  # why the link is lost
        self.alarmed = False  # since it was lost
        self.restored = False
        self.confirmed = False  # a vent, since it was lost
        self.ran = False

    def see(self, event: object) -> None:
        match event:
            case LinkLost(reason):
                # Nobody can confirm a vent over a dead link; the instrument's own limit vents.
                self.lost = f"{reason}; no vent is confirmed: look at the probe, lift it"
                self.restored = self.confirmed = False
            case LinkRestored():
                self.restored = True
            case VentConfirmed():
                self.confirmed = True
            case Alarm() if self.lost is not None:
                self.alarmed = True
            case Alarm(text):
                self.trouble = text
            case HostVented(reason) if self.lost is None:
                self.trouble = self.trouble or f"{reason}; the probe was told to vent"
            case State(InstrumentState.RUNNING):
                self.ran = True
            case _:
                pass

    def check(self) -> None:
        if self.trouble is not None:
            raise AcquisitionError(self.trouble)
        if self.lost is not None:
            raise LinkError(self.lost)

    def found(self) -> None:
        """Note that the link is back, and that its loss did no harm."""
        self.lost, self.alarmed = None, False


def _get_back(
    source: LiveSource,
    pipeline: Pipeline,
    watch: _Watch,
    reconnect: Callable[..., Hello],
    clock: Callable[[], float],
) -> None:
    """Wait for the link, and for the instrument to say that there is no suction any more.

    Raises:
        AcquisitionError: the link did not come back, or the suction is still there.
    """

    def wait(seconds: float) -> None:
        end = clock() + seconds
        while (left := end - clock()) > 0:
            _take(source, pipeline, watch, min(left, _POLL_S))

    while _take(source, pipeline, watch, 0.0):  # so that it is told at once
        pass
    try:
        reconnect(source.probe, sleep=wait)
    except DriverError as error:
        raise AcquisitionError(f"{watch.lost or 'the link is lost'}; {error}") from error
    end = clock() + _VENT_PATIENCE_S
    while not (watch.restored and (watch.confirmed or not watch.alarmed)):
        if not _take(source, pipeline, watch, _POLL_S) and clock() > end:
            raise AcquisitionError(source.probe.alarm or "the link is lost again")
    # The alarm was that nobody could see the vacuum go; now the instrument has shown that it went.
    source.probe.acknowledge_alarm()
    watch.found()


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
