"""Screens with fixed data on them, without a probe: for pictures and colours."""

from __future__ import annotations

import shutil
import time
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from textual.widgets import Input, OptionList

from drivers.events import Hello, InstrumentState, Sample, State
from skinlab.acquisition.messages import Connected, Heard
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.growing import GrowingCurve
from skinlab.curves.program import parse_program
from skinlab.discrepancy.adequacy import Residual
from skinlab.discrepancy.discipline import Shares
from skinlab.discrepancy.heldout import HeldOut
from skinlab.discrepancy.verdict import Verdict
from skinlab.inference.result import Identification, Value
from skinlab.quality.gates.base import Finding
from skinlab.recording.session import example_session
from skinlab.recording.stream import CurveStarted, Happened, Sampled
from skinlab.tui.screens.missing import MissingScreen
from skinlab.tui.screens.session import SessionScreen
from skinlab.tui.screens.visits import VisitsScreen
from skinlab.tui.ui_state import Entry, Missing

HELLO = Hello("reference", 1, "probe", "1.0", "7", 6.0, 500.0, 60.0, 1.0, 1000.0, simulated=True)
SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))
AT = datetime(2026, 1, 2, 10, 15)


class NoProbe:
    """In the place of a probe session: nothing connects, nothing happens."""

    vents = 0
    recorded_with = None

    def __init__(self, folder, post):
        self.analysis = SimpleNamespace(prepare=lambda: None)

    def serve(self, port, *, anew=False):
        pass

    def vent(self, reason):
        self.vents += 1

    def close(self):
        pass


def curve_of(number):
    t = np.arange(101) * 0.05
    mbar = 20.0 * t
    w = 0.09 * np.sqrt(mbar) - 0.001 * number * t
    noise = 0.003 * np.sin(7.0 * t * (1 + number)) * np.cos(3.0 * t)
    return Curve(f"curve {number}", SETUP, t, mbar, w + noise), w


def entry_of(number, *flags, findings=()):
    curve, model_mm = curve_of(number)
    result = Identification(
        curve.name,
        SETUP,
        None,
        points=101,
        fitted_points=101,
        parameters={
            "X1_MPa": Value(0.0246, 0.0221, 0.0266),
            "X2_MPa": Value(2.84, 2.06, 3.36),
            "nu": Value(0.297, 0.2, 0.378),
        },
        derived={"nu_consistent": 0.334, "kappa_MPa": 0.135},
        error_um=0.31,
        rms_um=2.1,
        noise_um=2.0,
        flags=("not_identifiable:nu", *flags),
        model_mm=model_mm,
    )
    return Entry(number, curve, None, 0, result, list(findings), ("P07", "forearm, volar"), AT)


async def measured(pilot, *entries):
    """A visit with these curves; the last one is shown."""
    app, end = pilot.app, time.monotonic() + 60
    # The app says that it connects once it is ready: on Python 3.14 after its fields are there.
    while not app.screen_stack[0].query("#rest_s") or app.board.doing or not app.board.note:
        assert time.monotonic() < end
        await pilot.pause(0.02)
    board = app.board
    board.see(Connected("sim://", HELLO))
    board.visit = board.who = ("P07", "forearm, volar")
    board.begun_at = AT
    board.entries = {entry.index: entry for entry in entries}
    board.shown = entries[-1].index if entries else None
    fields = app.screen_stack[0].query_one("#fields")
    fields.put("subject", "P07")
    fields.put("site", "forearm, volar")


