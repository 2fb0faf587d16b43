"""What the screen shows, as plain state: made from news, by the thread that draws."""

from __future__ import annotations

import math
from collections import deque
from datetime import datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.dose import SUCTION_MBAR, Dose, DoseMeter
from drivers.events import (
    Alarm,
    Damaged,
    Event,
    Hello,
    HostVented,
    InstrumentState,
    LinkLost,
    Sample,
    State,
    VentConfirmed,
)
from skinlab.acquisition.measurement_messages import Phase, Plan
from skinlab.acquisition.measurement_request import Order
from skinlab.acquisition.messages import (
    Adopted,
    Compared,
    Connected,
    Disconnected,
    Done,
    Estimated,
    Explained,
    Explaining,
    Failed,
    Fitted,
    Heard,
    News,
    Over,
    Played,
    Recording,
    Saved,
    Went,
)
from skinlab.acquisition.protocol import OPERATOR
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.placement import begins_placement, placements_of
from skinlab.curves.program import Program, parse_program
from skinlab.errors import InputError
from skinlab.recording.curve_selection import Ledger
from skinlab.recording.stream import (
    CurveCompleted,
    CurveStarted,
    Flagged,
    Happened,
    Identified,
    Message,
    Sampled,
)
from skinlab.report.outage import event_note
from skinlab.report.verdict import FEW
from skinlab.tui.shown import Aimed, Entry, Live, Missing, Playing, Review

if TYPE_CHECKING:
    from skinlab.acquisition.protocol import NamedProtocol
    from skinlab.inference.result import Identification
    from skinlab.report.protocol import Done as DoneCurve
    from skinlab.report.protocol import Progress
    from skinlab.studies.reference import Range, Reference
    from skinlab.tui.goal import AnyDistance, AnyGoal

_S = InstrumentState
SEARCHING = "searching"  # for a link that was lost
WHOSE = "whose skin is it? Type a pseudonym, or F8 goes on without one"
MEASURING = "measuring"  # asked for; the phases of the measurement tell what becomes of it
_DOING = {
    Phase.ARMING: "arming",
    Phase.STARTING: "starting",
    Phase.SETTLING: "venting",
    Phase.RESTING: "resting",
    Phase.VENTING: "venting",
    Phase.SEARCHING: SEARCHING,
    Phase.CHECKING: SEARCHING,
}
PLACED_KEY = "Ins"  # says that the probe was put on anew
EXPLAINING = "explaining"  # what the model misses; everything else goes on beside it
_MOST_EARLIER = 4  # curves drawn behind the shown one
_MOVING = frozenset({_S.ARMED, _S.RUNNING, _S.VENTING})


