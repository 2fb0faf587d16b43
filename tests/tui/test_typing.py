"""Typing never acts: whatever is typed, whenever, only what was shown and confirmed starts.

`SOAK_DONE=FILE pytest -m soak -n 0 tests/tui/test_typing.py` does it at length, in pieces of a few
seconds to a minute; FILE has the pieces that passed, and the same command goes on behind them.
"""

from __future__ import annotations

import random
import string
import threading
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual import events
from textual.errors import NoWidget
from textual.widgets import Input

from drivers.events import Alarm
from drivers.probe import Probe
from skinlab.acquisition.messages import Heard
from skinlab.recording.session import example_session
from skinlab.recording.stream import Happened
from skinlab.tui.screens.alarm import AlarmScreen
from skinlab.tui.screens.help import HelpScreen
from skinlab.tui.screens.main import MainScreen
from skinlab.tui.screens.messages import MessagesScreen
from skinlab.tui.screens.missing import MissingScreen
from skinlab.tui.screens.over import ConfirmScreen
from skinlab.tui.screens.palette import PaletteScreen
from skinlab.tui.screens.pick import PickScreen
from skinlab.tui.screens.ports import PortsScreen
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.screens.visits import VisitsScreen
from skinlab.tui.screens.welcome import WelcomeScreen
from skinlab.tui.typing_guard import LOOK_S, QUIET_S, TypingGuard, is_typing
from skinlab.tui.widgets.fields import Fields
from skinlab.tui.widgets.keys import Keys

TEXT = [*string.ascii_letters, *string.digits, "full_stop", "comma", "minus", "plus"]
TEXT += ["question_mark", "space", "space", "enter", "enter", "enter", "space", "tab", "backspace"]
CHARACTERS = {"full_stop": ".", "comma": ",", "minus": "-", "plus": "+", "question_mark": "?"}
CHARACTERS |= {"space": " ", "enter": "\r", "tab": "\t", "backspace": "\x7f"}
OTHER = ["f8", "f8", "f9", "f9", "f9", "f1", "f2", "f3", "f7", "escape", "delete", "ctrl+z"]
OTHER += ["up", "down", "home", "end", "shift+tab", "ctrl+q", "ctrl+c", "f8", "f5", "f10"]
LONG = "ramp:100@2"
KEYS_OF_A_STATE, KEYS_OF_A_WALK = 12, 260
SOAK_KEYS = 10_000
SEEDS_OF_A_STATE, KEYS_OF_A_PIECE = 10, 200
# Never tried once more: a start that nobody confirmed is none the less one for being rare
soak = [pytest.mark.soak, pytest.mark.flaky(reruns=0)]


class Starts:
    """Makes probes that tell which runs were started."""

    def __init__(self):
        self.count = 0

    def __call__(self, url, **options):
        starts = self

        class Watched(Probe):
            def start(self):
                starts.count += 1
                super().start()

        return Watched(url, **options)


class Searching:
    """In the place of the search for what is missing: waits until it is given up."""

    def __init__(self):
        self.go = threading.Event()

    def __call__(self, campaign, model, tell, database_path):
        tell("screening")
        self.go.wait(120.0)

    def cancel(self):
        self.go.set()


# ---- the guard ------------------------------------------------------------------------------


def guard_at(*, typed, asked, pressed):
    """A guard to which these things happened at these times, in their order."""
    now = [0.0]
    guard = TypingGuard(lambda: now[0])
    for at, what in sorted([(typed, guard.typed), (asked, guard.asked)], key=lambda x: x[0]):
        now[0] = at
        what()
    now[0] = pressed
    return guard, now


@given(*(st.floats(0.0, 10.0) for _ in range(3)))
def test_a_confirmation_counts_where_nobody_typed_and_somebody_looked(typed, asked, more):
    pressed = max(typed, asked) + more
    guard, _ = guard_at(typed=typed, asked=asked, pressed=pressed)
    allowed = pressed - typed >= QUIET_S and pressed - asked >= LOOK_S
    assert (guard.refusal() is None) == allowed


def test_what_is_refused_is_asked_again():
    guard, now = guard_at(typed=5.0, asked=0.0, pressed=5.9)
    assert "typed" in guard.refusal()
    now[0] = 6.1  # 1.1 s after the letter, but only 0.2 s after the question was asked again
    assert "twice" in guard.refusal()
    now[0] = 6.5
    assert guard.refusal() is None


