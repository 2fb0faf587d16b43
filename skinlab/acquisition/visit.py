"""A session that is being recorded: its journal, its curves, their results."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from skinlab.acquisition.identification_worker import IdentificationWorker, IdentifierApart
from skinlab.acquisition.pipeline import Listener, Pipeline
from skinlab.recording.recorder import Recording
from skinlab.recording.stream import Identified, Item, Message

if TYPE_CHECKING:
    from skinlab.inference.identify import Identifier
    from skinlab.inference.result import Identification


class Visit:
    """One subject, one site, from the first arming on; several probes, one after the other.

    One thread hands items in and takes answers; `audit` is for any.
    """

    def __init__(
        self,
        recording: Recording,
        identifier: Identifier,
        worker: Identifier | IdentifierApart,
        listener: Listener,
        estimated: Callable[[int, Identification], None],
        *,
        simulated: bool,
        dialect: dict[str, Any],
    ) -> None:
        """`worker` does what `identifier` would; `estimated` hears of growing curves."""
        self.recording = recording
        self.identifier = identifier
        self.simulated = simulated
        self.dialect = dialect  # as the session has it: bytes of another one have no place in it
        self.unsaved = False  # something came since the file was last written
        self._worker = IdentificationWorker(worker, estimated)
        listeners: list[Listener] = [recording, self._note, listener, self._worker.listen]
        self._pipeline = Pipeline(identifier, listeners, self._worker.hand_over)

    @property
    def busy(self) -> bool:
        """Whether a result is still to come."""
        return self._worker.busy

    def handle(self, item: Item) -> None:
        """Take one item of the probe.

        Raises:
            Exception: a bug in assembling or judging.
        """
        self._pipeline.handle(item)

    def take_result(self, *, wait: bool = False) -> bool:
        """Pass the next result on; False: there is none yet, or, waiting, none to come.

        Raises:
            Exception: a bug in identifying.
        """
        found = self._worker.take(wait=wait)
        if found is None:
            return False
        self._pipeline.identified(*found)
        return True

    def audit(self, what: str, **detail: Any) -> None:
        """Record in the session's audit trail.

        Raises:
            InputError: it cannot be written.
        """
        self.recording.audit(what, **detail)
        self.unsaved = True

    def end_connection(self) -> None:
        """Complete what is under way, and wait for its results."""
        self._pipeline.end("the connection ended")
        while self.take_result(wait=True):
            pass

    def save(self) -> None:
        """Write the session as it is by now; the journal goes on.

        Raises:
            InputError: it cannot be written.
        """
        self.unsaved = False
        self.recording.save()

    def close(self) -> None:
        """Let no more be identified; what is under way is finished."""
        self._worker.close()

    def _note(self, message: Message) -> None:
        self.unsaved = self.unsaved or isinstance(message, Identified)
