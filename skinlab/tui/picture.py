"""Make the picture of the README: a simulated measurement, drawn as SVG.

python -m skinlab.tui.picture docs/pictures/ui.svg
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from collections.abc import Callable
from contextlib import chdir
from datetime import datetime
from functools import partial
from pathlib import Path

from textual.pilot import Pilot

from skinlab.acquisition.probe_session import ProbeSession
from skinlab.io.files import write_file
from skinlab.tui.app import SkinlabApp
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.ui_state import Board
from skinlab.tui.widgets.fields import Fields

_PATIENCE_S = 120.0
_READ_S = 0.5  # until F9 counts


async def _until(pilot: Pilot[None], condition: Callable[[], bool]) -> None:
    end = time.monotonic() + _PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the simulated measurement did not get that far")
        await pilot.pause(0.02)


def _found(board: Board, curves: int) -> bool:
    entry = board.entry
    found = entry is not None and entry.result is not None
    return board.can_arm and len(board.entries) == curves and found


async def draw(port: str, size: tuple[int, int], programs: list[str], theme: str) -> str:
    """Return the SVG of the screen after one measurement with each program."""

    # A name that is the same every time, in the working directory (see `main`)
    def now() -> datetime:
        return datetime(2026, 1, 2, 10, 15)

    app = SkinlabApp(port, Path("sessions"), partial(ProbeSession, now=now), now=now)
    async with app.run_test(size=size) as pilot:
        app.theme = theme
        main = app.screen
        assert isinstance(main, MainScreen)
        board, fields = app.board, main.query_one(Fields)
        await _until(pilot, lambda: board.can_arm and board.hello is not None)
        fields.put("subject", "P07")
        fields.put("site", "forearm, volar")
        for number, program in enumerate(programs, start=1):
            fields.put("program", program)
            fields.put("cycle", str(number))
            await pilot.press("f8")
            await _until(pilot, lambda: main.summary_in_view)
            await pilot.pause(_READ_S)
            await pilot.press("f9")
            await _until(pilot, partial(_found, board, number))
        main.draw()
        await pilot.pause()
        return app.export_screenshot(title="skinlab")


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--port", default="sim://?seed=1")
    parser.add_argument("--columns", type=int, default=110)
    parser.add_argument("--rows", type=int, default=34)
    parser.add_argument("--theme", default="textual-dark")
    parser.add_argument("--program", action="append", help="may be given several times")
    options = parser.parse_args()
    programs = options.program or ["ramp:100@20", "ramp:100@20,ramp:0@20"]
    size = (options.columns, options.rows)
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        svg = asyncio.run(draw(options.port, size, programs, options.theme))
    write_file(options.out, svg, replace=True)


if __name__ == "__main__":
    main()
