"""Measure without a screen: acquire repeats, identify each curve as it completes."""

from __future__ import annotations

import time
from collections.abc import Callable

from drivers.errors import DriverError
from skinlab.acquisition.measurement import Policy
from skinlab.acquisition.measurement_messages import (
    Acknowledge,
    Arm,
    Continue,
    Over,
    Phase,
    Plan,
    Refused,
    Report,
    Start,
)
from skinlab.acquisition.pipeline import Pipeline
from skinlab.acquisition.runner import Runner
from skinlab.acquisition.shutdown import HeldInterrupt
from skinlab.acquisition.sources import LiveSource
from skinlab.errors import AcquisitionError


def measure(
    source: LiveSource,
    plan: Plan,
    pipeline: Pipeline,
    clock: Callable[[], float] = time.monotonic,
    policy: Policy | None = None,
    acknowledged: Callable[[str], None] = lambda _: None,
    waits: Callable[[], None] = lambda: None,
) -> None:
    """Run the plan; curves and results go to the pipeline's listeners.

    The rules are those of the screen (`Measurement`). What a person decides there is decided here
    by having begun: an alarm for a lost link is acknowledged once the vent was seen, and the repeat
    that was cut is taken again; `acknowledged` gets the alarm's text. `waits` is called many times
    a second. Whatever goes wrong, the probe is told to vent and what was measured has reached the
    pipeline.

    Raises:
        AcquisitionError: the probe or its link failed, or the driver had to vent.
        InputError: the plan does not fit the probe.
        KeyboardInterrupt: a signal came; the probe was told to vent at once.
    """
    ends: list[Over] = []

    def report(said: Report | Phase) -> None:
        match said:
            case Over():
                ends.append(said)
            case Refused(why):
                ends.append(Over(why))
            case _:
                pass

    runner = Runner(source, pipeline.handle, report, policy, clock)
    with HeldInterrupt(runner.vent) as held:
        try:
            runner.catch_up()  # what came before is not about this plan
            runner.ask(Arm(plan), Start())
            while not ends:
                runner.step()
                held.check()
                waits()
                if runner.phase is Phase.INTERRUPTED:
                    if (alarm := source.probe.alarm) is not None:
                        acknowledged(alarm)
                    runner.ask(Acknowledge(), Continue())
        finally:
            try:
                runner.close()
            finally:
                pipeline.end()
    _raise(ends[0])


def _raise(over: Over) -> None:
    if isinstance(over.error, DriverError):
        raise AcquisitionError(str(over.error)) from over.error
    if over.error is not None:
        raise over.error
    if over.failed is not None:
        raise AcquisitionError(over.failed)