def test_without_a_question_nothing_is_confirmed():
    guard = TypingGuard(lambda: 100.0)
    assert guard.refusal() is not None
    guard, _ = guard_at(typed=0.0, asked=0.0, pressed=100.0)
    guard.hidden()
    assert guard.refusal() is not None


def test_what_is_typing():
    assert is_typing("a", printable=True)
    assert is_typing("enter", printable=False)
    assert not is_typing("f9", printable=False)


# ---- words at every moment ------------------------------------------------------------------


async def main_screen(bed):
    await bed.connected()


async def in_a_field(bed):
    await bed.connected()
    await bed.press("f3")
    await bed.until(lambda: isinstance(bed.app.focused, Input))


async def summary(bed):
    await bed.connected()
    await bed.check()


async def running(bed):
    await bed.connected()
    await bed.fill("program", LONG)
    await bed.start()
    await bed.until(lambda: bed.board.live)


async def resting(bed):
    await bed.connected()
    await bed.fill("repeats", "2")
    await bed.fill("rest_s", "3600")
    await bed.start()
    await bed.until(lambda: bed.board.phase == "RESTING")


def opened(name, key, screen, *, measured=False):
    """A state: this screen, opened by this key, with a curve or without."""

    async def state(bed):
        await bed.connected()
        if measured and not bed.board.entries:
            await bed.run()
        await bed.press(key)
        await bed.on(screen)

    state.__name__ = name
    return state


session = opened("session", "s", SessionScreen, measured=True)
missing = opened("missing", "d", MissingScreen, measured=True)
visits = opened("visits", "f5", VisitsScreen, measured=True)
help_ = opened("help_", "f1", HelpScreen)
ports = opened("ports", "f2", PortsScreen)
palette = opened("palette", "ctrl+p", PaletteScreen)
pick = opened("pick", "f4", PickScreen)
goal = opened("goal", "g", PickScreen)
messages = opened("messages", "w", MessagesScreen)
quit_question = opened("quit_question", "q", ConfirmScreen)


async def prompt(bed):
    await session(bed)
    await bed.press("delete")
    await bed.until(lambda: isinstance(bed.app.focused, Input))


async def search_of_visits(bed):
    await visits(bed)
    await bed.press("slash")
    await bed.until(lambda: isinstance(bed.app.focused, Input))


async def replay(bed):
    await bed.until(lambda: bed.board.playing is not None and bed.board.hello is not None)


async def alarm(bed):
    await bed.connected()
    news = Heard((Happened(Alarm("lift the probe")),))
    bed.app.post_message(bed.app.Said(news))
    await bed.on(AlarmScreen)


async def welcome(bed):
    await bed.on(WelcomeScreen)


# Those in a row need no app of their own
TOGETHER = [
    [summary, help_, palette, pick, goal, messages, quit_question, in_a_field, main_screen, ports],
    [session, prompt, missing, visits, search_of_visits],
    [running], [resting], [replay], [alarm], [welcome],
]  # fmt: skip
STATES = [state for states in TOGETHER for state in states]
STUDIES = [session, resting, replay]


async def type_in(bed, state, keys, rng, starts):
    """Come into a state, and type; nothing starts, quits, or takes an alarm away."""
    await state(bed)
    started, alarmed = starts.count, bed.board.alarm
    excluded = dict(bed.board.ledger.excluded)
    typed = 0
    while typed < keys:
        word = rng.choices(TEXT, k=rng.randint(1, 8))
        typed += len(word)
        bed.clock.now_s += rng.choice([0.0, 0.05, 0.2, 0.9, 1.5, 5.0])
        for key in word:
            bed.app.post_message(events.Key(key, CHARACTERS.get(key, key)))
        await bed.settle()
        assert starts.count == started, word
    assert bed.app.return_code is None
    assert bed.board.alarm == alarmed
    assert bed.board.model is None
    if state is not prompt:  # there it is the answer
        assert bed.board.ledger.excluded == excluded


