"""`skinlab session`: check a session, or say what is in it."""

from __future__ import annotations

from pathlib import Path

import click

from skinlab.cli.groups import SuggestingGroup
from skinlab.cli.output import echo, echo_text, tell_left_behind
from skinlab.cli.paths import PATH


@click.group(cls=SuggestingGroup)
def command() -> None:
    """Check a session, or say what is in it.

    \b
    Example: skinlab session info visit.h5
             skinlab session verify visit.h5
    """


@command.command()
@click.argument("session", type=PATH)
def verify(session: Path) -> int:
    """Check SESSION: its bytes, its audit trail, and its curves against what was recorded.

    Status 1 where something does not hold. The hash of the last audit entry binds all that was
    recorded: noted elsewhere, it shows even a session that was forged from end to end.

    \b
    Example: skinlab session verify visit.h5
    """
    from skinlab.recording.audit import entries
    from skinlab.recording.seal import Seal, read_seal
    from skinlab.recording.session_check import audit_head, check, complaints_about_changed
    from skinlab.text import counted

    if read_seal(session) is Seal.BROKEN:
        return _tell(session, complaints_about_changed(session))
    read, found = check(session)
    if found:
        return _tell(session, found)
    echo(f"{session}: unchanged; {counted(len(read.curves), 'curve')}, {len(read.records)} records")
    head = audit_head(read)
    if head is None:
        echo("  no audit trail")
    else:
        echo(f"  {len(entries(read.records))} audit entries, the last one's hash is {head}")
    return 0


def _tell(session: Path, found: list[str]) -> int:
    for sentence in found:
        echo(f"skinlab: {session}: {sentence}", err=True)
    return 1


@command.command()
@click.argument("session", type=PATH)
def info(session: Path) -> int:
    """Say what is in SESSION.

    \b
    Example: skinlab session info visit.h5
    """
    from skinlab.recording.session import read_session
    from skinlab.report.session_text import describe_session

    echo_text(describe_session(session, read_session(session)))
    tell_left_behind(session)
    return 0
