"""What is computed beside the measurement: fits of several curves, comparisons, missing effects.

Everything here is slow, and called in threads of its own.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from skinlab.acquisition.explainer import Explainer
from skinlab.acquisition.gc_tuning import shorten_pauses
from skinlab.acquisition.identification_worker import IdentifierApart
from skinlab.acquisition.messages import (
    Adopted,
    Explained,
    Explaining,
    Fitted,
    News,
)
from skinlab.curves.curve import Curve
from skinlab.errors import AcquisitionError, NotTrustworthyError

if TYPE_CHECKING:
    from skinlab.curves.campaign import Campaign
    from skinlab.curves.curve import Setup
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.inference.identify import Identifier
    from skinlab.mechanics.model_file import Model


_LOOKED_AT = 101  # samples of a program, to see whether a database speaks of them


class Explain(Protocol):
    """Looks for what the model misses; can be cancelled."""

    def __call__(
        self,
        campaign: Campaign,
        model: Model,
        tell: Callable[[str], None],
        database_path: Path | None,
        /,
    ) -> Outcome | None:
        """Return the answer; None: it was cancelled. No path: with the shipped database."""

    def cancel(self) -> None:
        """Give up."""


class Trail(Protocol):
    """The session that is open, if there is one."""

    @property
    def recorded_with(self) -> Identifier | None:
        """What its curves are identified with; None: no session is open."""

    def audit(self, what: str, **detail: Any) -> None:
        """Record what the operator decided."""


def default_identifier() -> Identifier:
    """Return the identifier with the defaults of the command line; slow to import."""
    from skinlab.inference.identify import Identifier
    from skinlab.tables.store import shipped_table

    return Identifier(shipped_table())


class Analysis:
    """Identifies with one model at a time; answers are posted.

    `apart`: curves are identified in another process. Any thread may call.
    """

    def __init__(
        self,
        folder: Path,
        post: Callable[[News], None],
        trail: Trail,
        *,
        make_identifier: Callable[[], Identifier] = default_identifier,
        explain: Explain | None = None,
        apart: bool = False,
        now: Callable[[], datetime] = datetime.now,
    ) -> None:
        self._folder = folder
        self._post = post
        self._trail = trail
        self._make_identifier = make_identifier
        self._explain = Explainer() if explain is None else explain
        self._apart = apart
        self._now = now
        self._loading = threading.Lock()
        self._identifier: Identifier | None = None
        self._process: IdentifierApart | None = None
        self._replaced: list[Identifier] = []  # by adopted models

    @property
    def identifier(self) -> Identifier:
        """What curves are identified with from now on; the first time, this is slow."""
        with self._loading:
            if self._identifier is None:
                self._identifier = self._make_identifier()
                shorten_pauses()
            return self._identifier

    @property
    def law(self) -> str | None:
        """Name of the law that curves are identified with; None: not prepared yet. Never slow."""
        identifier = self._identifier
        return None if identifier is None else identifier.database.law

    def complaint(self, setup: Setup) -> str | None:
        """Return why a curve of this setup would have no whole answer; None: nothing is known.

        Never slow: nothing is known before the identifier is there.
        """
        identifier, program = self._identifier, setup.program
        if identifier is None or program is None:
            return None
        times, pressures = program.knots()
        time_s = np.linspace(0.0, times[-1], _LOOKED_AT)
        such = Curve("it", setup, time_s, np.interp(time_s, times, pressures), 0.0 * time_s)
        try:
            covered = identifier.database.covers(such)
        except NotTrustworthyError as error:
            return f"no answer: {str(error).removeprefix('it: ')}"
        return None if covered.all() else "part of the curve will lie outside the database"

    def use(self, identifier: Identifier) -> None:
        """Identify with this one: a record says what it was identified with."""
        with self._loading:
            self._identifier = identifier

    def worker(self, identifier: Identifier) -> Identifier | IdentifierApart:
        """Return what identifies curves as this identifier does."""
        if not self._apart:
            return identifier
        with self._loading:
            if self._process is None or self._process.identifier is not identifier:
                if self._process is not None:
                    self._process.close()
                self._process = IdentifierApart(identifier)
            return self._process

    def prepare(self) -> None:
        """Load what identification needs."""
        worker = self.worker(self.identifier)
        if isinstance(worker, IdentifierApart):
            worker.warm()

    def fit_together(self, curves: Sequence[Curve]) -> None:
        """Post one answer for several curves.

        Raises:
            SkinlabError: it cannot be computed.
        """
        self._post(Fitted(self.identifier.together(curves)))

    def explain(self, curves: Sequence[Curve]) -> None:
        """Look for what the model misses in these curves; post each stage, and the answer.

        Raises:
            SkinlabError: there is none.
        """
        from skinlab.curves.campaign import Campaign

        identifier = self.identifier
        sensor = identifier.sensor
        true = tuple(identifier.corrected(curves))
        campaign = Campaign("", sensor.noise_um, sensor.pressure_noise_mbar, true)
        outcome = self._explain(
            campaign,
            identifier.model,
            lambda stage: self._post(Explaining(stage)),
            identifier.database.path,
        )
        if outcome is not None:
            self._post(Explained(outcome))

    def stop_explaining(self) -> None:
        """Give the search up; at once."""
        self._explain.cancel()

    def adopt(self, outcome: Outcome, session: Path | None) -> None:
        """Write the model with the missing effect, and identify with it from the next session on.

        `session` is the file that the curves are in, where there is one.

        Raises:
            SkinlabError: it cannot be written.
        """
        from skinlab.acquisition.adopting import write_adopted
        from skinlab.discrepancy.model_identifier import with_model

        identifier = self.identifier
        path, model = write_adopted(
            outcome, identifier.model, self._folder, session, identifier.database, self._now()
        )
        if self._trail.recorded_with is not None:
            self._trail.audit("model adopted", file=path.name, hash=model.hash)
        self._replaced.append(identifier)
        self.use(with_model(identifier, model))
        self._post(Adopted(path, model.model.name, anew=self._another_model))

    def undo_adoption(self) -> None:
        """Identify with the model that was replaced last; the written file stays.

        Raises:
            SkinlabError: no model was adopted, or it cannot be recorded.
        """
        if not self._replaced:
            raise AcquisitionError("no model was adopted: there is nothing to undo")
        if self._trail.recorded_with is not None:
            self._trail.audit("model adoption undone")
        identifier = self._replaced.pop()
        self.use(identifier)
        self._post(Adopted(None, identifier.model_name, anew=self._another_model))

    @property
    def _another_model(self) -> bool:
        """Whether the open session was identified with another model than is used now."""
        recorded_with = self._trail.recorded_with
        return recorded_with is not None and recorded_with is not self._identifier

    def close(self) -> None:
        """Give up what is under way."""
        self._explain.cancel()
        if self._process is not None:
            self._process.close()