async def type_in_each(bedside, states, keys, seed):
    starts, rng = Starts(), random.Random(seed)
    options = {"ports": tuple} if welcome in states else {}
    if replay in states:
        options = {"replay": example_session()}
    port = None if options else "sim://?seed=1&speed=5"
    async with bedside(port, make_probe=starts, explain=Searching(), **options) as bed:
        main = bed.app.screen_stack[0]
        for number, state in enumerate(states):
            if number:
                await bed.press("escape")
                while bed.app.screen is not main:  # Esc vents, and stays in the session
                    await bed.press("s" if isinstance(bed.app.screen, SessionScreen) else "escape")
            await type_in(bed, state, keys, rng, starts)


@pytest.mark.parametrize(
    "states",
    [
        pytest.param(
            states, id=states[0].__name__, marks=pytest.mark.long if states[0] in STUDIES else ()
        )
        for states in TOGETHER
    ],
)
async def test_words_start_nothing(bedside, states):
    await type_in_each(bedside, states, KEYS_OF_A_STATE, seed=14)


@pytest.mark.parametrize("seed", [pytest.param(n, marks=soak) for n in range(SEEDS_OF_A_STATE)])
@pytest.mark.parametrize("state", STATES, ids=lambda state: state.__name__)
async def test_ten_thousand_keys_start_nothing(bedside, state, seed):
    keys = SOAK_KEYS // len(STATES) // SEEDS_OF_A_STATE + 1
    await type_in_each(bedside, [state], keys, seed)


async def test_keys_that_wait_behind_tab_go_to_the_field_it_went_to(bedside):
    async with bedside() as bed:
        await bed.connected()
        for key in ["f3", *["shift+tab"] * 8, *"A1", *["tab"] * 8, "end", *",ramp:0@50"]:
            bed.app.post_message(events.Key(key, key if len(key) == 1 else None))
        fields = bed.app.screen.query_one(Fields)
        await bed.until(lambda: fields.texts()["program"].endswith(",ramp:0@50"))
        assert fields.texts()["subject"] == "A1"


async def test_pasted_text_starts_nothing(bedside):
    starts = Starts()
    async with bedside(make_probe=starts) as bed:
        for state in (main_screen, summary):
            await state(bed)
            bed.app.post_message(events.Paste("arm start f9\n \n\x1b[20~ v q"))
            await bed.press("f9")
            await bed.pilot.pause()
            assert starts.count == 0
        await bed.until(lambda: "typed a moment ago" in bed.board.note)
        bed.clock.now_s += 2.0
        await bed.press("f9")  # asked again, and answered
        await bed.until(lambda: starts.count == 1)


# ---- all keys -------------------------------------------------------------------------------


async def walk(bed, keys, rng, starts):
    """Press any keys; return how many starts were allowed, by what was on the screen."""
    main = bed.app.screen_stack[0]
    allowed, typed_s, checked = 0, -10.0, False
    pressed = 0
    while pressed < keys and bed.app.return_code is None:
        burst = [rng.choice(TEXT + OTHER * 2)]
        if rng.random() < 0.06 and bed.app.screen is main and bed.board.can_arm:
            bed.app.query_one("#subject", Input).value = f"P{rng.randint(1, 9)}"
            burst = ["f8", "f8", "f9"]
        for key in burst:
            bed.clock.now_s += 2.0 if len(burst) > 1 else rng.choice([0.0, 0.1, 0.5, 1.5, 3.0])
            in_view = bed.app.screen is main and bed.text("#card-title").startswith("THIS WILL")
            quiet = bed.clock.now_s - typed_s >= QUIET_S
            if key == "f9" and in_view and quiet and checked:
                review = bed.board.review
                allowed += review.order.repeats if review else 0
            if key == "f8":
                checked = True
            elif key in {"v", "escape", "ctrl+c", "f3", "f9"}:
                checked = key == "f9" and checked
            if is_typing(key, printable=len(key) == 1):
                typed_s = bed.clock.now_s
            await bed.press(key)
            pressed += 1
            assert starts.count <= allowed, (key, pressed)
            if bed.app.return_code is not None:
                break
    return allowed


async def walk_one(bedside, keys, seed):
    starts = Starts()
    async with bedside("sim://?seed=1&speed=20", make_probe=starts, explain=Searching()) as bed:
        await bed.connected()
        allowed = await walk(bed, keys, random.Random(seed), starts)
    return starts.count, allowed


