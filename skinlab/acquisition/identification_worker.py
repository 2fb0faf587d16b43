"""Identifies in a thread of its own, so that nothing that comes from the probe waits for it.

The computing may be done in a process of its own as well (`IdentifierApart`): in a thread it holds
the interpreter that draws, reads keys and keeps the probe alive. At 160x50 every frame took twice
as long.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.events import Sample
from skinlab.curves.curve import Curve
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.settings import SAMPLES
from skinlab.io.log import log_exception
from skinlab.recording.stream import CurveCompleted, CurveStarted, Message, Sampled
from skinlab.workers import Worker

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Identification

    Answer = tuple[int, Curve, Identification]

_EVERY_S = 0.3  # between two estimates of a growing curve
_END_S = 0.4  # of the program: no estimate is begun so late, the answer would wait for it


class IdentifierApart:
    """Answers as an identifier does, in a process of its own while that lives."""

    def __init__(self, identifier: Identifier) -> None:
        self.identifier = identifier
        self._worker = Worker(identifier)

    @property
    def phases(self) -> tuple[str, ...]:
        """What of a curve is fitted."""
        return self.identifier.phases

    @property
    def pid(self) -> int | None:
        """The number of the process; None: this one does the work."""
        return self._worker.pid

    def __call__(self, curve: Curve) -> Identification:
        """Return the answer for a curve."""
        return self._worker.call(_identify, curve)  # type: ignore[no-any-return]

    def growing(self, curve: Curve, before: Identification | None = None) -> Identification:
        """Return an estimate of a curve that is not complete."""
        return self._worker.call(_estimate, curve, before)  # type: ignore[no-any-return]

    def warm(self) -> None:
        """Let the process load all that it loads for a first curve, which takes as long as two."""
        self._worker.call(_warm)

    def close(self) -> None:
        """Let the process end."""
        self._worker.close()


def _warm(identifier: Identifier) -> None:
    from skinlab.recording.session import example_session, read_session

    identifier(read_session(example_session()).curves[0])


def _identify(identifier: Identifier, curve: Curve) -> Identification:
    return identifier(curve)


def _estimate(
    identifier: Identifier, curve: Curve, before: Identification | None
) -> Identification:
    return identifier.growing(curve, before)


@dataclass(slots=True)
class _Growing:
    index: int
    curve: GrowingCurve
    estimate: Identification | None = None


class IdentificationWorker:
    """Takes completed curves (`hand_over`) and gives answers (`take`), in order.

    As a listener it follows the running curve and tells an estimate of it now and then, from its
    thread, to `tell`. All other methods are for one thread.
    """

    def __init__(
        self,
        identifier: Identifier | IdentifierApart,
        tell: Callable[[int, Identification], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._identifier = identifier
        self._tell = tell
        self._clock = clock
        self._wake = threading.Condition()
        self._curves: deque[tuple[int, Curve]] = deque()
        self._sketch: tuple[_Growing, Curve] | None = None  # the newest one only
        self._answers: deque[Answer] = deque()
        self._outstanding = 0
        self._sketched_s = -_EVERY_S  # when the last estimate was ready
        self._sketching = False
        self._error: Exception | None = None
        self._closed = False
        self._growing: _Growing | None = None
        self._thread = threading.Thread(target=self._work, name="identification", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether an answer is still to be taken."""
        return self._outstanding > 0

    def listen(self, message: Message) -> None:
        """Follow the running curve."""
        match message:
            case CurveStarted(index, curve):
                self._growing = _Growing(index, curve)
            case Sampled(index, sample) if self._growing and self._growing.index == index:
                self._grow(self._growing, sample)
            case CurveCompleted():
                self._growing = None
            case _:
                pass

    def hand_over(self, index: int, curve: Curve) -> None:
        """Take a completed curve."""
        self._outstanding += 1
        with self._wake:
            self._sketch = None
            self._curves.append((index, curve))
            self._wake.notify_all()

    def take(self, *, wait: bool = False) -> Answer | None:
        """Return the next answer; None where there is none yet, or, waiting, none to come.

        Raises:
            Exception: the identification failed; a bug.
        """
        with self._wake:
            while wait and self._outstanding and not self._answers and self._error is None:
                self._wake.wait()
            if self._error is not None:
                error, self._error, self._outstanding = self._error, None, 0
                raise error
            if not self._answers:
                return None
            self._outstanding -= 1
            return self._answers.popleft()

    def close(self) -> None:
        """End the thread; what is under way is finished."""
        with self._wake:
            self._closed = True
            self._wake.notify_all()
        self._thread.join()

    def _grow(self, growing: _Growing, sample: Sample) -> None:
        program = growing.curve.setup.program
        if program is not None:
            if self._identifier.phases == ("load",) and sample.segment not in program.first_load:
                return  # nothing that is fitted comes any more
            if sample.device_time_s > program.duration_s - _END_S:
                return
        due = self._clock() >= self._sketched_s + _EVERY_S
        enough = len(growing.curve) >= SAMPLES.fewest
        if due and enough and not self._sketching and self._sketch is None:
            curve = growing.curve.curve(f"curve {growing.index}")
            with self._wake:
                self._sketch = (growing, curve)
                self._wake.notify_all()

    # ---- the thread -------------------------------------------------------------------------

    def _work(self) -> None:
        while True:
            with self._wake:
                while not (self._curves or self._sketch or self._closed):
                    self._wake.wait()
                if self._curves:
                    job: tuple[int, Curve] | tuple[_Growing, Curve] = self._curves.popleft()
                elif self._sketch is not None and not self._closed:
                    job, self._sketch = self._sketch, None
                    self._sketching = True
                else:
                    return
            try:
                self._do(*job)
            except Exception as error:  # noqa: BLE001 -- handed to the thread that takes the answers
                with self._wake:
                    self._error = error
                    self._outstanding = max(self._outstanding, 1)
                    self._wake.notify_all()

    def _do(self, of: int | _Growing, curve: Curve) -> None:
        if isinstance(of, int):
            result = self._identifier(curve)
            with self._wake:
                self._answers.append((of, curve, result))
                self._wake.notify_all()
            return
        try:
            of.estimate = self._identifier.growing(curve, of.estimate)
        except Exception as error:  # noqa: BLE001 -- a sketch less: nothing that is measured needs it
            log_exception(error)
        else:
            self._tell(of.index, of.estimate)
        self._sketching, self._sketched_s = False, self._clock()
