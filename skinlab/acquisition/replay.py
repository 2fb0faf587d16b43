"""Replay a session: the recorded bytes through dialect, assembler and identification."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from drivers.events import Sample, TimedEvent
from skinlab.acquisition.pipeline import Listener, Pipeline
from skinlab.acquisition.replay_control import ReplayControl
from skinlab.curves.curve import Curve
from skinlab.curves.probe_file import ProbeErrors, decode_probe
from skinlab.discrepancy.model_identifier import with_model
from skinlab.errors import InputError
from skinlab.inference.custom_table import with_custom_table
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import METHODS, get_method
from skinlab.inference.population import decode_prior, with_prior
from skinlab.inference.problem import Options, check
from skinlab.inference.result import Identification
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.model_file import decode_model
from skinlab.recording.recorded_items import dialect_of, recorded_items
from skinlab.recording.session import Session
from skinlab.recording.stream import CurveCompleted, Message
from skinlab.tables.store import read, shipped_grid, shipped_table
from skinlab.tables.table import Table
from skinlab.versions import missing_plugins, versions

# Settings that sessions did not record at first, where they were others than today's defaults.
_BEFORE: dict[str, dict[str, int | float | str]] = {"rls": {"passes": 500}}


class _Prior(msgspec.Struct):
    """The population that was the prior: its file's text, and what was known of the person."""

    toml: str
    site: str | None = None
    age_years: float | None = None


class _Settings(msgspec.Struct):
    """What a session says of its identification; defaults: what it did not record at first."""

    method: str
    seed: Annotated[int, Meta(ge=0)]
    kappa: Literal["paper", "consistent"]
    phases: tuple[Literal["load", "hold", "unload", "rest"], ...]
    samples: int
    best: int
    tolerance_um: float
    options: dict[str, int | float | str] | None = None  # once beside the others, of all methods
    model: str | None = None
    noise_um: Annotated[float, Meta(gt=0, lt=1e6)] | None = None
    pressure_noise_mbar: Annotated[float, Meta(ge=0, lt=1e3)] | None = None
    database_hash: str | None = None
    database_path: str | None = None  # where it was, of one that does not ship
    prior: _Prior | None = None
    probe: str | None = None  # the text of its file


def identifier_of(
    session: Session, database_path: Path | None = None
) -> tuple[Identifier, str | None]:
    """Return the identifier that the session was recorded with.

    Its database is the one that the session names by hash: one that ships, or the file that it was
    then; `database_path` is where that is now. The second value is a sentence where the database is
    another one, so that results may differ.

    Raises:
        InputError: the session does not say how it was identified, or its database or a plugin is
            not there.
    """
    try:
        return _identifier_of(session, database_path)
    except InputError as error:
        missing = missing_plugins(session.meta.get("versions"), told=str(error))
        if not missing:
            raise
        raise InputError(f"{error}; {missing}") from None


def _identifier_of(session: Session, database_path: Path | None) -> tuple[Identifier, str | None]:
    settings = session.meta.get("identification")
    if settings is None and is_imported(session):
        # Nothing was identified, nothing can differ
        table = _database(None, None, database_path)
        identifier = Identifier(table)
        if table.spec.model is not None:
            identifier = with_custom_table(identifier, table, phases_said=False)
        return identifier, None
    if not isinstance(settings, dict):
        raise InputError("the session does not say how it was identified")
    try:
        said = msgspec.convert(settings, _Settings)
    except ValueError as error:
        raise _damaged(error) from None
    options = _options(said, settings)
    stated = said.database_hash
    database = _database(stated, said.database_path, database_path)
    identifier = Identifier(
        database,
        method=said.method,
        options=options,
        seed=said.seed,
        kappa=said.kappa,
        phases=said.phases,
        sensor=Sensor(said.noise_um, said.pressure_noise_mbar, probe=_probe(said.probe)),
    )
    if database.spec.model is not None:
        identifier = with_custom_table(identifier, database, phases_said=True)
    elif said.model is not None:
        model = decode_model(said.model, "the session's field identification.model")
        identifier = with_model(identifier, model)
    if said.prior is not None:
        where = "the session's field identification.prior"
        known = decode_prior(said.prior.toml, where, said.prior.site, said.prior.age_years)
        identifier = with_prior(identifier, known)
    warning = None
    if database.content_hash != stated:
        warning = (
            f"the session was identified with another database, {stated}; here is "
            f"{database.content_hash}: results may differ"
        )
    return identifier, warning


def _damaged(error: ValueError) -> InputError:
    return InputError(f"the session's field identification is damaged ({error})")


def _probe(text: str | None) -> ProbeErrors | None:
    where = "the session's field identification.probe"
    return None if text is None else decode_probe(text, where)


def _database(stated: str | None, was: str | None, is_: Path | None) -> Table:
    """Return the database of this hash: the file that is asked for, one that ships, or as it was.

    Raises:
        InputError: the file is not there any more, is none, or is another one.
    """
    if is_ is not None:
        return read(is_)
    shipped = (shipped_table(), shipped_grid())
    found = next((d for d in shipped if d.content_hash == stated), None)
    if found is not None:
        return found
    if was is None:
        return shipped[0]  # an earlier version of it
    asked = f"the session was identified with the database {stated}, then in {was}"
    try:
        found = read(Path(was))
    except InputError as error:
        # One that is there, as of a law whose plugin is gone, is not to be named anew
        advice = "" if Path(was).is_file() else "; name it with --database"
        raise InputError(f"{asked} ({error}){advice}") from None
    if found.content_hash != stated:
        raise InputError(f"{asked}, where now is another one; name it with --database")
    return found