@pytest.mark.long
async def test_any_keys_start_only_what_was_shown_and_confirmed(bedside):
    found: list[tuple[int, int]] = []
    for seed in range(40):  # until something was started, else nothing was tried
        if seed >= 4 and any(started for started, _ in found):
            break
        found.append(await walk_one(bedside, KEYS_OF_A_WALK // 4, seed))
    assert all(started <= allowed for started, allowed in found)
    assert any(started for started, _ in found)


@pytest.mark.parametrize(
    "seed", [pytest.param(100 + n, marks=soak) for n in range(SOAK_KEYS // KEYS_OF_A_PIECE)]
)
async def test_ten_thousand_keys_start_only_what_was_shown_and_confirmed(bedside, seed):
    started, allowed = await walk_one(bedside, KEYS_OF_A_PIECE, seed)
    assert started <= allowed


# ---- words, runs, clicks anywhere, other sizes ----------------------------------------------

WORDS = [
    "start",
    "measure now",
    "yes",
    "forearm",
    "vent",
    "ramp:300@20",
    "f9",
    "dd",
    "qqq",
    "j",
    "n",
]
SIZES = [(60, 20), (80, 24), (120, 40), (160, 50), (40, 12)]
STEPS_OF_A_HAND, HANDS = 40, 60


def clicked_key(bed, at):
    """Return the key that a click there presses, if it is one of the bottom line."""
    with suppress(NoWidget):
        widget, _ = bed.app.screen.get_widget_at(*at)
        if isinstance(widget, Keys):
            return widget.key_at(at[0])
    return None


def inputs(bed, rng):
    """Return what a hand does next: keys, and places that are clicked."""
    match rng.choices(["word", "run", "key", "click", "begin"], [4, 2, 6, 5, 2])[0]:
        case "word":
            return list(rng.choice(WORDS))
        case "run":
            return [rng.choice(["enter", "space", "tab"])] * rng.randint(2, 6)
        case "key":
            return [rng.choice([*OTHER, "f4", "f6", "w", "t", "r", "g", "s", "q", "ctrl+p"])]
        case "click":
            size = bed.app.size
            row = rng.choice([size.height - 1, rng.randrange(size.height)])  # the keys more often
            return [(rng.randrange(size.width), row)]
    return ["f8", "f8", "f9"]


async def fumble(bed, steps, rng, starts):
    """Do anything; return how many starts were allowed, by what was on the screen."""
    app, main = bed.app, bed.app.screen_stack[0]
    allowed, typed_s = 0, -10.0
    for _ in range(steps):
        if rng.random() < 0.1:
            await bed.pilot.resize_terminal(*rng.choice(SIZES))
        if rng.random() < 0.2 and app.return_code is None and app.screen is main:
            main.query_one("#subject", Input).value = f"P{rng.randint(1, 9)}"
        for one in inputs(bed, rng):
            if app.return_code is not None:
                return allowed
            bed.clock.now_s += rng.choice([0.0, 0.1, 0.5, 1.5, 3.0])
            key = one if isinstance(one, str) else clicked_key(bed, one)
            in_view = app.screen is main and bed.text("#card-title").startswith("THIS WILL")
            quiet = bed.clock.now_s - typed_s >= QUIET_S
            if key in {"f9", "ctrl+g"} and in_view and quiet and bed.board.review:
                allowed += bed.board.review.order.repeats
            if isinstance(one, str):
                if is_typing(one, printable=len(one) == 1):
                    typed_s = bed.clock.now_s
                await bed.press(one)
            else:
                await bed.pilot.click(offset=one)
            assert starts.count <= allowed, one
    return allowed


async def fumble_one(bedside, steps, seed):
    starts, rng = Starts(), random.Random(seed)
    port, size = "sim://?seed=1&speed=20", rng.choice(SIZES)
    async with bedside(port, size=size, make_probe=starts, explain=Searching()) as bed:
        await bed.connected()
        allowed = await fumble(bed, steps, rng, starts)
    return starts.count, allowed


@pytest.mark.long
async def test_a_fumbling_hand_starts_only_what_was_shown_and_confirmed(bedside):
    started, allowed = await fumble_one(bedside, STEPS_OF_A_HAND, seed=3)
    assert started <= allowed


@pytest.mark.parametrize("seed", [pytest.param(100 + n, marks=soak) for n in range(HANDS)])
async def test_many_fumbling_hands_start_only_what_was_shown_and_confirmed(bedside, seed):
    started, allowed = await fumble_one(bedside, STEPS_OF_A_HAND, seed)
    assert started <= allowed


# ---- what stands on every screen ------------------------------------------------------------


async def stands(bed):
    """The state, suction and that it is simulated stand on the screen that is open."""
    await bed.until(lambda: bed.app.screen.query("#phase"))
    await bed.until(lambda: bed.text("#phase") == bed.board.phase)
    assert "SIMULATED" in bed.text("#banner")
    await bed.until(lambda: "suction" in bed.text("#suction").lower())


@pytest.mark.long
async def test_every_screen_says_how_the_probe_is_and_is_closed_by_a_key(bedside):
    async with bedside("sim://?seed=1&speed=20", explain=Searching()) as bed:
        await main_screen(bed)
        await stands(bed)
        await summary(bed)
        await stands(bed)
        await bed.press("v")
        await bed.until(lambda: bed.board.can_arm and bed.board.review is None)
        for state in (help_, ports, palette, pick, messages, visits, missing):
            await state(bed)
            await stands(bed)
            await bed.press("escape")
            await bed.on(MainScreen)
        for state, back in ((session, "s"), (quit_question, "f8")):
            await state(bed)
            await stands(bed)
            await bed.press(back)
            await bed.on(MainScreen)
        await alarm(bed)
        await stands(bed)


async def test_without_a_probe_the_welcome_says_so(bedside):
    async with bedside(None, ports=tuple) as bed:
        await welcome(bed)
        await bed.until(lambda: bed.app.screen.query("#phase"))
        await bed.until(lambda: bed.text("#phase") == bed.board.phase)
        assert "no probe" in bed.text("#suction")


# Every screen of a running measurement, by its keys from the main one
OVER_A_RUN = ["s", "s n", "f1", "q", "f5", "f5 slash", "w", "ctrl+p"]


async def opened_over_a_run(bed, keys):
    for key in keys.split():
        await bed.press(key)
        await bed.until(lambda: not isinstance(bed.app.screen, MainScreen))
    if len(keys.split()) > 1 or keys == "ctrl+p":
        await bed.until(lambda: isinstance(bed.app.focused, Input))
    await bed.until(lambda: bed.text("#suction") == "SUCTION: v vents")


async def test_every_screen_has_the_vent_key_while_suction_is_on(bedside):
    async with bedside("sim://?seed=1&speed=1") as bed:
        await running(bed)
        main, bench = bed.app.screen, bed.app.bench
        vent, asked = bench.vent, []
        bench.vent = asked.append
        for keys in OVER_A_RUN:
            asked.clear()
            await opened_over_a_run(bed, keys)
            await bed.press("v")
            await bed.until(lambda: asked)
            while bed.app.screen is not main:
                bed.app.pop_screen()
                await bed.settle()
        bench.vent = vent
        await opened_over_a_run(bed, OVER_A_RUN[-1])
        vents = bench.vents
        await bed.press("v")
        await bed.until(lambda: bench.vents > vents)
        await bed.until(lambda: not bed.board.suction)
        await bed.until(lambda: bed.text("#suction") == "suction off")


@pytest.mark.parametrize(
    ("keys", "left"),
    [
        (["backspace", "1"], "P-21"),
        (["backspace", "backspace", "x", "y"], "P-xy"),
        (["left", "3"], "P-230"),
        (["home", "Q"], "QP-20"),
        (["ctrl+u", "R", "1"], "R1"),
        (["home", "delete", "R"], "R-20"),
    ],
)
async def test_keys_in_one_burst_edit_in_their_order(bedside, keys, left):
    """Letters overtook the Backspace before them: another subject than was typed."""
    async with bedside() as bed:
        await bed.connected()
        await bed.type("subject", "P-20")
        for key in keys:
            bed.app.post_message(events.Key(key, key if len(key) == 1 else None))
        box = bed.app.screen.query_one("#subject", Input)
        await bed.until(lambda: box.value == left)
        await bed.settle()
        assert box.value == left
        assert bed.board.who[0] == left
