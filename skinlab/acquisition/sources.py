"""Where items come from when they are live: a probe, and the plans for it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator

from drivers.errors import LimitError
from drivers.events import Segment, SegmentKind
from drivers.limits import CANNOT_UNTIL
from drivers.probe import Probe
from skinlab.curves.curve import Setup
from skinlab.curves.program import MOST_SUCTION_S, Hold, Program, Ramp, Release, Until
from skinlab.errors import InputError
from skinlab.recording.journal import Journal
from skinlab.recording.stream import Item, Planned, setup_to_json


def wire_segments(program: Program) -> tuple[Segment, ...]:
    """Return the program as the driver speaks it."""
    segments = []
    for s in program.segments:
        if isinstance(s, Ramp):
            segments.append(
                Segment(
                    SegmentKind.RAMP,
                    target_mbar=s.target_mbar,
                    rate_mbar_per_s=s.rate_mbar_per_s,
                )
            )
        elif isinstance(s, Until):
            segments.append(
                Segment(
                    SegmentKind.UNTIL,
                    target_mbar=s.most_mbar,
                    rate_mbar_per_s=s.rate_mbar_per_s,
                    height_mm=s.height_mm,
                )
            )
        elif isinstance(s, Release):
            segments.append(Segment(SegmentKind.RELEASE))
        else:
            kind = SegmentKind.HOLD if isinstance(s, Hold) else SegmentKind.REST
            segments.append(Segment(kind, duration_s=s.duration_s))
    return tuple(segments)


def check_opening(setup: Setup, opening_mm: float | None) -> None:
    """Refuse what is planned for another opening than the probe says that it has.

    Raises:
        InputError: so.
    """
    if opening_mm is not None and abs(opening_mm - setup.aperture_mm) > 1e-6:
        raise InputError(f"aperture_mm {setup.aperture_mm:g}: the probe has {opening_mm:g} mm")


class LiveSource:
    """A probe, and the plans for it."""

    def __init__(
        self,
        probe: Probe,
        journal: Journal | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.probe = probe
        self.journal = journal  # there may be none yet
        self._clock = clock
        self._planned: deque[Planned] = deque()
        self._program: Program | None = None  # of what was planned last

    @property
    def read_only(self) -> bool:
        """Whether the instrument only streams, so that somebody starts it there."""
        return self.probe.read_only

    def arm(self, setup: Setup, rate_hz: float | None = None) -> None:
        """Plan a run and make the probe ready for it; `rate_hz` None: the instrument's usual one.

        Raises:
            InputError: the setup has no program, or not this probe's aperture, or is beyond its
                limits; or the disk has no room for the record.
            DriverError: the probe refused, or its link failed.

        What only streams is not made ready: it is noted what the next curve belongs to.
        """
        hello = self.probe.hello
        if setup.program is None and not self.read_only:
            raise InputError("a measurement needs a program")
        check_opening(setup, None if hello is None else hello.aperture_mm)
        if setup.program is not None and setup.program.stops_at_heights:
            self._check_heights(setup.program)
        rate = rate_hz if rate_hz is not None else hello.default_rate_hz if hello else 20.0
        if self.journal is not None:
            duration_s = MOST_SUCTION_S if setup.program is None else setup.program.duration_s
            self.journal.require_room(duration_s, rate)
        if setup.program is not None and not self.read_only:
            try:
                self.probe.load(wire_segments(setup.program), rate)
            except LimitError as error:
                raise InputError(str(error)) from None
        if self.journal is not None:
            self.journal.plan(self._clock(), setup_to_json(setup))
        self._planned.append(Planned(setup))
        self._program = setup.program
        if not self.read_only:
            self.probe.arm()

    def _check_heights(self, program: Program) -> None:
        if not self.probe.abilities.until:
            hello = self.probe.hello
            name = "this instrument" if hello is None else hello.model
            raise InputError(f"program {program}: {name} {CANNOT_UNTIL}")

    def start(self) -> None:
        """Start the armed run; wait for it where somebody starts it at the instrument.

        Raises:
            DriverError: the probe refused, or its link failed.
        """
        if self.read_only:
            program = self._program
            self.probe.follow(None if program is None else wire_segments(program))
        else:
            self.probe.start()

    def next_item(self, timeout_s: float) -> Item | None:
        """Return the next item, or None where none came in time."""
        if self._planned:
            return self._planned.popleft()
        return self.probe.next_event(timeout_s)

    def come_by_now(self) -> Iterator[Item]:
        """Give the items that are there, and none that comes meanwhile: a flood has no end."""
        for _ in range(len(self._planned) + self.probe.waiting):
            item = self.next_item(0.0)
            if item is not None:
                yield item
