"""Measure phantoms: the same rules as for skin, without identification."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from drivers.events import Hello
from drivers.probe import Probe
from skinlab.acquisition.measure import measure
from skinlab.acquisition.measurement_messages import Plan
from skinlab.acquisition.measurement_request import with_query
from skinlab.acquisition.pipeline import Listener, Pipeline
from skinlab.acquisition.sources import LiveSource
from skinlab.curves.csv import write_curve
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.phantoms import Phantom
from skinlab.errors import AcquisitionError, InputError
from skinlab.io.files import whole_text
from skinlab.recording.stream import CurveCompleted, Message

RATE_HZ = 100.0  # for the lag; the instrument's highest, where that is less


def measure_phantom(
    port: str,
    phantom: Phantom,
    aperture_mm: float | None,
    make_probe: Callable[..., Probe] = Probe,
    folder: Path | None = None,
    check: Callable[[Hello], None] = lambda _: None,
    listener: Listener = lambda _: None,
) -> tuple[Hello, Curve]:
    """Return what the instrument is, and its curve on a phantom; a CSV of it goes to `folder`.

    aperture_mm: None: as the instrument says. The simulated probe is put on the phantom by its
    port. `check` may refuse the instrument before any suction; `listener` hears what happens.

    Raises:
        AcquisitionError, DriverError: the probe or its link failed, or the driver had to vent.
        InputError: `check` says so; the phantom's program, or the opening, does not fit.
        KeyboardInterrupt: a signal came; the probe was told to vent at once.
    """
    curves: list[Curve] = []

    def keep(message: Message) -> None:
        if isinstance(message, CurveCompleted):
            curves.append(message.curve)

    if port.startswith("sim:"):
        port = with_query(port, phantom=phantom.name)
    try:
        with make_probe(port) as probe:
            hello = probe.open()
            check(hello)
            if probe.read_only:
                raise AcquisitionError("a calibration needs a probe that runs programs")
            opening_mm = hello.aperture_mm if aperture_mm is None else aperture_mm
            if opening_mm is None:
                raise InputError("the instrument does not say its opening; expected --aperture-mm")
            thickness_mm = phantom.thickness_mm if phantom.kind == "silicone" else 1.0
            setup = Setup(opening_mm, thickness_mm, phantom.asked)
            rate_hz = min(RATE_HZ, hello.max_rate_hz)
            measure(
                LiveSource(probe), Plan(setup, rate_hz=rate_hz), Pipeline(None, [keep, listener])
            )
    finally:
        if folder is not None:
            for cut, curve in enumerate(reversed(curves)):  # all but the last: by a lost link
                name = f"{phantom.name}-cut-{cut}.csv" if cut else f"{phantom.name}.csv"
                with whole_text(folder / name) as stream:
                    write_curve(stream, curve)
    if not curves or curves[-1].partial:
        raise AcquisitionError(f"phantom {phantom.name}: the curve was cut short")
    return hello, curves[-1]