def _options(said: _Settings, settings: dict[str, Any]) -> Options:
    """Return the options of the method.

    Raises:
        InputError: there is no such method, or it does not take one of them.
    """
    try:
        method = get_method(said.method)
    except InputError as error:
        raise InputError(f"the session's field identification: {error}") from None
    try:
        options = Options(
            samples=said.samples,
            best=said.best,
            tolerance_um=said.tolerance_um,
        ).having(**_own(said, settings))
        check(options)
        with METHODS.at_work(method.name):
            method.check(options)
    except ValueError as error:  # InputError is one
        raise _damaged(error) from None
    return options


def _own(said: _Settings, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the method's own options: recorded together, once one by one, or not at all."""
    if said.options is not None:
        return said.options
    read = {option.name for option in get_method(said.method).options}
    return _BEFORE.get(said.method, {}) | {k: v for k, v in settings.items() if k in read}


def replay(
    session: Session,
    identifier: Identifier,
    listeners: Iterable[Listener],
    control: ReplayControl | None = None,
) -> list[Curve]:
    """Run the session through the pipeline; return the completed curves.

    Every event keeps the time at which it came. `control` says when it is passed on; None: at once.
    A replay that is stopped ends like a record that was cut off there.
    Imported curves have no bytes and no pace: they go through the identification as they are.
    """
    curves: list[Curve] = []

    def keep(message: Message) -> None:
        if isinstance(message, CurveCompleted):
            curves.append(message.curve)

    pipeline = Pipeline(identifier, [keep, *listeners])
    for item in recorded_items(session.records, dialect_of(session.meta)):
        if control is not None and isinstance(item, TimedEvent):
            sample = isinstance(item.event, Sample)
            if not control.wait(item.host_time_s, sample=sample):
                break
        pipeline.handle(item)
    pipeline.end("the record ends here")
    if is_imported(session):
        for number, curve in enumerate(session.curves, start=1):
            pipeline.complete(number, curve)
    return curves


def is_imported(session: Session) -> bool:
    """Return whether the session is made of curves that other software exported."""
    return "imported" in session.meta


def differences(
    session: Session,
    curves: list[Curve],
    results: list[Identification],
    rounding: float = 0.0,
) -> list[str]:
    """Return a sentence for each way in which the replay differs from what the session stores.

    Numbers of results that differ by no more than `rounding`, relative, are taken as the same.
    """
    found: list[str] = []
    if len(curves) != len(session.curves):
        found.append(f"stored curves: {len(session.curves)}; the replay gives {len(curves)}")
    for stored, again in zip(session.curves, curves, strict=False):
        for column in ("time_s", "pressure_mbar", "deflection_mm"):
            if not np.array_equal(getattr(stored, column), getattr(again, column)):
                found.append(f"{stored.name}: {column} differs")
        if stored.partial != again.partial:
            found.append(f"{stored.name}: is partial in one and not in the other")
    for curve, kept, result in zip(session.curves, session.results, results, strict=False):
        if kept is None:
            continue  # a recovered session: nothing to compare with
        now = result.to_json()
        for key in sorted({*kept} - {"seconds"}):  # later versions may say more
            if not _same(kept.get(key), now.get(key), rounding):
                found.append(f"{curve.name}: {key} was {kept.get(key)}, is {now.get(key)}")
    return found


def _same(was: Any, now: Any, rounding: float) -> bool:
    """Return whether two parts of a document are the same but for rounding."""
    if isinstance(was, dict) and isinstance(now, dict):
        return was.keys() == now.keys() and all(_same(was[k], now[k], rounding) for k in was)
    if isinstance(was, list) and isinstance(now, list):
        both = zip(was, now, strict=False)
        return len(was) == len(now) and all(_same(a, b, rounding) for a, b in both)
    if isinstance(was, float) and isinstance(now, float):
        return abs(was - now) <= rounding * max(abs(was), abs(now))
    return bool(was == now)


def reasons(session: Session, identifier: Identifier) -> list[str]:
    """Return what is not as it was when the session was recorded: why results may differ."""
    found = []
    settings = session.meta.get("identification") or {}
    database = identifier.database.content_hash
    if settings.get("database_hash") != database:
        found.append(f"another database: it was {settings.get('database_hash')}, is {database}")
    stated = session.meta.get("versions")
    then = stated if isinstance(stated, dict) else {}
    now = versions()
    plugins = [name for name in then if name.startswith("plugin ")]
    for name in dict.fromkeys([*now, *plugins]):
        was, is_ = then.get(name, "not recorded"), now.get(name, "not installed")
        if was != is_:
            what = f"another version of {_SAID.get(name, name)}"
            found.append(
                f"{'another machine' if name == 'machine' else what}: it was {was}, is {is_}"
            )
    return found


_SAID = {
    "skinlab": "skinlab",
    "code": "skinlab's source files",
    "python": "Python",
    "numpy": "numpy",
    "scipy": "scipy",
}
