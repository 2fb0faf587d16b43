from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path

import pytest
from textual import events
from textual.pilot import Pilot
from textual.screen import Screen
from textual.widgets import Input

from drivers.probe import Probe
from drivers.reconnect import Backoff
from skinlab.acquisition.analysis import Explain, default_identifier
from skinlab.acquisition.measurement import Policy
from skinlab.acquisition.probe_session import ProbeSession
from skinlab.curves.probe_file import ProbeErrors
from skinlab.inference.identify import Identifier
from skinlab.tui.app import SkinlabApp
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.widgets.curves import Curves

SIMULATED = "sim://?seed=1&speed=20"
PATIENCE_S = 60.0


class Clock:
    """Time by which typing is told from confirming; passes where somebody says so."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class Bedside:
    """An app that is driven by keys."""

    def __init__(self, app: SkinlabApp, pilot: Pilot[None], clock: Clock) -> None:
        self.app, self.board, self.pilot, self.clock = app, app.board, pilot, clock

    async def until(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, f"not in {PATIENCE_S} s; {self.board.note!r}"
            await asyncio.sleep(0.01)

    async def on(self, kind: type[Screen[object]]) -> None:
        """Wait until such a screen is there with all its parts, and has the focus that it takes."""

        def there() -> bool:
            screen = self.app.screen
            if not isinstance(screen, kind) or not screen.is_mounted:
                return False
            takes = self.app.AUTO_FOCUS if screen.AUTO_FOCUS is None else screen.AUTO_FOCUS
            return not takes or screen.focused is not None or not screen.focus_chain

        await self.until(there)
        await self.settle()

    async def connected(self) -> None:
        await self.until(lambda: self.board.hello is not None and self.board.can_arm)

    async def press(self, *keys: str) -> None:
        """Press keys, each once the one before has come through.

        Not by the pilot, who waits until the process is idle: beside a probe that takes a second.
        """
        for key in map(_key, keys):
            character = _CHARACTERS.get(key, key if len(key) == 1 else None)
            self.app.post_message(events.Key(key, character))
            await self.settle()

    async def press_until(self, condition: Callable[[], object], key: str) -> None:
        """Press a key until what it does has been laid out."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, f"not in {PATIENCE_S} s; {self.board.note!r}"
            await self.press(key)

    async def settle(self) -> None:
        """Let what is under way come through: down to what has the focus, and up again."""
        for _ in range(2):
            if not self.app.is_running or not self.app.screen_stack:
                return
            bottom = self.app.focused or self.app.screen
            for node in (self.app, *bottom.ancestors_with_self):
                done = asyncio.Event()
                if node.call_later(done.set):
                    with suppress(TimeoutError):  # it was taken down meanwhile
                        await asyncio.wait_for(done.wait(), 2.0)

    async def fill(self, field: str, text: str) -> None:
        """Put text into a field without the keys: `type` is slow."""
        box = self.app.screen.query_one(f"#{field}", Input)
        await self.until(lambda: box.focusable)  # not while the fields are closed
        box.value = text
        await self.settle()

    async def type(self, field: str, text: str) -> None:
        box = self.app.screen.query_one(f"#{field}")
        await self.until(lambda: box.focusable)  # not while the fields are closed
        box.focus()
        await self.until(lambda: box.has_focus)
        await self.press("ctrl+shift+a", *text)

    async def check(self) -> None:
        """Let what will happen be shown, and be read."""
        # Again where it came too early: while the probe still vents, F8 is answered "not now"
        end = time.monotonic() + PATIENCE_S
        while not (self.board.review or "whose skin" in self.board.note):
            assert time.monotonic() < end, f"not in {PATIENCE_S} s; {self.board.note!r}"
            await self.press("f8")
            with suppress(TimeoutError):
                await asyncio.wait_for(self._answered(), 3.0)
        if not self.board.review:
            await self.press("f8")
        await self.until(lambda: self.app.screen_stack[0].summary_in_view)
        await self.pilot.pause()
        self.clock.now_s += 2.0

    async def _answered(self) -> None:
        while not (self.board.review or "whose skin" in self.board.note):
            await asyncio.sleep(0.02)

    async def start(self) -> None:
        """Let what will happen be shown, and start it."""
        await self.check()
        entries = len(self.board.entries)
        await self.press("f9")
        await self.until(lambda: self.board.series or len(self.board.entries) > entries)

    async def confirm(self) -> None:
        """Answer yes, once the question can have been read."""
        await self.pilot.pause()
        self.clock.now_s += 2.0
        await self.press("f9")

    async def quit(self) -> None:
        """Quit, and say yes."""
        await self.press("q")
        await self.on(ConfirmScreen)
        await self.confirm()
        await self.until(lambda: self.app.return_code is not None)

    async def run(self) -> None:
        """Start, and wait for the result."""
        entries = len(self.board.entries)
        await self.start()
        await self.until(lambda: len(self.board.entries) > entries)
        await self.until(lambda: self.board.entry.result is not None and self.board.can_arm)
        main = self.app.screen_stack[0]
        card, curves = main.query_one("#card"), main.query_one(Curves)
        await self.until(lambda: not card.has_class("-forming"))
        await self.until(lambda: curves.row_count == len(self.board.entries))  # drawn last

    def text(self, selector: str) -> str:
        return str(self.app.screen.query_one(selector).render())

    def screenshot(self) -> str:
        return self.app.export_screenshot()


_NAMES = {
    " ": "space", ":": "colon", "/": "slash", "?": "question_mark", "@": "at", "+": "plus",
    "=": "equals_sign", "&": "ampersand", ",": "comma", ".": "full_stop", "-": "minus",
}  # fmt: skip
_CHARACTERS = {name: character for character, name in _NAMES.items()} | {"enter": "\r"}


def _key(key: str) -> str:
    return _NAMES.get(key, key)


@pytest.fixture(scope="session")
def identifier() -> Identifier:
    return default_identifier()


@pytest.fixture
def bedside(tmp_path: Path, identifier: Identifier, coarse_skin: None):
    @asynccontextmanager
    async def enter(
        port: str | None = SIMULATED,
        size: tuple[int, int] = (80, 24),
        explain: Explain | None = None,
        make_probe: Callable[..., Probe] = Probe,
        calibration: ProbeErrors | None = None,
        **options,
    ) -> AsyncIterator[Bedside]:
        # Often, because the time of a simulated probe passes only where somebody looks
        backoff = Backoff(first_s=0.02, most_s=0.02, give_up_s=PATIENCE_S)
        make_bench = partial(
            ProbeSession,
            make_identifier=lambda: identifier,
            make_probe=make_probe,
            policy=Policy(backoff),
            explain=explain,
            calibration=calibration,
        )
        clock = Clock()
        app = SkinlabApp(port, tmp_path, make_bench, clock=clock, **options)
        async with app.run_test(size=size) as pilot:
            bed = Bedside(app, pilot, clock)
            await bed.until(lambda: app.board.version > 0)  # it has begun to connect
            yield bed

    return enter


@pytest.fixture
def session_files(tmp_path: Path) -> Callable[[], list[Path]]:
    return lambda: sorted(tmp_path.iterdir())
