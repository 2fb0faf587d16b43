"""Which software, settings, database and files stand behind a report."""

from __future__ import annotations

import json
from collections.abc import Sequence

from skinlab.inference.identify import Identifier
from skinlab.recording.session import Session, content_hash
from skinlab.report.page import Section, Table
from skinlab.versions import versions

_TOLD = {  # facts of a session that have a place of their own
    "created_utc", "measured_utc", "skinlab_version", "versions", "subject", "site", "instrument",
    "identification", "imported", "dialect", "control",
}  # fmt: skip

_WORDS = (
    "Numbers are those that the session stores. Fitted curves, which it does not store, and "
    "findings of the quality gates were computed again for this page. “skinlab session verify” "
    "checks the session's hash and audit trail, “skinlab replay --verify” identifies it again, "
    "“skinlab export --to csv” gives the samples. skinlab was not yet tested with "
    "real hardware; it is no medical device."
)


def provenance_section(
    session: Session, identifier: Identifier | str, file: str | None = None
) -> Section:
    """Return versions, hashes, imported files and all other facts that the session records.

    `file` is what it is recorded in.
    """
    meta = session.meta
    tables = [_versions(meta.get("versions")), _hashes(session, identifier)]
    imported = meta.get("imported")
    if isinstance(imported, list):
        tables.append(Table(("imported file", "sha256", "understood"), _imported(imported)))
    facts = [] if file is None else [("file", file)]
    facts += [
        (f"{name}: {key}", _fact(value))
        for name in ("instrument", "dialect", "identification")
        for key, value in _items(meta.get(name))
        if key != "toml"  # a whole file; its hash tells it
    ]
    # The page's head has when it was measured; when it was imported is said here
    told = _TOLD if imported is None else _TOLD - {"created_utc"}
    facts += [(key, _fact(value)) for key, value in meta.items() if key not in told]
    if facts:
        tables.append(Table(("recorded", "value"), facts))
    return Section("Versions and hashes", (_WORDS,), tables)


def _versions(stated: object) -> Table:
    then, now = dict(_items(stated)), versions()
    rows = [
        (name, str(then.get(name, "not recorded")), now.get(name, "–"))
        for name in dict.fromkeys([*now, *then])
    ]
    return Table(("version", "of the session", "of this page"), rows)


def _hashes(session: Session, identifier: Identifier | str) -> Table:
    rows = [("session, all that it holds", content_hash(session))]
    settings = dict(_items(session.meta.get("identification")))
    if settings and not isinstance(identifier, str):
        provenance = identifier.provenance()
        rows += [
            ("model", provenance.model_hash),
            ("database, as recorded", str(settings.get("database_hash"))),
            ("database, of this page", provenance.database_hash),
        ]
    return Table(("hash of", "value"), rows)


def _items(value: object) -> list[tuple[str, object]]:
    return list(value.items()) if isinstance(value, dict) else []


def _fact(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _imported(files: Sequence[object]) -> list[tuple[str, str, str]]:
    rows = []
    for entry in files:
        known = entry if isinstance(entry, dict) else {}
        understood = known.get("understood")
        sentences = understood if isinstance(understood, list) else []
        rows.append(
            (str(known.get("file")), str(known.get("sha256")), "; ".join(map(str, sentences)))
        )
    return rows
