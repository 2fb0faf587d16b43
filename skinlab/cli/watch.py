"""`skinlab watch`: identify each exported file as it lands in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinlab.cli.importing import form_options, stated
from skinlab.cli.method_options import MethodCommand
from skinlab.cli.options import (
    geometry_options,
    identification_options,
    json_option,
    make_identifier,
)
from skinlab.cli.output import echo, echo_text, print_json
from skinlab.cli.paths import PATH


@click.command(cls=MethodCommand)
@click.argument("folder", type=PATH)
@geometry_options(required=True)
@click.option("--program", help="What the pump does, e.g. ramp:100@20.")
@click.option("--cycle", default=1, show_default=True, help="1: first loading of the site.")
@click.option("--repeat", default=1, show_default=True, help="Counts from 1.")
@click.option(
    "--placement",
    help="A name for this putting-on of the probe  [default: a curve of cycle 1 begins one].",
)
@form_options("when the first file landed")
@click.option(
    "--settle-s", default=1.0, show_default=True, help="How long a file must be unchanged."
)
@click.option("--out", type=PATH, help="[default: session-DATE-TIME.h5]")
@identification_options()
@json_option()
def command(
    folder: Path,
    aperture_mm: float,
    thickness_mm: float,
    thickness_sd_mm: float | None,
    program: str | None,
    cycle: int,
    repeat: int,
    placement: str | None,
    subject: str,
    site: str,
    measured: str,
    settle_s: float,
    out: Path | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Identify each file as it lands in FOLDER, those that are there already first.

    A file is taken once it has stayed unchanged for --settle-s. Ctrl-C ends it: the session then
    holds all curves, and --json prints one document. Nobody may be there to be asked: what a file
    leaves open comes from an option, or from an answer that `import` kept for files with the same
    headings.

    The session was measured when the first file landed, or when --measured says. A file that was
    in FOLDER before may be of any day: without --measured the session then has none.

    \b
    Example: skinlab watch exports --aperture-mm 6 --thickness-mm 1 --program ramp:100@20
    """
    import time
    from datetime import datetime

    from skinlab.acquisition.shutdown import HeldInterrupt
    from skinlab.curves.curve import Setup, named_placement
    from skinlab.curves.program import parse_program
    from skinlab.errors import InputError
    from skinlab.exchange.importing.folder import Folder
    from skinlab.exchange.importing.questions import Answers
    from skinlab.exchange.importing.remembered import Remembered, default_path
    from skinlab.exchange.importing.session import Who, check_new
    from skinlab.exchange.importing.watch import Landed, Watch, watch
    from skinlab.inference.result import document
    from skinlab.recording.recorder import new_session_path
    from skinlab.report.text import describe

    if not 0.1 <= settle_s <= 3600:
        raise InputError(f"settle_s {settle_s:g}: expected 0.1-3600 s")
    if not folder.is_dir():
        raise InputError(f"{folder}: {'no folder' if folder.exists() else 'no such folder'}")
    setup = Setup(
        aperture_mm,
        thickness_mm,
        None if program is None else parse_program(program),
        cycle,
        repeat,
        thickness_sd_mm,
        named_placement(placement),
    )
    answers = Answers(
        stated(options, program=program is not None), remembered=Remembered(default_path())
    )
    identifier = make_identifier(**options)
    out = out or new_session_path(Path(), datetime.now())
    who = Who(subject, site)
    check_new(out)
    watcher = Watch(out, setup, answers, identifier, who, measured)

    def trouble(sentence: str) -> None:
        echo(f"skinlab: {sentence}", err=True)

    def tell(landed: Landed) -> None:
        if landed.imported is None:
            trouble(str(landed.result.error))
            return
        echo(f"{landed.path}: {'; '.join(landed.imported.understood)}", err=True)
        if landed.lay_there and not measured:
            trouble(
                f"{landed.path}: was there before; the session states no day of the measurement "
                "(--measured does)"
            )
        if landed.result.error is not None:
            trouble(landed.result.error)
        elif not as_json:
            echo_text(describe(landed.result))

    with HeldInterrupt() as held:
        try:
            echo(f"watching {folder}; Ctrl-C ends and keeps the curves in {out}", err=True)
            watch(
                Folder(folder, settle_s),
                watcher,
                tell,
                trouble,
                time.monotonic,
                time.sleep,
                held.check,
            )
        finally:
            saved = None
            try:
                saved = watcher.save()
            finally:
                if as_json:
                    results = [one.result for one in watcher.landed]
                    session = None if saved is None else str(saved)
                    print_json(document(identifier.provenance(), results, session=session))
                elif saved is not None:
                    echo(f"session: {saved}")
    return 0