class Level(StrEnum):
    """How much a note matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


_RANK = {Level.INFO: 0, Level.WARNING: 1, Level.ERROR: 2}
_LASTS_S = {Level.INFO: 12.0, Level.WARNING: 45.0, Level.ERROR: 120.0}  # on the screen
_ASIDE_S = 4.0  # the answer to a key that does nothing
_STREAM_S = 1.0  # without a reading: nothing streams; far above a sample interval
_MOST_TOLD = 200  # messages that can be read again
_BREAK = timedelta(hours=4)  # on another day: no visit goes on after it
_BUSY_S = 0.3  # what takes longer is named
_BUSY = {
    "preparing": "loading the tables",
    "fitting": "fitting together",
    "comparing": "comparing",
    "aiming": "seeing how far the goal is",
    "adopting": "writing the model",
    "undoing": "undoing",
    "resetting": "clearing the fault",
    "explaining": "looking for what is missing",
}


class Board:
    """All that is known; `version` changes whenever anything does."""

    def __init__(self, port: str) -> None:
        self.port = port  # connected, or tried last
        self.hello: Hello | None = None  # of the connected probe
        self.instrument: InstrumentState | None = None
        self.doing: str | None = None  # connecting, arming, starting, resetting, searching, closing
        self.review: Review | None = None  # in view, and not confirmed yet
        self.asked: Order | None = None  # confirmed last, as the fields had it
        self.order: Order | None = None  # armed last
        self.who = ("", "")  # subject and site in the fields
        self.visit: tuple[str, str] | None = None  # subject and site of the open session
        self.playing: Playing | None = None
        self.series: Order | None = None  # confirmed, and not over
        self.left: Plan | None = None  # of it, where a lost link has cut it
        self.live: Live | None = None
        self.latest: Sample | None = None  # the final vent included
        self.latest_at: datetime | None = None
        self._sampled_s = -math.inf  # when it came, by the clock of `tick`
        self.begun_at: datetime | None = None  # the visit, in local time
        self.entries: dict[int, Entry] = {}
        self._simulated = False
        # Of each subject and site, in this program: a new session does not rest the skin
        self._doses: dict[tuple[tuple[str, str] | None, bool], DoseMeter] = {}
        self._loadings: dict[tuple[tuple[str, str], bool], int] = {}
        # Label of the placement that begins with the next curve: the probe was put on anew
        self._put_on: dict[tuple[str, str], str] = {}
        self.ledger = Ledger()
        self.joint: Identification | None = None  # of the curves that are used
        self.compared: list[str] = []  # with another session, in sentences
        self.missing: Missing | None = None  # what was looked for in the curves
        self._advised: set[tuple[float, Program]] = set()  # by it, and loaded
        self._recorded_advised: frozenset[str] = frozenset()  # curves, of a replay
        self.model: str | None = None  # that was adopted, by its name
        self.second_card = False  # the Cutometer's numbers in the place of the values
        self.reference: Reference | None = None  # to compare values with
        self.study: Path | None = None  # a folder: how much visits, operators, placements scatter
        self.protocol: NamedProtocol | None = None  # that the screen walks through
        self._stated: dict[str, dict[str, str]] = {}  # conditions, by subject
        self._operator: dict[str, str] = {}
        self._sites_done: set[tuple[str, str]] = set()  # subject and site, by the protocol
        self.goal: AnyGoal | None = None  # of the visit
        self.goal_is: AnyDistance | None = None  # how far it is
        self.shown: int | None = None  # which entry is looked at
        self.session = 0  # counts connections: entries of another one are gone
        self.path: Path | None = None  # of this connection's session, once there is one
        self.saved: Path | None = None  # session file written last
        self.damaged = 0  # frames of this connection that made no sense
        self.alarm: str | None = None
        self._off_mbar: float | None = None  # a vent seen since the alarm, and no suction after it
        self.note = ""
        self._asked = ""  # a note that waits for an answer
        self.level = Level.INFO
        self.told: deque[tuple[str, Level]] = deque(
            maxlen=_MOST_TOLD
        )  # all notes, to be read again
        self.aside = ""  # said for a moment in the place of the note, which comes back
        self._aside_s: float | None = None  # since when
        self._noted: tuple[str, Level, float] = ("", Level.INFO, 0.0)  # with since when
        self._busy: dict[str, float | None] = {}  # what computes beside, since when
        self._now_s = 0.0
        self.rest_until_s: float | None = None  # when the next repeat is due, by the same clock
        self._read_any = False  # of the present repeat
        self.version = 0

    # ---- what may be done ---------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """Armed, running or venting, or about to, or nobody knows: no text in fields, v vents."""
        doing = {"arming", "starting", "resting", "venting", SEARCHING}
        return self.doing in doing or self.instrument in _MOVING

    @property
    def can_arm(self) -> bool:
        """Whether something new may be asked for."""
        return (
            self.playing is None and self.doing is None and not self.moving and self.alarm is None
        )

    @property
    def can_start(self) -> bool:
        """Whether the instrument is armed and waits."""
        return self.doing is None and self.instrument is _S.ARMED and self.alarm is None

    @property
    def read_only(self) -> bool:
        """Whether the instrument is started, and vented, by somebody there."""
        return self.hello is not None and self.hello.read_only

    @property
    def out_of_reach(self) -> bool:
        """Whether nothing that is sent arrives: there is no probe, or the link to it is lost."""
        return self.hello is None or self.doing == SEARCHING

    @property
    def alarm_text(self) -> str | None:
        """The alarm, and whether the suction has been seen to end since then."""
        if self.alarm is None or self._off_mbar is None:
            return self.alarm
        return f"{self.alarm}. Seen since then: the suction is off ({self._off_mbar:.1f} mbar)"

    @property
    def phase(self) -> str:
        """One word for the header."""
        if self.playing is not None and self.doing != "closing":
            return "ENDED" if self.playing.ended else "PAUSED" if self.playing.paused else "REPLAY"
        if self.read_only and self.doing == "starting":
            return "WAITING"
        if self.doing is not None:
            return self.doing.upper()
        if self.hello is None:
            return "NO PROBE"
        if self.instrument in {None, _S.IDLE, _S.LOADED}:
            return "READY"
        return str(self.instrument).upper()

    @property
    def elsewhere(self) -> bool:
        """Whether the fields name another subject or site than the open visit has.

        Then nothing of that visit is shown on the main screen: it would stand under a wrong name.
        """
        return self.playing is None and self.visit is not None and self.who != self.visit

    @property
    def streaming(self) -> bool:
        """Whether readings come, so that the last one is what there is now."""
        if self.playing is not None:
            return self.live is not None and not self.playing.ended
        running = self.instrument in {_S.RUNNING, _S.VENTING}
        # Behind a valve that is stuck the pressure goes on to be read
        stuck = self.instrument is _S.FAULT and self._now_s - self._sampled_s < _STREAM_S
        return self.hello is not None and (running or stuck or self.read_only)

    @property
    def suction(self) -> bool:
        """Whether there is suction, or about to be, or nobody knows that it is gone."""
        if self.playing is not None:
            return False
        return (
            self.instrument in {_S.RUNNING, _S.VENTING}
            or (self.doing == "starting" and not self.read_only)
            or self._pulls_by_itself
            or self.doing == SEARCHING
            or self.alarm is not None
        )

    @property
    def _pulls_by_itself(self) -> bool:
        """Whether an instrument that is only read pulls, in a curve or not."""
        sample = self.latest
        return self.read_only and sample is not None and sample.pressure_mbar >= SUCTION_MBAR

    @property
    def simulated(self) -> bool:
        """Whether what is, or was last, connected is no real skin; a replay is none either."""
        return self.playing is not None or self._simulated

    @property
    def dose(self) -> Dose:
        """What the site has had of this program, in all its sessions."""
        meter = self._doses.get((self.visit, self.simulated))
        return Dose() if meter is None else meter.total

    @property
    def next_cycle(self) -> int:
        """Which loading of its site the next curve of whom the fields name will be."""
        return self._loadings.get((self.who, self.simulated), 0) + 1

    @property
    def put_on(self) -> str | None:
        """Label of the placement that begins with the next curve of whom the fields name."""
        return self._put_on.get(self.who)

    def put_on_anew(self, now: datetime) -> None:
        """Take the next curve of this site for one of another placement, or take that back."""
        curves = [] if self.elsewhere else [e.curve for e in self.entries.values()]
        if self._put_on.pop(self.who, None) is not None:
            self.answer(Level.INFO, "taken back: the probe was not put on anew")
        elif not curves:
            self.answer(Level.INFO, "the first curve of a visit begins a placement in any case")
        else:
            self._put_on[self.who] = _label(1 + len(set(placements_of(curves))), now)
            note = f"put on anew: the next curve is loading {self.next_cycle}, of another placement"
            self.answer(Level.INFO, f"{note}; F8 goes on, {PLACED_KEY} takes it back")

    def next_placement(self, setup: Setup, now: datetime) -> tuple[str | None, str]:
        """Return the label of the next curve's placement, and whether the probe sits as before.

        Without a label the cycles tell (`placements_of`), so there is none before it is needed: the
        operator has said something, or the site had loadings in another session.
        """
        if self.put_on is not None:
            return self.put_on, "probe put on anew"
        if self.elsewhere or not self.entries:
            return None if setup.cycle == 1 else _label(1, now), ""
        before = self.entries[max(self.entries)].setup
        if begins_placement(setup, before):
            return None, ""
        return before.placement, f"probe not lifted (else {PLACED_KEY})"

    def is_over(self, now: datetime) -> bool:
        """Whether the open visit was on another day, hours ago: the screen was left open."""
        ends = [e.at for e in self.entries.values() if e.at is not None]
        last = max(ends, default=self.begun_at)
        return last is not None and now.date() != last.date() and now - last >= _BREAK

    def begin_day(self) -> None:
        """Count loadings from 1: all sites have rested."""
        self._loadings.clear()
        self._doses.clear()
        self.say(Level.INFO, "another day: another session, and loadings count from 1")

    @property
    def busy(self) -> str:
        """What takes longer than one waits for unasked, in a few words; or nothing."""
        long = [
            what
            for what, since_s in self._busy.items()
            if since_s is not None and self._now_s - since_s > _BUSY_S
        ]
        return ", ".join(_BUSY[what] for what in long)

    @property
    def rest_left_s(self) -> int | None:
        """Whole seconds until the next repeat; None: none is waited for."""
        if self.rest_until_s is None or self.doing != _DOING[Phase.RESTING]:
            return None
        return max(0, math.ceil(self.rest_until_s - self._now_s))

    @property
    def entry(self) -> Entry | None:
        """The completed curve that is looked at."""
        return None if self.shown is None or self.elsewhere else self.entries.get(self.shown)

    @property
    def used(self) -> list[Curve]:
        """The curves that the operator did not leave out."""
        return [e.curve for i, e in self.entries.items() if i not in self.ledger.excluded]

    @property
    def stated(self) -> dict[str, str]:
        """The conditions that the operator stated for whom the fields name.

        What was stated before anybody was named is for whoever is measured next; the operator
        stays the same.
        """
        return self._operator | self._stated.get(self.who[0], self._stated.get("", {}))

    def state(self, name: str, text: str) -> None:
        """Take in a condition for whom the fields name."""
        self._stated[self.who[0]] = {**self.stated, name: text}
        if name == OPERATOR:
            self._operator = {name: text}
        self.version += 1

    @property
    def now_s(self) -> float:
        """The time by the clock of `tick`, s."""
        return self._now_s

    @property
    def done_curves(self) -> list[DoneCurve]:
        """The curves of whom the fields name, as a protocol looks at them."""
        from skinlab.report.protocol import Done as DoneCurve  # only where there is a protocol

        return [
            DoneCurve(
                entry.curve.name,
                entry.setup,
                entry.verdict,
                {} if entry.result is None else (entry.result.parameters or {}),
                self.ledger.excluded.get(index),
                entry.began_s,
                entry.ended_s,
            )
            for index, entry in self.entries.items()
            if entry.visit == self.who
        ]

    @property
    def walk(self) -> Progress | None:
        """How far the protocol is at this site; None: there is no protocol."""
        if self.protocol is None or self.playing is not None:
            return None
        from skinlab.report.protocol import progress

        return progress(self.protocol.protocol, self.done_curves)

    def site_done(self, site: str) -> bool:
        """Whether all steps of the protocol are done at this site of the present subject."""
        return (self.who[0], site) in self._sites_done

    def earlier(self, shown: Live | Entry) -> list[Entry]:
        """Return the last used curves before this one that were measured alike."""
        return [
            e
            for e in self.entries.values()
            if e.index < shown.index
            and e.index not in self.ledger.excluded
            and e.visit == (self.visit if isinstance(shown, Live) else shown.visit)
            and e.setup.aperture_mm == shown.setup.aperture_mm
            and e.setup.program == shown.setup.program
        ][-_MOST_EARLIER:]

    def ranges(self, entry: Entry) -> dict[str, Range]:
        """Return the usual range of each parameter that the reference has for such a curve."""
        if self.reference is None or entry.result is None or not entry.result.parameters:
            return {}
        from skinlab.studies.reference import place  # slow to import

        values = {name: value.value for name, value in entry.result.parameters.items()}
        try:
            placed = place(
                self.reference,
                values,
                site=(entry.visit or ("", ""))[1],
                aperture_mm=entry.setup.aperture_mm,
                program=str(entry.setup.program) if entry.setup.program else None,
            )
        except InputError:
            return {}  # it has nothing to compare this curve with
        return {one.quantity: one.range for one in placed}

    # ---- what the operator does ---------------------------------------------------------------

    def begin(self, doing: str, note: str) -> None:
        """Something was asked for; what was said before is answered with that."""
        self.doing = doing
        self.note, self.level = note, Level.INFO
        if doing == "arming":
            self.shown = None  # the plot is for the next curve
        self.version += 1

    def propose(self, review: Review) -> None:
        """Show what will happen, to be confirmed."""
        self.review = review
        what = "waits for you to start the instrument" if self.read_only else "starts suction"
        self.note, self.level = f"read it; F9 {what}, v or Esc leaves it", Level.INFO
        self._asked = self.note
        self.version += 1

    def withdraw(self) -> None:
        """Do not do what was shown."""
        if self.review is not None:
            self.review, self._asked = None, ""
            self.version += 1

    def name(self, who: tuple[str, str]) -> None:
        """Take in the subject and the site that the fields name now."""
        if who != self.who:
            self.who = who
            if who[0] and self.note == WHOSE:  # answered
                self.note, self.level = "", Level.INFO
            self.version += 1

    def touch(self) -> None:
        """Something was changed by hand: draw it."""
        self.version += 1

    def tick(self, now_s: float) -> None:
        """Let time pass, to `now_s` by a clock that never goes back: messages end, rests run."""
        drawn = (self.busy, self.rest_left_s, self.streaming)
        self._now_s = now_s
        self._busy = {what: now_s if s is None else s for what, s in self._busy.items()}
        note, level, since_s = self._noted
        if (note, level) != (self.note, self.level):
            self._noted = (self.note, self.level, now_s)
        elif note and now_s - since_s > _LASTS_S[level]:
            self.note, self.level = "", Level.INFO
            self.version += 1
        if self.aside and self._aside_s is None:
            self._aside_s = now_s
        elif self._aside_s is not None and now_s - self._aside_s > _ASIDE_S:
            self.aside, self._aside_s = "", None
            self.version += 1
        if drawn != (self.busy, self.rest_left_s, self.streaming):
            self.version += 1

    def compute(self, what: str) -> None:
        """Something began that may take long, and goes on beside."""
        if what in _BUSY:
            self._busy[what] = None

    def say(self, level: Level, note: str) -> None:
        """Say something, unless something worse is being said, or as much is being asked."""
        asked = self._asked != "" and self.note == self._asked
        if _RANK[level] > _RANK[self.level] or (level == self.level and not asked):
            self.answer(level, note)
        else:
            self.told.append((note, level))

    def remind(self, level: Level, note: str) -> None:
        """Say once more what was covered too soon, unless something worse is being said."""
        if _RANK[level] >= _RANK[self.level]:
            self.note, self.level, self.aside = note, level, ""
            self.version += 1

    def ask(self, text: str) -> None:
        """Say what is to be answered."""
        self.answer(Level.INFO, text)
        self._asked = text

    def tell(self, text: str) -> None:
        """Answer a key that does nothing, for a moment; what was said before comes back."""
        self.told.append((text, Level.INFO))
        self.aside, self._aside_s = text, None
        self.version += 1

    def refuse(self, note: str) -> None:
        """Say why what was asked for is not done."""
        self.answer(Level.ERROR, note)

    def answer(self, level: Level, note: str) -> None:
        """Say what a key came to, whatever was said before."""
        if note:
            self.told.append((note, level))
        self.note, self.level, self.aside = note, level, ""
        self.version += 1

    def show(self, index: int) -> None:
        """Look at a completed curve."""
        if self.live is None and index in self.entries and self.shown != index:
            self.shown = index
            self.version += 1

    def acknowledge(self) -> None:
        """Take the alarm away."""
        self.alarm = None
        self.version += 1

    # ---- news ---------------------------------------------------------------------------------

    def see(self, news: News | Aimed) -> None:
        """Take in what the probe session said."""
        self.version += 1
        self._take_in(news)
        if not self.can_arm:
            self.review = None  # what was shown is not what would happen now

    def _take_in(self, news: News | Aimed) -> None:
        match news:
            case Aimed(found):
                if found.goal == self.goal:
                    self.goal_is = found
                    self.told.append((found.words, Level.INFO))  # whole, where a line has no room
            case Connected(port, hello, goes_on):
                self._connected(port, hello, goes_on=goes_on)
                if news.probe is not None:
                    agrees, words = news.probe
                    self.say(Level.INFO if agrees else Level.WARNING, f"{words}; F8 goes on")
                if self.playing is not None:
                    self.visit, self._recorded_advised = news.visit, news.for_effect
            case Heard(messages, at):
                for message in messages:
                    self._hear(message, at)
            case Recording(path, before):
                self.path = path
                if before.suction_mbar_s > self.dose.suction_mbar_s:  # from before the start
                    self._doses[self.visit, self.simulated] = DoseMeter(before)
                if self.who[0]:  # what was stated for nobody yet was for this one
                    early = self._stated.pop("", {})
                    self._stated.setdefault(self.who[0], early)
            case Estimated(index, result):
                if self.live is not None and self.live.index == index:
                    self.live.estimate = result
            case Played(at_s, length_s, ended):
                if self.playing is not None:
                    self.playing.at_s, self.playing.length_s = at_s, length_s
                    self.playing.ended = ended
            case Fitted(result):
                self.joint = result
            case Compared(lines):
                self.compared = list(lines)
            case Explaining(stage):
                if self.missing is not None:
                    self.missing.stages.append(stage)
            case Explained(outcome):
                if self.missing is not None:
                    self.missing.outcome, self.missing.running = outcome, False
                    self.say(Level.INFO, f"the search is over: {outcome.verdict.name} (d shows it)")
            case Adopted(path, name, anew):
                self.model, self.review = name, None
                if self.missing is not None:
                    self.missing.adopted = path
                what = f"adopted: {path}" if path else f"undone: identified with {name or 'base'}"
                then = "; the next curve begins a new session" if anew else ""
                # More than a note: not to be covered by "saved"
                self.say(Level.WARNING, what + then)
            case Saved(path):
                self.saved = path
                self.say(Level.INFO, f"saved: {path}")
            case Went(phase, left, rest_s):
                self.rest_until_s = None if rest_s is None else self._now_s + rest_s
                self._went(phase, left)
            case Over(failed, given_up):
                self._over(failed, given_up)
            case Disconnected():
                self._done(SEARCHING)
                self.hello = self.instrument = self.live = self.series = self.left = None
            case Failed(doing, text):
                self._done(doing)
                self._busy.pop(doing, None)
                if doing == MEASURING:
                    self._done(_DOING[Phase.ARMING])
                    self.series = self.left = None
                if doing == EXPLAINING and self.missing is not None:
                    self.missing.running, self.missing.failed = False, text
                self.refuse(text)
            case Done(doing):
                self._done(doing)
                self._busy.pop(doing, None)
                if doing == EXPLAINING and self.missing is not None:
                    self.missing.running = False  # given up, where there is no answer

    def _went(self, phase: Phase, left: Plan | None) -> None:
        """Take in the phase of the measurement; what the operator has asked for beside stays."""
        searched = self.doing == SEARCHING
        if self.doing is None or self.doing in _DOING.values():
            self.doing = _DOING.get(phase)
        self.left = left if phase is Phase.INTERRUPTED else None
        if left is not None and self.order is not None:
            self.order = self.order.with_left(left)
        match phase:
            case Phase.ARMING:
                self.shown = None  # the plot is for the next curve
                self._read_any = False
            case Phase.STARTING if self.read_only:
                self.say(Level.INFO, "start the instrument; v gives the curve up")
            case Phase.RUNNING if self.level is Level.INFO:
                self.answer(Level.INFO, "")  # it spoke of the start
            case Phase.RESTING if left is not None and not self.read_only:
                self.say(Level.INFO, f"{left.repeats} more to come; v ends them")
            case Phase.SEARCHING:
                self.instrument = self.live = None
            case Phase.INTERRUPTED:
                # Plainly better news than what was said before
                again = "the link is back; F8 shows the repeat that was cut, F9 takes it again"
                self.answer(Level.WARNING, again)
            case Phase.READY if searched:
                again = "the link is back and the session goes on; F8 shows what comes next"
                self.answer(Level.WARNING, again)
            case _:
                pass

    def _over(self, failed: str | None, given_up: int) -> None:
        self.series = self.left = None
        if failed is None:
            return
        why = "vented" if failed.startswith("operator;") else failed  # by a key, or a click
        none = "" if self._read_any else f"{why}, before the first reading: nothing to keep"
        rest = "vented: the repeats that were left are given up" if given_up > 1 else ""
        if none or rest:
            self.say(Level.WARNING, "; ".join(filter(None, (none, rest))))

    def _connected(self, port: str, hello: Hello, *, goes_on: bool) -> None:
        self.port, self.hello, self._simulated = port, hello, hello.simulated
        self.live = self.latest = self.latest_at = None
        self.damaged = 0
        if not goes_on:
            self.visit = self.path = self.shown = self.begun_at = None
            self.entries.clear()
            self._put_on.clear()
            self.ledger, self.joint, self.compared = Ledger(), None, []
            self.missing = self.goal_is = None
            self._advised.clear()
            self.session += 1
        self._done("connecting")
        if goes_on:
            self.say(Level.INFO, "connected, the session goes on; F8 shows what comes next")
        elif self.playing is None:
            self.say(Level.INFO, "connected; F8 shows what will happen")
        else:
            self.say(Level.INFO, "a replay: Space pauses, . steps, + and - change the speed")

    def _done(self, doing: str) -> None:
        if self.doing == doing:
            self.doing = None

    def _hear(self, message: Message, at: datetime | None) -> None:
        match message:
            case CurveStarted(index, curve):
                self.live = Live(
                    index,
                    curve,
                    began_s=self._now_s,
                    for_effect=self._is_advised(index, curve.setup),
                )
                self.shown = None
                self.begun_at = self.begun_at or at
            case Sampled(index, sample):
                self.latest, self.latest_at, self._read_any = sample, at, True
                self._sampled_s = self._now_s
                self._see_suction(sample.pressure_mbar)
                self._load(index, sample)
                if self.live is not None and self.live.index == index:
                    self.live.last = sample
            case CurveCompleted(index, curve, cut, lost):
                live = self.live
                self.entries[index] = Entry(
                    index,
                    curve,
                    cut,
                    lost,
                    findings=[] if live is None else live.findings,
                    for_effect=self._is_advised(index, curve.setup),
                    visit=self.visit,
                    at=at,
                    began_s=None if live is None else live.began_s,
                    ended_s=self._now_s,
                )
                self.live, self.shown = None, index
                self._put_on = {
                    who: one for who, one in self._put_on.items() if one != curve.setup.placement
                }
                if cut is not None:
                    self.told.append((f"curve {index} was cut short: {cut}", Level.WARNING))
            case Identified(index, _, result):
                self.entries[index].result = result
                walk = self.walk
                if walk is not None and walk.next is None:
                    self._sites_done.add(self.who)
            case Flagged(index, finding):
                of = self.live if self.live and self.live.index == index else None
                whose = of or self.entries.get(index)
                if whose is not None:
                    if whose.for_effect and finding.gate == FEW:
                        return  # as advised
                    whose.findings.append(finding)
                # The line of the verdict says it, for as long as it holds
                note = f"curve {index}: {finding.sentence}; {finding.advice}"
                self.told.append((note, Level.WARNING))
            case Happened(Sample() as sample):
                self._see_suction(sample.pressure_mbar)
                if self.read_only:  # before its first curve: it streams whatever is done here
                    self.latest, self.latest_at = sample, at
                    if self.visit is not None:
                        self._load(0, sample)
            case Happened(event):
                self._happened(event)

    def advise(self, aperture_mm: float, program: str) -> None:
        """Remember what the search for what is missing advised, once it is loaded."""
        self._advised.add((aperture_mm, parse_program(program)))

    def _is_advised(self, index: int, setup: Setup) -> bool:
        if f"curve {index}" in self._recorded_advised:
            return True
        return (setup.aperture_mm, setup.program) in self._advised

    def _load(self, index: int, sample: Sample) -> None:
        """Count what the site has had."""
        key = (self.visit, self.simulated)
        self._doses.setdefault(key, DoseMeter()).add(sample)
        live = self.live
        loads = sample.pressure_mbar >= SUCTION_MBAR and live is not None and live.index == index
        if loads and live is not None and self.visit is not None:
            self._loadings[self.visit, self.simulated] = live.setup.cycle

    def _see_suction(self, pressure_mbar: float | None) -> None:
        if pressure_mbar is not None and pressure_mbar >= SUCTION_MBAR:
            self._off_mbar = None

    def _happened(self, event: Event) -> None:
        match event:
            case State(state):
                self.instrument = state
                self._see_suction(event.pressure_mbar)
                if self.live is not None and state is not _S.RUNNING:
                    self.live = None
                    self.say(Level.WARNING, "too few samples for a curve; they are recorded")
            case Alarm(text):
                self.alarm, self._off_mbar = text, None
            case VentConfirmed(pressure_mbar):
                self._off_mbar = pressure_mbar
            case HostVented():  # so there is suction again, or nobody knows
                self._off_mbar = None
            case Damaged():
                self.damaged += 1
            case LinkLost():
                self.live = self._off_mbar = None
            case _:
                pass
        note = event_note(event)
        if isinstance(event, HostVented) and self.read_only:
            note = "warning", "a vent was asked for, and may not work: watch the pressure"
        if note is not None:
            self.say(Level(note[0]), note[1])


def _label(number: int, now: datetime) -> str:
    """Return the label of a placement of a session: no other session of the day has it."""
    return f"{number} ({now:%H:%M:%S})"
