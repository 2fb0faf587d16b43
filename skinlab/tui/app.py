"""The application: keys and news in, orders to the probe session out. It owns the board."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import events, on
from textual.binding import Binding, BindingType
from textual.filter import LineFilter
from textual.geometry import Size
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Input

from drivers.errors import DriverError
from drivers.events import Sample
from drivers.link import PortInfo, list_ports
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
from skinlab.acquisition.replayer import Replayer
from skinlab.acquisition.settings import recall, recall_choice, remember_choice
from skinlab.acquisition.shutdown import INTERRUPTED
from skinlab.errors import SkinlabError
from skinlab.io.log import log_exception
from skinlab.recording.journal import all_left_behind
from skinlab.recording.session import example_session
from skinlab.recording.stream import Happened, Identified, Sampled
from skinlab.recording.stream import Message as StreamMessage
from skinlab.tui.choices import choices_for
from skinlab.tui.commands import commands_for
from skinlab.tui.inert import InertText
from skinlab.tui.missing_keys import MissingKeys
from skinlab.tui.no_color import StyledFirst
from skinlab.tui.part import PartedApp
from skinlab.tui.protocol_steps import ProtocolSteps
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
from skinlab.tui.session_keys import SessionKeys
from skinlab.tui.settings_file import LOOKING, UserSettings
from skinlab.tui.shown import Aimed, Playing
from skinlab.tui.starting import Starting
from skinlab.tui.themes import ORDER, OWN, WORDS, next_theme
from skinlab.tui.typing_guard import TypingGuard, is_typing
from skinlab.tui.ui_state import SEARCHING, Board, Level
from skinlab.tui.widgets.fields import Fields
from skinlab.tui.widgets.reading import Reading

if TYPE_CHECKING:
    from skinlab.acquisition.protocol import NamedProtocol
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


class SkinlabApp(PartedApp):
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
        now: Callable[[], datetime] = datetime.now,
        reference: Reference | None = None,
        user: UserSettings | None = None,
        protocol: NamedProtocol | None = None,
        study: Path | None = None,
    ) -> None:
        """Begin with a port, with the replay of a session, or (neither) by asking.

        Settings are kept for the next time in `settings`; None: nowhere. `model` names what
        curves are identified with; None: the base law. `clock` (s) tells typing from confirming,
        and `now`, local time, one day from the next. `reference` has the usual ranges that values
        are shown against, `user` the colours and further keys of the settings file, `protocol` what
        a study demands; `study`, a folder of `skinlab study`, says how much visits, operators and
        placements scatter.
        """
        super().__init__()
        self._line_filters: tuple[tuple[LineFilter, ...], ...] = ((), (InertText(),))
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
        self.folder = folder
        self._ask = port is None and replay is None
        self._replay = replay
        self._speed = speed
        self._ports = ports
        self._settings = settings
        self.bench: ProbeSession | Replayer = make_bench(folder, self.post)
        self._make_replayer = make_replayer
        self.board.model = model
        self.board.reference = reference
        self.board.protocol = protocol
        self.board.study = study
        self.failure: Exception | None = None  # a bug that ended the app
        self._leaving = False
        self._begun = False
        self._crash_left = ""  # said once more when a probe is connected
        self._ahead: deque[events.Key] = deque()  # typed before the main screen was there
        self._clock = clock
        self._protocol_steps = ProtocolSteps(self)
        self._starting = Starting(self, settings, self._protocol_steps, now)
        self._session_keys = SessionKeys(self)
        self._missing_keys = MissingKeys(self)
        self._replay_keys = ReplayKeys(self, self._starting)

    # ---- life ---------------------------------------------------------------------------------

    def get_default_screen(self) -> MainScreen:
        """Begin with the main screen."""
        main = MainScreen(self.board, recall(self._settings), self.guard)
        breakpoints = (self.HORIZONTAL_BREAKPOINTS, self.VERTICAL_BREAKPOINTS)
        for cells, classes in zip(self.size, breakpoints, strict=True):
            # Now: once it is told its size, all of it would be styled once more
            main.add_class(max(c for c in classes if c[0] <= cells)[1], update=False)
        return main

    def on_ready(self) -> None:
        """Begin once the main screen has its parts; the app may run before."""
        self.main.call_later(self.call_later, self._begin)

    def _begin(self) -> None:
        """Connect, and load what identification needs meanwhile."""
        self._begun = True
        self.main.begin()
        self._tick()
        self._crash_left = _left_by_a_crash(self.folder)
        if self._crash_left:
            self.board.say(Level.WARNING, self._crash_left)
        self.set_interval(_TICK_S, self._tick)
        self.set_interval(_REPAINT_S, self._see_again)
        if self._ask:
            self.push_screen(WelcomeScreen(self.board, self._ports()), self._welcomed)
        elif self._replay is not None:
            self._play(self._replay)
        else:
            self._starting.connect(self.board.port)
        self.perform("preparing", self.bench.analysis.prepare)
        self.call_later(self._catch_up)

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
            self.fields.put("port", choice)
            self._starting.connect(choice)

    def vent(self, reason: str) -> None:
        """Vent what is connected; from any thread."""
        self.bench.vent(reason)

    def close_bench(self) -> None:
        """Vent, and finish the session; from any thread."""
        self.bench.close()

    # ---- a replay -----------------------------------------------------------------------------

    def _play(self, path: Path) -> None:
        folder = self.folder if path == example_session() else path.parent  # for models
        replayer = self._make_replayer(folder, self.post, self._speed)
        self.bench = replayer
        self.board.playing = Playing(speed=self._speed)
        self._starting.connect(str(path))

    @on(Reading.Pointed)
    def _pointed(self, message: Reading.Pointed) -> None:
        self._replay_keys.point(message.share)

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
        """Return Textual's filters, safe for text without a style, behind our own.

        The same ones each time: every line of the screen keeps what a filter has made of it, and a
        filter that is new makes it again, of all lines in each frame.
        """
        inner = tuple(super().get_line_filters())
        if inner != self._line_filters[0]:
            self._line_filters = inner, (InertText(), *map(StyledFirst, inner))
        return self._line_filters[1]

    # ---- threads ------------------------------------------------------------------------------

    def post(self, news: News | Aimed) -> None:
        """Hand news over to the thread that draws; from any thread."""
        try:
            self.post_message(self.Said(news))
        except RuntimeError:
            return  # the loop is closed: nobody is left to read it

    def perform(self, doing: str, call: Callable[[], None]) -> None:
        """Do something slow in a thread; its end is news, whichever it is."""

        def work() -> None:
            try:
                call()
            except (SkinlabError, DriverError) as error:
                self.post(Failed(doing, str(error)))
            except Exception as error:  # noqa: BLE001 -- told in a sentence; details are logged
                self.bench.vent("internal error")
                where = log_exception(error)
                self.post(Failed(doing, f"{doing} failed ({error!r}); details are in {where}"))
            else:
                self.post(Done(doing))

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
                if self._crash_left and self.board.playing is None:
                    # Again: to connect had covered it
                    self.board.remind(Level.WARNING, self._crash_left)
                    self._crash_left = ""
                self._starting.connected(news)
            case Recording():
                self._protocol_steps.record()
            case Adopted():
                self._starting.anew = news.anew  # a session is identified with one model
            case Disconnected():
                self._starting.disconnected()
            case Failed("connecting"):
                self._starting.forget()
            case Done("connecting"):
                self._replay_keys.over()
            case Done("closing"):
                self._leave()
            case _:
                pass
        if self.board.alarm_text is not None:
            self._raise_alarm(self.board.alarm_text)
        if self.screen is self.main and not _only_samples(news):
            self.main.draw()  # now, not with the next frame: it is waited for
        if isinstance(news, Heard) and any(isinstance(m, Identified) for m in news.messages):
            self._session_keys.aim()

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
            self.board.tell(f"{_shown(name)}: {self._why_not}")

    @property
    def _why_not(self) -> str:
        """Why a key means nothing."""
        board = self.board
        if board.playing is not None:
            return "no meaning in a replay; ? lists the keys"
        if board.alarm is not None:
            return "not before the alarm is acknowledged (F9)"
        why = "no meaning here" if board.can_arm else f"not now ({board.phase.lower()})"
        return f"{why}; ? lists the keys"

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
        if key is not None and (self._ahead or not self._begun):
            self._ahead.append(key)
        else:
            await super().on_event(event)

    async def _catch_up(self) -> None:
        """Do what the first key does that waits; those behind it once what it opened is there."""
        if self._ahead:
            await super().on_event(self._ahead.popleft())
            self.call_later(self._catch_up)

    @property
    def _vent_keys(self) -> list[str]:
        return self._own_keys.get("vent", "v").split(",")

    @property
    def main(self) -> MainScreen:
        """The main screen, whatever lies over it."""
        screen = self.screen_stack[0]
        assert isinstance(screen, MainScreen)
        return screen

    @property
    def fields(self) -> Fields:
        """The settings on it."""
        return self.main.query_one(Fields)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """While a field takes text, v is text."""
        shown = {"vent_probe": not self.board.read_only, "give_up_probe": self.board.read_only}
        if action in shown and (self.board.playing is not None or not shown[action]):
            return False  # in a replay the app's own key, which no screen shows, says why
        if action in {"vent_key", *shown}:
            return not isinstance(self.focused, Input) or self.board.moving
        if action == "ports":
            return self.board.can_arm and isinstance(self.screen, MainScreen)
        return super().check_action(action, parameters)

    def action_vent_key(self) -> None:
        """Vent."""
        self.action_vent()

    def action_vent_probe(self) -> None:
        """Vent; the line of keys shows it, but in a replay."""
        self.action_vent()

    def action_give_up_probe(self) -> None:
        """Do the same where the instrument is only read; the line of keys shows it."""
        self.action_vent()

    def action_vent(self) -> None:
        """Vent at once; close what is open over the main screen, and leave the fields."""
        self.bench.vent("operator")
        if self.board.playing is not None:
            self.board.say(Level.INFO, "a replay: no probe is connected, and nothing is vented")
        elif self.board.doing == SEARCHING:
            self.board.say(Level.WARNING, "no link, so no vent arrives: lift the probe")
        elif self.board.moving and self.board.read_only:
            self.board.say(Level.WARNING, "given up here; end the suction at the instrument")
        elif self.board.moving:
            self.board.say(Level.WARNING, "vent ordered")
        self._starting.forget()
        self.board.withdraw()
        if isinstance(self.screen, SessionScreen):
            self.screen.leave_line()
        elif isinstance(self.screen, ConfirmScreen):
            self.screen.dismiss(False)
        elif isinstance(self.screen, _LEFT_BY_VENT):
            self.pop_screen()
        self.main.set_focus(None)
        self.main.draw()

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
        if self.screen is self.main and not self._own_keys:
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
        here = {} if below is self.main else self._commands_here()

        async def chosen(action: str | None) -> None:
            if action is None or self.screen is not below:
                return
            if action in here:
                done = await self.run_action(here[action].action, below)
            else:
                while self.screen is not self.main:
                    self.pop_screen()
                done = await self.run_action(action, self.main)
            if not done:
                self.board.answer(Level.INFO, "that means nothing at this moment")

        listed = [Command(name, f"here: {c.words}", c.key) for name, c in here.items()]
        offered = (*listed, *commands_for(self.board))
        self.push_screen(PaletteScreen(self.board, offered), chosen)

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
        self.push_screen(PortsScreen(self.board), self._starting.port_chosen)

    def action_theme(self) -> None:
        """Change the colours: dark, light, high contrast, colour-blind safe."""
        self.theme = next_theme(self.theme)
        remember_choice(self._settings, "theme", self.theme)
        self.board.answer(Level.INFO, f"colours: {WORDS[self.theme]}")
        self.main.redraw()

    def action_leave(self) -> None:
        """Ask whether to vent, finish the session and quit; where that was asked, press F9."""
        if not isinstance(self.screen, AlarmScreen):
            self._ask_to_leave()

    def _ask_to_leave(self) -> None:
        if self._leaving or isinstance(self.screen, ConfirmScreen):
            return
        saved = "the session is saved, " if self.board.visit else ""
        what = f"The probe vents, {saved}the program ends."
        if self.board.playing is not None:
            what = "The program ends."
        elif self.board.out_of_reach:
            what = f"No probe is connected; {saved}the program ends."
        elif self.board.read_only:
            what = f"The instrument is not vented from here; {saved}the program ends."
        question = ConfirmScreen(self.board, self.guard, "Quit?", what)
        self.push_screen(question, self._may_leave)

    def action_stop(self) -> None:
        """Vent at once, and ask whether to quit; over an alarm too: it may come back for good."""
        self.bench.vent("operator")
        self.board.withdraw()
        self._ask_to_leave()

    def _may_leave(self, yes: bool | None) -> None:
        if not yes or self._leaving:
            return
        self.bench.vent("quit")
        self._leaving = True
        self.board.begin("closing", "venting, saving the session …")
        self.perform("closing", self.bench.close)

    def _leave(self) -> None:
        if self.board.alarm is None:  # else once it is acknowledged
            self.exit()

    @on(MainScreen.Wanted)
    def _wanted(self, message: MainScreen.Wanted) -> None:
        match message.what:
            case "check" if self.board.can_arm:
                self._starting.check()
            case "start" | "early" if self.board.can_arm:
                self._starting.confirm()
            case "play" | "step" | "faster" | "slower" | "event":
                self._replay_keys.press(message.what)
            case "time":
                self._replay_keys.ask_time()
            case what if what.startswith("to "):
                self._replay_keys.point(int(what.removeprefix("to ")) / 10)
            case "pick" if self.board.can_arm:
                self._pick()
            case "visits":
                analysis = self.bench.analysis
                self.push_screen(VisitsScreen(self.board, self.folder, lambda: analysis.identifier))
            case "protocol" if self.board.protocol is None:
                self.board.tell("no protocol is followed here; skinlab ui --protocol FILE does")
            case "protocol":
                self.push_screen(ProtocolScreen(self.board))
            case "goal":
                self._session_keys.choose_goal()
            case "next" if self.board.can_arm:
                if not self._protocol_steps.load_step():
                    self._session_keys.load_advice()
            case "rested" if self.board.can_arm:
                self._starting.count_anew()
            case "placed" if self.board.can_arm:
                self._starting.put_on_anew()
            case "card":
                self.board.second_card = not self.board.second_card
                self.board.touch()
            case "session":
                self.push_screen(SessionScreen(self.board))
            case "missing":
                self._missing_keys.show()
            case _:
                pass

    def _pick(self) -> None:
        """Offer a list for the field that is typed in; without one, that of programs."""
        self.board.withdraw()
        focused = self.main.focused
        field = str(focused.id) if isinstance(focused, Input) else "program"
        choices = choices_for(field)
        if not choices:
            self.board.answer(Level.INFO, "lists there are for site, opening and program")
            return

        def chosen(text: str | None) -> None:
            if text is not None:
                self.fields.put(field, text)
                self.fields.follow()

        title = {"aperture_mm": "Opening", "site": "Site"}.get(field, "Program")
        screen = PickScreen(self.board, title, choices, body=field == "site")
        self.push_screen(screen, chosen)

    # ---- what other screens ask for -----------------------------------------------------------

    @on(Fields.Named)
    def _named(self, message: Fields.Named) -> None:
        self.board.name(message.who)

    @on(ProtocolScreen.Wanted)
    def _step_wanted(self) -> None:
        self._protocol_steps.go_to_step()

    @on(ProtocolScreen.Stated)
    def _conditions_stated(self) -> None:
        self._protocol_steps.state_conditions()

    @on(SessionScreen.Decided)
    def _decided(self, message: SessionScreen.Decided) -> None:
        self._session_keys.decide(message)

    @on(SessionScreen.Wanted)
    def _session_wanted(self, message: SessionScreen.Wanted) -> None:
        if message.what == "missing":
            self._missing_keys.show()
        else:
            self._session_keys.do(message)

    @on(MissingScreen.Wanted)
    def _missing_wanted(self, message: MissingScreen.Wanted) -> None:
        self._missing_keys.do(message)

    def audit(self, what: str, **detail: Any) -> None:
        """Record in the session what the operator did; say so where that cannot be."""
        try:
            self.bench.audit(what, **detail)
        except SkinlabError as error:
            self.board.refuse(str(error))


def _shown(key: str) -> str:
    """Return a key as it stands on the keyboard."""
    named = {
        "delete": "Del",
        "insert": "Ins",
        "pageup": "PgUp",
        "pagedown": "PgDn",
        "escape": "Esc",
    }
    *held, last = key.split("+") if len(key) > 1 else [key]
    if last in named:
        last = named[last]
    elif len(last) > 1 or held:
        last = last[0].upper() + last[1:].replace("_", " ")
    return "+".join([*map(str.capitalize, held), last])


def _left_by_a_crash(folder: Path) -> str:
    """Return what to do about the journals that crashes left in a folder; empty: there are none."""
    journals = [journal.name for journal in all_left_behind(folder)]
    if not journals:
        return ""
    if len(journals) == 1:
        return f"{journals[0]} was left by a crash: skinlab recover makes a session of it"
    named = f"{', '.join(journals[:-1])} and {journals[-1]}"
    return f"{named} were left by crashes: skinlab recover makes a session of each"


def _only_samples(news: News | Aimed) -> bool:
    return isinstance(news, Heard) and all(map(_is_sample, news.messages))


def _is_sample(message: StreamMessage) -> bool:
    of_no_curve = isinstance(message, Happened) and isinstance(message.event, Sample)
    return of_no_curve or isinstance(message, Sampled)
