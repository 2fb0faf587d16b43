"""What the keys, and the time line, of a replay do."""

from __future__ import annotations

from skinlab.acquisition.replayer import Replayer, next_speed
from skinlab.tui.part import Part, PartedApp
from skinlab.tui.screens.line import LineScreen, seconds
from skinlab.tui.shown import Playing
from skinlab.tui.starting import Starting
from skinlab.tui.ui_state import Level


class ReplayKeys(Part):
    """Pace, pause, and jumps in both directions; with a probe nothing here means anything."""

    def __init__(self, app: PartedApp, starting: Starting) -> None:
        super().__init__(app)
        self._starting = starting
        self._back_to_s: float | None = None  # from the beginning, once the present replay is over

    @property
    def _parts(self) -> tuple[Replayer, Playing] | None:
        replayer, playing = self.bench, self.board.playing
        return (replayer, playing) if isinstance(replayer, Replayer) and playing else None

    def press(self, what: str) -> None:
        """Do what a key says: play, step, event, faster or slower."""
        if self._parts is None:
            return
        replayer, playing = self._parts
        control = replayer.control
        if playing.ended:
            if what == "play" and self.board.doing is None:
                self._again(replayer)
            return
        match what:
            case "play":
                (control.resume if control.paused else control.pause)()
            case "step":
                control.step()
            case "event":
                control.to_next_event()
            case _:
                control.set_speed(next_speed(control.speed, faster=what == "faster"))
        playing.paused, playing.speed = control.paused, control.speed
        self.board.touch()

    def ask_time(self) -> None:
        """Ask to which time of the record to go."""
        if self._parts is None:
            return
        _, playing = self._parts

        def answered(text: str | None) -> None:
            if text is None:
                return
            at_s = seconds(text)
            if at_s is None or not at_s <= playing.length_s:
                ends = f"0 to {playing.length_s:.1f} s, or minutes as 1:30"
                self.board.answer(Level.ERROR, f"time {text!r}: expected {ends}")
                return
            self.jump(at_s)

        now = f"now {playing.at_s:.1f} of {playing.length_s:.1f} s"
        question = f"Go to which time? ({now})"
        self.app.push_screen(LineScreen(self.board, question), answered)

    def point(self, share: float) -> None:
        """Go to a share of the record."""
        if self._parts is not None:
            self.jump(share * self._parts[1].length_s)

    def jump(self, at_s: float) -> None:
        """Go to a time of the record without waiting; back means from the beginning to there."""
        if self._parts is None or self.board.doing is not None:
            return
        replayer, playing = self._parts
        if playing.ended:
            self._again(replayer, at_s)
        elif at_s > playing.at_s:
            replayer.control.jump(at_s - playing.at_s)
        else:
            self._back_to_s = at_s
            replayer.control.stop()
        self.board.answer(Level.INFO, f"to {at_s:.1f} s")

    def over(self) -> None:
        """Take in that what was played is over: it may have been stopped to go back."""
        back_to_s, self._back_to_s = self._back_to_s, None
        if back_to_s is not None and self._parts is not None:
            self._again(self._parts[0], back_to_s)

    def _again(self, replayer: Replayer, ahead_s: float | None = None) -> None:
        replayer.again(ahead_s)
        control = replayer.control
        self.board.playing = Playing(speed=control.speed, paused=control.paused)
        self._starting.connect(self.board.port)
