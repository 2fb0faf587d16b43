"""The application: keys and news in, orders to the probe session out. It owns the board."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import events, on
from textual.app import App
from textual.binding import Binding, BindingType
from textual.filter import LineFilter
from textual.geometry import Size
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Input

from drivers.errors import DriverError
from drivers.events import InstrumentState
from drivers.link import PortInfo, list_ports
from skinlab.acquisition.measurement_request import Order, check_limits, read_order, with_opening
from skinlab.acquisition.messages import (
    Adopted,
    Connected,
    Disconnected,
    Done,
    Failed,
    Heard,
    News,
    Recording,
)
from skinlab.acquisition.probe_session import ProbeSession
from skinlab.acquisition.replayer import Replayer, example_session
from skinlab.acquisition.settings import recall, recall_choice, remember, remember_choice
from skinlab.acquisition.shutdown import INTERRUPTED
from skinlab.errors import InputError, SkinlabError
from skinlab.io.log import log_exception
from skinlab.mechanics.materials import get_law
from skinlab.recording.curve_selection import Deed
from skinlab.recording.session_fit import comparable
from skinlab.recording.stream import Identified, Sampled
from skinlab.recording.visit_index import visit_before
from skinlab.tui.choices import choices_for
from skinlab.tui.commands import COMMANDS
from skinlab.tui.goal import ChangeGoal, change_distance, choices, distance
from skinlab.tui.inert import InertText
from skinlab.tui.no_color import StyledFirst
from skinlab.tui.protocol_check import against_protocol
from skinlab.tui.replay_keys import ReplayKeys
from skinlab.tui.screens.alarm import AlarmScreen
from skinlab.tui.screens.help import HelpScreen
from skinlab.tui.screens.line import LineScreen
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.messages import MessagesScreen
from skinlab.tui.screens.missing import MissingScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.screens.palette import Command, PaletteScreen
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.screens.ports import PortsScreen
from skinlab.tui.screens.protocol import ProtocolScreen
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.screens.visits import VisitsScreen
from skinlab.tui.screens.welcome import EXAMPLE, SIMULATED, WelcomeScreen
from skinlab.tui.settings_file import LOOKING, UserSettings
from skinlab.tui.text import adoption_lines, undone_words
from skinlab.tui.themes import ORDER, OWN, WORDS, next_theme
from skinlab.tui.typing_guard import TypingGuard, is_typing
from skinlab.tui.ui_state import (
    EXPLAINING,
    MEASURING,
    Aimed,
    Board,
    Level,
    Missing,
    Playing,
    Review,
)
from skinlab.tui.widgets.fields import Fields
from skinlab.tui.widgets.reading import Reading

if TYPE_CHECKING:
    from skinlab.acquisition.protocol import NamedProtocol
    from skinlab.curves.curve import Curve
    from skinlab.discrepancy.next_measurement import NextMeasurement
    from skinlab.discrepancy.outcome import Outcome
    from skinlab.studies.reference import Reference

_TICK_S = 0.1
_REPAINT_S = 2.0  # how long a lost size, or what another program wrote over the screen, can stay
_LEFT_BY_VENT = (
    HelpScreen,
    LineScreen,
    MessagesScreen,
    MissingScreen,
    PaletteScreen,
    PickScreen,
    PortsScreen,
    ProtocolScreen,
    VisitsScreen,
)


class SkinlabApp(App[None]):
    """The bedside terminal UI on the probe at `port`; sessions go to `folder`."""

    class Said(Message):
        """News of the probe session, on their way from a thread to the screen."""

        def __init__(self, news: News | Aimed) -> None:
            super().__init__()
            self.news = news

    class Interrupted(Message):
        """A signal wants the app to end."""

    TITLE = "skinlab"
    CSS_PATH = "app.tcss"
    ENABLE_COMMAND_PALETTE = False
    # Style classes from so many columns, and rows, on
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (76, "-normal"), (110, "-wide"), (140, "-widest")]  # noqa: RUF012
    VERTICAL_BREAKPOINTS = [(0, "-low"), (23, "-usual"), (34, "-tall")]  # noqa: RUF012 -- Textual's own form
    BINDINGS: ClassVar[list[BindingType]] = [
        # Each screen shows v, first of all; a terminal may hold a lone Esc back
        Binding("v", "vent_key", "Vent", show=False, priority=True, id="vent"),
        Binding("escape", "vent", "Vent", show=False, priority=True),
        Binding("question_mark", "help", "Help", key_display="?", id="help"),
        Binding("f1", "help", "Help", show=False, priority=True),
        Binding("t", "theme", "Theme", show=False, id="theme"),
        Binding("w", "messages", "Messages", show=False, id="messages"),
        Binding("ctrl+p", "palette", "Commands", show=False, priority=True, id="palette"),
        Binding("q", "leave", "Quit", id="quit"),
        Binding("f2", "ports", "Ports", key_display="F2", priority=True, id="ports"),
        Binding("ctrl+q", "leave", "Quit", show=False, priority=True),
        Binding("ctrl+c", "stop", "Vent and quit", show=False, priority=True),
    ]

    def __init__(
        self,
        port: str | None,
        folder: Path,
        make_bench: Callable[..., ProbeSession] = ProbeSession,
        settings: Path | None = None,
        replay: Path | None = None,
        speed: float | None = 1.0,
        ports: Callable[[], tuple[PortInfo, ...]] = list_ports,
        model: str | None = None,
        make_replayer: Callable[..., Replayer] = Replayer,
        clock: Callable[[], float] = time.monotonic,
        reference: Reference | None = None,
        user: UserSettings | None = None,
        protocol: NamedProtocol | None = None,
        study: Path | None = None,
    ) -> None:
        """Begin with a port, with the replay of a session, or (neither) by asking.

        Settings are kept for the next time in `settings`; None: nowhere. `model` names what
        curves are identified with; None: the base law. `clock` (s) tells typing from confirming.
        `reference` has the usual ranges that values are shown against, `user` the colours and
        further keys of the settings file, `protocol` what a study demands; `study`, a folder of
        `skinlab study`, says how much visits, operators and placements scatter.
        """
        super().__init__()
        for theme in OWN:
            self.register_theme(theme)
        user = user or UserSettings()
        chosen = user.theme or recall_choice(settings, "theme", ORDER)
        if chosen is not None:
            self.theme = chosen
        self.set_keymap(user.keymap)
        self._own_keys = user.keymap
        self.guard = TypingGuard(clock)
        self.board = Board(port or SIMULATED)
        self._folder = folder
        self._ask = port is None and replay is None
        self._replay = replay
        self._speed = speed
        self._ports = ports
        self._settings = settings
        self.bench: ProbeSession | Replayer = make_bench(folder, self._post)
        self._make_replayer = make_replayer
        self.board.model = model
        self.board.reference = reference
        self.board.protocol = protocol
        self.board.study = study
        self._otherwise: list[str] = []  # than the protocol says, to be recorded
        self.failure: Exception | None = None  # a bug that ended the app
        self._queued: Order | None = None  # to be shown once its port is connected
        self._unnamed: tuple[str, str] | None = None  # visit that may do without a subject
        self._next_port: str | None = None  # to be connected once the present one is closed
        self._anew = False  # what is connected next begins another session
        self._leaving = False
        self._clock = clock
        self._replaying = ReplayKeys(
            self.board,
            lambda: self.bench,
            lambda: self._connect(self.board.port),
            self._ask_line,
        )

    # ---- life ---------------------------------------------------------------------------------

    def get_default_screen(self) -> MainScreen:
        """Begin with the main screen."""
        return MainScreen(self.board, recall(self._settings), self.guard)

    def on_ready(self) -> None:
        """Connect, and load what identification needs meanwhile."""
        self._main.begin()
        self._tick()
        self.set_interval(_TICK_S, self._tick)
        self.set_interval(_REPAINT_S, self._see_again)
        if self._ask:
            self.push_screen(WelcomeScreen(self.board, self._ports()), self._welcomed)
        elif self._replay is not None:
            self._play(self._replay)
        else:
            self._connect(self.board.port)
        self._perform("preparing", self.bench.analysis.prepare)

    def _see_again(self) -> None:
        """Take the terminal's size, if its news of that was lost, and draw all of the screen."""
        if not (self.is_headless or self.is_web):
            with contextlib.suppress(OSError, ValueError, AttributeError):  # no terminal
                now = Size(*os.get_terminal_size(sys.__stdout__.fileno()))  # type: ignore[union-attr]
                if now.area and now != self.screen.size:
                    self.post_message(events.Resize(now, now))
        self.screen.refresh(layout=True)

    def _tick(self) -> None:
        self.board.tick(self._clock())

    def _welcomed(self, choice: str | None) -> None:
        if choice is None:
            return
        if choice == EXAMPLE:
            self._play(example_session())
        else:
            self._fields.put("port", choice)
            self._connect(choice)

    def vent(self, reason: str) -> None:
        """Vent what is connected; from any thread."""
        self.bench.vent(reason)

    def close_bench(self) -> None:
        """Vent, and finish the session; from any thread."""
        self.bench.close()

    # ---- a replay -----------------------------------------------------------------------------

    def _play(self, path: Path) -> None:
        folder = self._folder if path == example_session() else path.parent  # for models
        replayer = self._make_replayer(folder, self._post, self._speed)
        self.bench = replayer
        self.board.playing = Playing(speed=self._speed)
        self._connect(str(path))

    def _ask_line(self, question: str, answered: Callable[[str | None], None]) -> None:
        self.push_screen(LineScreen(self.board, question), answered)

    @on(Reading.Pointed)
    def _pointed(self, message: Reading.Pointed) -> None:
        self._replaying.point(message.share)

    def on_unmount(self) -> None:
        """Whatever ended the app: vent, and finish the session."""
        self.bench.close()

    def interrupt(self) -> None:
        """Ask the app to end; from any thread. Somebody else vents."""
        try:
            self.post_message(self.Interrupted())
        except RuntimeError:
            return  # it has ended

    @on(Interrupted)
    def _interrupted(self) -> None:
        self.exit(return_code=INTERRUPTED)

    def _handle_exception(self, error: Exception) -> None:
        self.bench.vent("internal error")
        self.failure = self.failure or error
        super()._handle_exception(error)

    def _fatal_error(self) -> None:
        # Instead of a traceback: the command line says it in one sentence.
        self._close_messages_no_wait()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return Textual's filters, safe for text without a style, behind our own."""
        return [InertText(), *(StyledFirst(inner) for inner in super().get_line_filters())]

    # ---- threads ------------------------------------------------------------------------------

    def _post(self, news: News | Aimed) -> None:
        try:
            self.post_message(self.Said(news))
        except RuntimeError:
            return  # the loop is closed: nobody is left to read it

    def _perform(self, doing: str, call: Callable[[], None]) -> None:
        """Do something slow in a thread; its end is news, whichever it is."""

        def work() -> None:
            try:
                call()
            except (SkinlabError, DriverError) as error:
                self._post(Failed(doing, str(error)))
            except Exception as error:  # noqa: BLE001 -- told in a sentence; details are logged
                self.bench.vent("internal error")
                where = log_exception(error)
                self._post(Failed(doing, f"{doing} failed ({error!r}); details are in {where}"))
            else:
                self._post(Done(doing))

        self.board.compute(doing)
        self.run_worker(work, name=doing, group=doing, thread=True, exit_on_error=False)

    # ---- news ---------------------------------------------------------------------------------

    @on(Said)
    def _said(self, message: Said) -> None:
        news = message.news
        self.board.see(news)
        if not self.is_running:
            return  # the app ends: there is nothing left to draw on
        match news:
            case Connected():
                self._connected(news)
            case Recording():
                self._record_protocol()
            case Adopted():
                self._anew = news.anew  # a session is identified with one model
            case Disconnected() if self._next_port is not None:
                port, self._next_port = self._next_port, None
                self._connect(port)
            case Failed("connecting"):
                self._queued = None
            case Done("connecting"):
                self._replaying.over()
            case Done("closing"):
                self._leave()
            case _:
                pass
        if isinstance(news, Heard) and any(isinstance(m, Identified) for m in news.messages):
            self._aim()
        if self.board.alarm is not None:
            self._raise_alarm(self.board.alarm)
        if self.screen is self._main and not _only_samples(news):
            self._main.draw()  # now, not with the next frame: it is waited for

    def _connected(self, news: Connected) -> None:
        order, self._queued = self._queued, None
        aperture_mm = news.hello.aperture_mm
        if self.board.playing is not None:
            return
        if order is not None and order.setup.aperture_mm == aperture_mm:
            self._show(order)
            return
        if aperture_mm is None:  # it does not say; the field holds
            if order is not None:
                self._show(order)
            return
        self._fields.put("aperture_mm", f"{aperture_mm:g}")
        if order is not None:
            self.board.say(
                Level.WARNING,
                f"this probe has an opening of {aperture_mm:g} mm, as set now; F8 goes on",
            )

    def _raise_alarm(self, text: str) -> None:
        for screen in self.screen_stack:
            if isinstance(screen, AlarmScreen):
                screen.tell(text)
                return
        self.push_screen(AlarmScreen(self.board, self.guard, text), self._acknowledged)

    def _acknowledged(self, _: bool | None) -> None:
        try:
            self.bench.acknowledge(self.board.alarm or "")
        except SkinlabError as error:
            self.board.refuse(str(error))
        self.board.acknowledge()
        if self._leaving and self.board.doing is None:
            self._leave()

    # ---- keys ---------------------------------------------------------------------------------

    async def _on_key(self, event: events.Key) -> None:
        """Say so where a key has no meaning here: nothing took it on its way."""
        event.prevent_default()  # the base class would do what the key does once more
        if not self.screen_stack:  # a key that was still on its way when the app was left
            return
        if not await self._check_bindings(event.key):
            name = event.character if event.is_printable and event.character else event.key
            self.board.tell(f"{_shown(name)}: {self._why_not}; ? lists the keys")

    @property
    def _why_not(self) -> str:
        """Why a key means nothing."""
        board = self.board
        if board.playing is not None:
            return "no meaning in a replay"
        if board.alarm is not None:
            return "not before the alarm is acknowledged (F9)"
        return "no meaning here" if board.can_arm else f"not now ({board.phase.lower()})"

    async def on_event(self, event: events.Event) -> None:
        """Tell the guard of what is typed or pasted, before any key does anything."""
        pasted = isinstance(event, events.Paste)
        key = event if isinstance(event, events.Key) and not event.is_forwarded else None
        if pasted or (key is not None and is_typing(key.key, printable=key.is_printable)):
            self.guard.typed()
        if key is not None and key.key in self._vent_keys and self.board.moving:
            # Textual would let a line that is typed in, of a list or a note, take the letter
            self.action_vent()
            return
        await super().on_event(event)

    @property
    def _vent_keys(self) -> list[str]:
        return self._own_keys.get("vent", "v").split(",")

    @property
    def _main(self) -> MainScreen:
        screen = self.screen_stack[0]
        assert isinstance(screen, MainScreen)
        return screen

    @property
    def _fields(self) -> Fields:
        return self._main.query_one(Fields)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """While a field takes text, v is text."""
        if action == "vent_key":
            return not isinstance(self.focused, Input) or self.board.moving
        if action == "ports":
            return self.board.can_arm and isinstance(self.screen, MainScreen)
        return super().check_action(action, parameters)

    def action_vent_key(self) -> None:
        """Vent."""
        self.action_vent()

    def action_vent(self) -> None:
        """Vent at once; close what is open over the main screen, and leave the fields."""
        self.bench.vent("operator")
        if self.board.moving:
            self.board.say(Level.WARNING, "vent ordered")
        self._queued = None
        self.board.withdraw()
        if isinstance(self.screen, SessionScreen):
            self.screen.leave_line()
        elif isinstance(self.screen, ConfirmScreen):
            self.screen.dismiss(False)
        elif isinstance(self.screen, _LEFT_BY_VENT):
            self.pop_screen()
        self._main.set_focus(None)
        if self._main.is_mounted:
            self._main.draw()

    def action_help(self) -> None:
        """Open the help, unless an alarm is to be read; close it where it is open."""
        if isinstance(self.screen, HelpScreen):
            self.screen.dismiss()
        elif not isinstance(self.screen, AlarmScreen):
            self.push_screen(HelpScreen(self.board, self._keys_here()))

    def _keys_here(self) -> list[tuple[str, str]]:
        """Return the keys of the present screen that mean something now, with what they do.

        Those of the main screen are in the list below, unless the settings file adds some.
        """
        if self.screen is self._main and not self._own_keys:
            return []
        here: dict[str, list[str]] = {}
        for active in self.screen.active_bindings.values():
            binding = active.binding
            if active.node is self.screen and active.enabled and binding.description:
                keys = here.setdefault(binding.description, [])
                shown = self.get_key_display(binding)
                if shown not in keys:
                    keys.append(shown)
        return [("  ".join(keys), what) for what, keys in here.items()]

    def get_key_display(self, binding: Binding) -> str:
        """Return a key as it stands on the keyboard."""
        return _shown(binding.key_display or super().get_key_display(binding))

    def action_palette(self) -> None:
        """Search among all that can be done: on this screen, and from the main one."""
        if isinstance(self.screen, ModalScreen):
            return
        self.board.withdraw()
        below = self.screen
        here = {} if below is self._main else self._commands_here()

        async def chosen(action: str | None) -> None:
            if action is None or self.screen is not below:
                return
            if action in here:
                done = await self.run_action(here[action].action, below)
            else:
                while self.screen is not self._main:
                    self.pop_screen()
                done = await self.run_action(action, self._main)
            if not done:
                self.board.answer(Level.INFO, "that means nothing at this moment")

        listed = [Command(name, f"here: {c.words}", c.key) for name, c in here.items()]
        self.push_screen(PaletteScreen(self.board, (*listed, *COMMANDS)), chosen)

    def _commands_here(self) -> dict[str, Command]:
        """Return what the keys of the present screen only look at or ask for, by a name."""
        found: dict[str, Command] = {}
        for active in self.screen.active_bindings.values():
            binding = active.binding
            looks = binding.id is None or binding.id in LOOKING
            if active.node is self.screen and active.enabled and binding.description and looks:
                key = self.get_key_display(binding)
                found.setdefault(
                    f"here {binding.action}", Command(binding.action, binding.description, key)
                )
        return found

    def action_messages(self) -> None:
        """Show all that was said."""
        if not isinstance(self.screen, ModalScreen):
            self.push_screen(MessagesScreen(self.board))

    def action_ports(self) -> None:
        """Choose a port."""
        self.board.withdraw()
        self.push_screen(PortsScreen(self.board), self._port_chosen)

    def action_theme(self) -> None:
        """Change the colours: dark, light, high contrast, colour-blind safe."""
        self.theme = next_theme(self.theme)
        remember_choice(self._settings, "theme", self.theme)
        self.board.answer(Level.INFO, f"colours: {WORDS[self.theme]}")
        self._main.redraw()

    def action_leave(self) -> None:
        """Ask whether to vent, finish the session and quit; where that was asked, press F9."""
        if self._leaving or isinstance(self.screen, AlarmScreen):
            return
        if isinstance(self.screen, ConfirmScreen):
            return
        saved = "the session is saved" if self.board.visit and not self.board.playing else ""
        what = ", ".join(t for t in ("The probe vents", saved, "the program ends.") if t)
        question = ConfirmScreen(self.board, self.guard, "Quit?", what)
        self.push_screen(question, self._may_leave)

    def action_stop(self) -> None:
        """Vent at once, and ask whether to quit."""
        self.bench.vent("operator")
        self.board.withdraw()
        self.action_leave()

    def _may_leave(self, yes: bool | None) -> None:
        if not yes or self._leaving:
            return
        self.bench.vent("quit")
        self._leaving = True
        self.board.begin("closing", "venting, saving the session …")
        self._perform("closing", self.bench.close)

    def _leave(self) -> None:
        if self.board.alarm is None:  # else once it is acknowledged
            self.exit()

    @on(MainScreen.Wanted)
    def _wanted(self, message: MainScreen.Wanted) -> None:
        match message.what:
            case "check" if self.board.can_arm:
                self._check()
            case "start" | "early" if self.board.can_arm:
                self._confirm()
            case "play" | "step" | "faster" | "slower" | "event":
                self._replaying.press(message.what)
            case "time":
                self._replaying.ask_time()
            case what if what.startswith("to "):
                self._replaying.point(int(what.removeprefix("to ")) / 10)
            case "pick" if self.board.can_arm:
                self._pick()
            case "visits":
                analysis = self.bench.analysis
                self.push_screen(
                    VisitsScreen(self.board, self._folder, lambda: analysis.identifier)
                )
            case "protocol":
                self.push_screen(ProtocolScreen(self.board))
            case "goal":
                self._choose_goal()
            case "next" if self.board.can_arm:
                if not self._load_step():
                    self._load_advice()
            case "rested" if self.board.can_arm:
                self._count_anew()
            case "card":
                self.board.second_card = not self.board.second_card
                self.board.touch()
            case "session":
                self.push_screen(SessionScreen(self.board))
            case "missing":
                self._show_missing()
            case _:
                pass

    def _pick(self) -> None:
        """Offer a list for the field that is typed in; without one, that of programs."""
        self.board.withdraw()
        focused = self._main.focused
        field = str(focused.id) if isinstance(focused, Input) else "program"
        choices = choices_for(field)
        if not choices:
            self.board.answer(Level.INFO, "lists there are for site, opening and program")
            return

        def chosen(text: str | None) -> None:
            if text is not None:
                self._fields.put(field, text)
                self._fields.follow()

        title = {"aperture_mm": "Opening", "site": "Site"}.get(field, "Program")
        screen = PickScreen(self.board, title, choices, body=field == "site")
        self.push_screen(screen, chosen)

    def _choose_goal(self) -> None:
        """Offer what a visit can aim at."""
        law = self.bench.analysis.law
        if law is None:
            self.board.answer(Level.INFO, "still preparing: g again in a moment")
            return
        offered = {goal.words: goal for goal in choices(get_law(law))}

        def chosen(text: str | None) -> None:
            if text is None:
                return
            self.board.goal = offered.get(text)
            self.board.goal_is = None
            self.board.touch()
            self._aim()

        lines = [(words, words) for words in ("no goal", *offered)]
        self.push_screen(PickScreen(self.board, "Goal of this visit", lines), chosen)

    def _aim(self) -> None:
        """Find out beside how far the visit is from its goal."""
        board, goal = self.board, self.board.goal
        curves = comparable(board.used)
        if goal is None or not curves or board.playing is not None:
            return
        identifier = self.bench.analysis.identifier
        by_name = {e.curve.name: e.result for e in board.entries.values() if e.result is not None}
        known = [curve for curve in curves if curve.name in by_name]
        results = [by_name[curve.name] for curve in known]
        serial = "" if board.hello is None else board.hello.serial_number

        def work() -> None:
            if not isinstance(goal, ChangeGoal):
                self._post(Aimed(distance(goal, curves, identifier)))
                return
            before, study = self._before(), board.study
            self._post(
                Aimed(change_distance(goal, before, known, results, identifier, serial, study))
            )

        self._perform("aiming", work)

    def _before(self) -> Path | None:
        """Return the last visit of the same subject and site before the open one."""
        board = self.board
        return visit_before(self._folder, board.visit, board.path, simulated=board.simulated)

    def _load_advice(self) -> None:
        """Put into the fields what would narrow the goal's interval most."""
        found = self.board.goal_is
        if found is None or found.following is None:
            self.board.answer(Level.INFO, "no measurement is suggested (g sets a goal)")
            return
        following = found.following
        self._fields.put("aperture_mm", f"{following.aperture_mm:g}")
        self._fields.put("program", following.program)
        what = f"{following.program}, {following.aperture_mm:g} mm opening"
        self.board.answer(Level.INFO, f"loaded: {what}; F8 goes on")

    # ---- a protocol ---------------------------------------------------------------------------

    @on(ProtocolScreen.Wanted)
    def _step_wanted(self) -> None:
        while self.screen is not self._main:
            self.pop_screen()
        if not self._load_step():
            self.board.answer(Level.INFO, "all steps of the protocol are done")

    @on(ProtocolScreen.Stated)
    def _conditions_stated(self) -> None:
        board = self.board
        if board.path is not None and board.visit == board.who:
            self._audit("conditions", **board.stated)

    def _load_step(self) -> bool:
        """Put the next step of the protocol into the fields; False: there is none."""
        board = self.board
        named, walk = board.protocol, board.walk
        if named is None or walk is None:
            return False
        sites = named.protocol.study.sites
        state = walk.next
        site = board.who[1]
        if sites and (state is None or site not in sites):
            left = [s for s in sites if not board.site_done(s) and s != site]
            if left:  # another visit begins there, with the first step
                self._fields.put("site", left[0])
                self._fields.follow()
                board.name(self._fields.who)
                walk = board.walk
                state = None if walk is None else walk.next
        if state is None:
            return False
        step = state.step
        self._fields.put("aperture_mm", f"{step.aperture_mm:g}")
        self._fields.put("program", step.program)
        self._fields.put("repeats", str(state.left))
        self._fields.put("rest_s", f"{step.rest_s:g}")
        board.answer(Level.INFO, f"loaded: {walk.words if walk else ''}; F8 shows it")
        return True

    def _record_protocol(self) -> None:
        """Write what is demanded, and under which conditions it begins, into the new session."""
        named = self.board.protocol
        if named is None:
            return
        from skinlab.report.protocol import protocol_trail

        for what, detail in protocol_trail(named, self.board.stated):
            self._audit(what, **detail)
        self._record_otherwise()

    def _record_otherwise(self) -> None:
        from skinlab.report.protocol import DEVIATION

        clauses, self._otherwise = self._otherwise, []
        for clause in clauses:
            self._audit(DEVIATION, text=clause)

    def _audit(self, what: str, **detail: Any) -> None:
        try:
            self.bench.audit(what, **detail)
        except SkinlabError as error:
            self.board.refuse(str(error))

    def _count_anew(self) -> None:
        """Take the next loading for a first one, because the operator says so."""
        self.board.withdraw()
        self._fields.put("cycle", "1")
        counted = self.board.next_cycle
        seen = f" (by count it would be loading {counted})" if counted > 1 else ""
        note = f"the next curve is a first loading: fully rested, or another spot{seen}"
        self.board.answer(Level.INFO, note)

    @on(Fields.Named)
    def _named(self, message: Fields.Named) -> None:
        self.board.name(message.who)

    @on(SessionScreen.Decided)
    def _decided(self, message: SessionScreen.Decided) -> None:
        deed = message.deed
        what = f"undone: {deed.what}" if message.undone else deed.what
        # What is undone is put right in the trail as well, whoever reads it
        if message.undone and deed.curve is not None:
            back = self.board.ledger.excluded.get(deed.curve)
            what = "curve included" if back is None else "curve excluded"
            deed = Deed(what, deed.curve, back or "")
        try:
            self.bench.audit(what, curve=deed.curve, text=deed.text)
        except SkinlabError as error:
            self.board.refuse(str(error))
        else:
            # More than a note: not to be covered by "saved"
            level = Level.WARNING if message.undone else Level.INFO
            undone = f"undone: {undone_words(message.deed)}"
            self.board.answer(level, undone if message.undone else f"recorded: {what}")

    @on(SessionScreen.Wanted)
    def _session_wanted(self, message: SessionScreen.Wanted) -> None:
        board = self.board
        if message.what == "missing":
            self._show_missing()
            return
        curves = comparable(board.used)
        if not curves:
            board.refuse("no whole curve is there to be fitted")
        elif message.what == "joint":
            self._perform("fitting", lambda: self.bench.analysis.fit_together(curves))
        else:
            typed = message.path
            self._perform("comparing", lambda: self._compare(typed, curves))

    def _compare(self, typed: str, curves: Sequence[Curve]) -> None:
        """Post whether the skin changed since another session, or the visit before; slow."""
        from skinlab.tui.comparing import compare_with

        board = self.board
        path = self._folder / Path(typed).expanduser() if typed else self._before()
        if path is None:
            raise InputError("there is no earlier visit of this subject and site here")
        found = {e.curve.name: e.result for e in board.entries.values() if e.result is not None}
        curves = [curve for curve in curves if curve.name in found]
        results = [found[curve.name] for curve in curves]
        serial = "" if board.hello is None else board.hello.serial_number
        identifier = self.bench.analysis.identifier
        self._post(compare_with(path, curves, results, identifier, serial, board.study))

    # ---- the missing effect -------------------------------------------------------------------

    def _show_missing(self) -> None:
        self.push_screen(MissingScreen(self.board))
        if self.board.missing is None:
            self._look_for_it()

    def _look_for_it(self) -> None:
        board = self.board
        curves = [curve for curve in board.used if not curve.partial]
        if not curves:
            board.refuse("no whole curve is there to be looked at")
            return
        board.missing = Missing(tuple(curve.name for curve in curves))
        board.touch()
        self._perform(EXPLAINING, lambda: self.bench.analysis.explain(curves))

    @on(MissingScreen.Wanted)
    def _missing_wanted(self, message: MissingScreen.Wanted) -> None:
        missing = self.board.missing
        outcome = None if missing is None else missing.outcome
        match message.what:
            case "begin":
                self._look_again()
            case "cancel":
                self.bench.analysis.stop_explaining()
            case "adopt" if outcome is not None:
                self._ask_to_adopt(outcome)
            case "undo":
                self._perform("undoing", self.bench.analysis.undo_adoption)
            case "load" if outcome is not None and outcome.next_measurement is not None:
                self._load_next(outcome.next_measurement)
            case _:
                pass

    def _look_again(self) -> None:
        """Look anew, unless the same curves would give the same answer."""
        missing = self.board.missing
        curves = tuple(curve.name for curve in self.board.used if not curve.partial)
        if missing is not None and missing.outcome is not None and missing.curves == curves:
            self.board.say(Level.INFO, "these curves have been looked at: measure another one")
        else:
            self._look_for_it()

    def _ask_to_adopt(self, outcome: Outcome) -> None:
        session = Path(self.board.port) if self.board.playing else self.board.saved

        def answered(yes: bool | None) -> None:
            if yes:
                self._perform("adopting", lambda: self.bench.analysis.adopt(outcome, session))

        lines = adoption_lines(outcome, "model" if session is None else session.stem)
        title = "Identify with this model from now on?"
        question = ConfirmScreen(self.board, self.guard, title, "\n".join(lines))
        self.push_screen(question, answered)

    def _load_next(self, following: NextMeasurement) -> None:
        """Put the measurement that would tell most into the fields; F8 shows it."""
        aperture = f"{following.aperture_mm:g}"
        self._fields.put("aperture_mm", aperture)
        self._fields.put("program", following.program)
        self._fields.put("repeats", "1")
        while self.screen is not self._main:
            self.pop_screen()
        self.board.say(
            Level.INFO, f"loaded: {following.program}, {aperture} mm opening; F8 goes on"
        )

    def _check(self) -> None:
        """Show what will happen; connect first where that must be. Nothing moves yet."""
        self.board.withdraw()
        if self.board.instrument is InstrumentState.FAULT:
            self.board.begin("resetting", "the fault is acknowledged")
            self._perform("resetting", self.bench.reset)
            return
        self._fields.follow()  # what was typed last may not have come through
        self.board.name(self._fields.who)
        self._fields.count(self.board.next_cycle)
        try:
            texts = self._fields.texts()
            order = read_order(texts)
            if self.board.hello is not None and order.port == self.board.port:
                assert order.setup.program is not None
                check_limits(order.setup.program, self.board.hello)
        except InputError as error:
            self.board.refuse(str(error))
            wrong = self._fields.first_wrong()
            if wrong is not None:
                self._main.set_focus(wrong)
            return
        if self._must_be_named(order):
            return
        remember(self._settings, texts)
        board = self.board
        board.name(order.visit)
        if board.visit is not None and board.visit != order.visit:
            self._anew = True  # another person or site: another session
        if board.hello is None or order.port != board.port:
            self._reconnect(order.port, order)
        elif board.hello.aperture_mm not in {None, order.setup.aperture_mm}:
            # Another head was put on, so the instrument must be asked again
            port = with_opening(order.port, order.setup.aperture_mm)
            self._fields.put("port", port)
            self._reconnect(port, replace(order, port=port))
        elif self._anew and board.visit is not None:
            self._reconnect(order.port, order)
        else:
            self._show(order)

    def _must_be_named(self, order: Order) -> bool:
        """Ask for a subject where there is none, once a visit."""
        if order.subject or order.visit in {self.board.visit, self._unnamed}:
            return False
        self._unnamed = order.visit
        self._main.set_focus(self._fields.query_one("#subject", Input))
        self.board.answer(
            Level.WARNING, "whose skin is it? Type a pseudonym, or F8 goes on without one"
        )
        return True

    def _show(self, order: Order) -> None:
        """Show what will happen; `_confirm` does it."""
        fields, board = self._fields, self.board
        # The same once more after a lost link is what was left, not all from the beginning
        goes_on = board.left is not None and order == board.asked
        if goes_on and board.left is not None:
            order = order.with_left(board.left)
        counted = None if goes_on else board.next_cycle
        protocol: tuple[str, ...] = ()
        otherwise: tuple[str, ...] = ()
        if not goes_on:
            assumed = fields.assumed_thickness
            protocol, otherwise = against_protocol(board, order, assumed_thickness=assumed)
        review = Review(
            order,
            fields.texts(),
            goes_on,
            fields.assumed_thickness,
            counted,
            protocol,
            otherwise,
        )
        self._main.set_focus(None)
        self.guard.hidden()
        self.board.propose(review)
        self._main.draw()

    def _confirm(self) -> None:
        """Arm and start what was shown, if it was read and nobody types."""
        board, review = self.board, self.board.review
        if review is None:
            board.answer(Level.WARNING, "F8 first: it shows what F9 would start")
            return
        why = self.guard.refusal()
        if not self._main.summary_in_view:
            why = "the window does not show all that will happen: make it larger"
        elif review.texts != self._fields.texts():
            why = "the settings have changed: F8 shows them"
        if why is not None:
            board.answer(Level.WARNING, f"not started: {why}")
            return
        board.review = None
        self._fields.accept()
        self._otherwise = list(review.otherwise)
        if board.path is not None and not self._anew:
            self._record_otherwise()  # else once there is a session
        self._run(review)

    def _run(self, review: Review) -> None:
        """Measure; repeats follow by themselves. A vent that is ordered later ends it."""
        board, order, vents = self.board, review.order, self.bench.vents
        board.series, board.order, board.visit = order, order, order.visit
        board.begin("arming", "")
        self._main.close_fields(closed=True)
        if review.goes_on:  # `asked` stays
            self._perform(MEASURING, lambda: self.bench.go_on(vents))
        else:
            board.asked = order
            self._perform(MEASURING, lambda: self.bench.measure(order, vents))

    def _port_chosen(self, port: str | None) -> None:
        if port is not None:
            self._fields.put("port", port)
            self._reconnect(port, None)

    def _reconnect(self, port: str, order: Order | None) -> None:
        self._queued = order
        if self.board.hello is None:
            self._connect(port)
        else:
            self._next_port = port
            self.board.begin("connecting", f"leaving {self.board.port} …")
            self._perform("leaving", self.bench.leave)

    def _connect(self, port: str) -> None:
        self.board.port = port
        self.board.begin("connecting", f"connecting to {port} …")
        anew, self._anew = self._anew, False
        self._perform("connecting", lambda: self.bench.serve(port, anew=anew))


def _shown(key: str) -> str:
    """Return a key as it stands on the keyboard."""
    named = {"delete": "Del", "pageup": "PgUp", "pagedown": "PgDn", "escape": "Esc"}
    return named.get(key, key.upper() if re.fullmatch(r"f\d+", key) else key)


def _only_samples(news: News | Aimed) -> bool:
    return isinstance(news, Heard) and all(isinstance(m, Sampled) for m in news.messages)