def outcome():
    """An answer of the search, as if a lag had been found in two curves."""
    curves = [curve_of(1), curve_of(2)]
    geometry = SimpleNamespace(aperture_mm=6.0, thickness_mm=1.0)
    records = [
        SimpleNamespace(
            name=c.name, curve=c, at_pressure_mm=c.deflection_mm, geometry=geometry, noise_um=2.0
        )
        for c, _ in curves
    ]
    after = SimpleNamespace(deflections_mm=[w for _, w in curves])
    before = SimpleNamespace(deflections_mm=[w + 0.02 * (c.time_s / 5 - 0.5) for c, w in curves])
    base = SimpleNamespace(effects=(), fit=before, at_bound=())
    best, second = (
        SimpleNamespace(
            effects=(name,),
            fit=after,
            left=Residual(0.4, (), 0.4),
            log10_evidence=e,
            adequate=ok,
            at_bound=(),
        )
        for name, e, ok in (("pressure_lag", 21.0, True), ("baseline_drift", 19.7, False))
    )
    law = {"X1_MPa": {"value": 0.02, "low": 0.019, "high": 0.021}}
    after_values = {
        "X1_MPa": {"value": 0.026, "low": 0.024, "high": 0.029},
        "pressure_lag.lag_s": {"value": 0.0231, "low": 0.0174, "high": 0.0281},
    }
    return SimpleNamespace(
        verdict=Verdict("named", [best]),
        learned=None,
        learned_from_these=(),
        unlike_model=(),
        kinds=(),
        found=SimpleNamespace(
            base=base, candidates=[best, second], records=records, implausible="", left_out={}
        ),
        repeats_um=2.2,
        shares=Shares(2.0, 0.4, 0.1, 5.8),
        placement=SimpleNamespace(),  # what it is nobody asks
        error_model=None,
        trials=(),
        doubted=None,
        not_ruled_out=[],
        best=best,
        gap_before=HeldOut(6.2, 2.0, 2.0, ("curve 2",), 6.2),
        gap_after=HeldOut(2.1, 2.0, 2.0, ("curve 2",), 2.1),
        next_measurement=None,
        parameters=lambda candidate: law if candidate is base else after_values,
        where=[],
        detectable={"pressure_lag.lag_s": 0.004},
        cannot_show={},
        not_screened={},
        alike=[],
    )


async def settled(pilot):
    app = pilot.app
    for _ in range(3):
        app.screen_stack[0].redraw()
        await pilot.pause(0.15)


async def ready(pilot):
    await measured(pilot)
    await settled(pilot)


async def good(pilot):
    await measured(pilot, entry_of(1), entry_of(2))
    await settled(pilot)


async def repeat(pilot):
    what = "at 3.1 s the pressure is 48 mbar where 61 mbar was asked for"
    leak = Finding("leak", what, "press the probe evenly onto the skin, look at tape and tube")
    await measured(pilot, entry_of(1), entry_of(2, findings=[leak]))
    await settled(pilot)


async def second_card(pilot):
    await measured(pilot, entry_of(1))
    pilot.app.board.second_card = True
    await settled(pilot)


async def running(pilot):
    await measured(pilot, entry_of(1))
    board, growing = pilot.app.board, GrowingCurve(SETUP)
    board.see(
        Heard((CurveStarted(2, growing), Happened(State(InstrumentState.RUNNING, "")))),
    )
    curve, _ = curve_of(2)
    for k in range(60):
        at = (curve.time_s, curve.pressure_mbar, curve.deflection_mm)
        sample = Sample(k, *(float(values[k]) for values in at), 0)
        growing.append(sample)
        board.see(Heard((Sampled(2, sample),), AT))
    await settled(pilot)


async def session(pilot):
    await measured(pilot, entry_of(1), entry_of(2))
    pilot.app.push_screen(SessionScreen(pilot.app.board))
    await settled(pilot)


async def visit_list(pilot):
    await measured(pilot)
    Path("sessions").mkdir()
    shutil.copy(example_session(), "sessions/monday.h5")
    pilot.app.push_screen(VisitsScreen(pilot.app.board, Path("sessions"), lambda: None))
    end = time.monotonic() + 60
    while not any(table.row_count for table in pilot.app.screen.query("#visits")):
        assert time.monotonic() < end
        await pilot.pause(0.05)
    await settled(pilot)


async def missing(pilot):
    await measured(pilot, entry_of(1), entry_of(2))
    found = Missing(("curve 1", "curve 2"), running=False, outcome=outcome())
    pilot.app.board.missing = found
    pilot.app.push_screen(MissingScreen(pilot.app.board))
    await settled(pilot)


def by_key(*keys):
    async def press(pilot):
        await measured(pilot, entry_of(1))
        await settled(pilot)
        await pilot.press(*keys)
        await settled(pilot)

    return press


async def palette(pilot):
    await measured(pilot, entry_of(1))
    await pilot.press("ctrl+p")
    end = time.monotonic() + 60
    while not any(found.option_count for found in pilot.app.screen.query(OptionList)):
        assert time.monotonic() < end
        await pilot.pause(0.05)
    pilot.app.screen.query_one(Input).cursor_blink = False
    await settled(pilot)


SCREENS = {
    "ready": ready,
    "good": good,
    "repeat": repeat,
    "second_card": second_card,
    "running": running,
    "session": session,
    "visits": visit_list,
    "missing": missing,
    "help": by_key("f1"),
    "palette": palette,
    "programs": by_key("f4"),
    "quit": by_key("q"),
}
