"""The terminal, on Linux and macOS; bytes that are no text do not end the program."""

from __future__ import annotations

from textual.drivers.linux_driver import LinuxDriver

from skinlab.tui.part import PartedApp


class TolerantDriver(LinuxDriver):
    """Leaves out what is no UTF-8: a terminal set otherwise, or a disturbed line, sends such bytes.

    Textual's own ends the program with a traceback. All that came in one read is lost with them.
    """

    def run_input_thread(self) -> None:
        """Wait for input and dispatch events, until the app ends."""
        while not self.exit_event.is_set():
            try:
                super().run_input_thread()
            except UnicodeDecodeError:
                assert isinstance(self._app, PartedApp)
                self._app.call_later(self._app.board.tell, _SAID)


_SAID = "what came from the terminal is no text (UTF-8): it is left out"
