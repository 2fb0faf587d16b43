"""Identify each file as it lands in a folder, and keep the session of all of them on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from skinlab.acquisition.pipeline import Pipeline
from skinlab.curves.curve import Setup
from skinlab.errors import InputError
from skinlab.exchange.importing.folder import Arrival, Folder
from skinlab.exchange.importing.questions import Answers
from skinlab.exchange.importing.reader import Imported, import_bytes
from skinlab.exchange.importing.session import Who, imported_session, write_session
from skinlab.inference.identify import Identifier
from skinlab.inference.result import Identification
from skinlab.recording.stream import Identified, Message


@dataclass(frozen=True, eq=False)
class Landed:
    """What became of one file; `imported` is None where the result says why it was not read."""

    path: Path
    result: Identification
    imported: Imported | None
    lay_there: bool = False  # before anybody watched


class Watch:
    """Files in, results out; after each file the session at `out` holds all curves so far."""

    def __init__(
        self,
        out: Path,
        setup: Setup,
        answers: Answers,
        identifier: Identifier,
        who: Who,
        measured: str = "",
    ) -> None:
        """`measured` is when all of it was measured; "": as its first file lands."""
        self.out = out
        self.landed: list[Landed] = []
        self._setup = setup
        self._answers = answers
        self._identifier = identifier
        self._pipeline = Pipeline(identifier, [self._hear])
        self._heard: Identification | None = None
        self._who = who
        self._stated = measured
        self._first_s: float | None = None  # Unix time at which the first good file landed
        self._saved = self._unsaved = False

    def take(self, arrival: Arrival) -> Landed:
        """Identify a file; one that cannot be read gives a result with an error."""
        same = [k for k, one in enumerate(self.landed) if one.path == arrival.path]
        # What failed, or was only the beginning of this one, is replaced by it.
        replaced = same and (arrival.continues or self.landed[same[-1]].imported is None)
        at = same[-1] if replaced else len(self.landed)
        landed = self._identified(arrival, at)
        if self._first_s is None and landed.imported is not None:
            self._first_s = self._who.now()
        self.landed[at : at + 1] = [landed]
        self._unsaved = self._unsaved or landed.imported is not None
        return landed

    def _hear(self, message: Message) -> None:
        if isinstance(message, Identified):
            self._heard = message.result

    def _identified(self, arrival: Arrival, at: int) -> Landed:
        path = arrival.path
        try:
            imported = import_bytes(path, arrival.data, self._setup, self._answers)
            self._check_new(path, imported, at)
            times = sum(one.path == path and one.imported is not None for one in self.landed)
            if times and not arrival.continues:
                name = f"{imported.curve.name} ({times + 1})"
                imported = replace(imported, curve=replace(imported.curve, name=name))
            number = 1 + sum(one.imported is not None for one in self.landed[:at])
            self._pipeline.complete(number, imported.curve)
            assert self._heard is not None  # a pipeline with an identifier always answers
            return Landed(path, self._heard, imported, arrival.lay_there)
        except InputError as error:
            return Landed(path, Identification(path.name, self._setup, str(error)), None)

    def _check_new(self, path: Path, imported: Imported, at: int) -> None:
        """Refuse a copy: each curve counts as data of its own."""
        for k, one in enumerate(self.landed):
            if k != at and one.imported is not None and one.imported.sha256 == imported.sha256:
                raise InputError(
                    f"{path}: the same readings as {one.imported.curve.name}; expected each curve "
                    "once"
                )

    def _measured(self) -> str:
        """Return when the session was measured; "" where a file may be of any day."""
        of_any_day = any(one.lay_there and one.imported is not None for one in self.landed)
        if self._stated or self._first_s is None or of_any_day:
            return self._stated
        return datetime.fromtimestamp(self._first_s, UTC).isoformat()

    def save(self) -> Path | None:
        """Write the session; None where there is no curve.

        Raises:
            InputError: it cannot be written.
        """
        good = [(one.imported, one.result) for one in self.landed if one.imported is not None]
        if self._unsaved:
            session = imported_session(
                [imported for imported, _ in good],
                [result for _, result in good],
                self._identifier,
                self._who,
                self._measured(),
            )
            write_session(self.out, session, replace=self._saved)
            self._saved, self._unsaved = True, False
        return self.out if good else None


def watch(
    folder: Folder,
    watcher: Watch,
    tell: Callable[[Landed], None],
    trouble: Callable[[str], None],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
    check: Callable[[], None],
    poll_s: float = 0.5,
) -> None:
    """Take files until `check` raises, which is called between two files and two looks.

    `tell` gets each file's outcome, `trouble` a sentence where the session could not be written,
    which the next file tries again. At the end `watcher.save` is the caller's.

    Raises:
        InputError: the folder is gone.
        KeyboardInterrupt: of `check`; the file in hand is identified and kept.
    """
    while True:
        check()
        for arrival in folder.poll(clock()):
            tell(watcher.take(arrival))
            try:
                watcher.save()
            except InputError as error:
                trouble(str(error))
            check()
        sleep(poll_s)
