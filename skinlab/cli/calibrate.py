"""`skinlab calibrate`: the errors of a probe, found on phantoms, and whether they still hold."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinlab.cli.options import dialect_option, json_option
from skinlab.cli.output import echo, print_json
from skinlab.cli.paths import PATH

if TYPE_CHECKING:
    from drivers.events import Hello
    from drivers.probe import Probe
    from skinlab.curves.phantoms import Phantom
    from skinlab.curves.probe_file import ProbeFile
    from skinlab.recording.stream import Message

_UNITS = {
    "deflection_gain": "",
    "deflection_offset_um": " µm",
    "pressure_gain": "",
    "pressure_offset_mbar": " mbar",
    "lag_s": " s",
}


@click.command()
@click.option("--port", required=True, help="pyserial URL: /dev/ttyUSB0, COM3, socket://…, sim://")
@dialect_option()
@click.option(
    "--phantoms",
    "sheet",
    type=PATH,
    help="PHANTOMS.toml: what your phantoms are  [default: the simulated probe's kit].",
)
@click.option("--aperture-mm", type=float, help="Where the instrument does not say its opening.")
@click.option("--valid-days", type=float, help="How long it holds.  [default: 365]")
@click.option("--out", type=PATH, help="The probe file to write.")
@click.option(
    "--check",
    "checked",
    type=PATH,
    help="PROBE.toml: measure its check phantom, and say whether the probe still agrees.",
)
@json_option()
def command(
    port: str,
    dialect: str | None,
    sheet: Path | None,
    aperture_mm: float | None,
    valid_days: float | None,
    out: Path | None,
    checked: Path | None,
    as_json: bool,
) -> int:
    """Calibrate a probe on phantoms, or check it on one of them before a visit.

    Each phantom of --phantoms is measured in turn; you are asked to put the probe on it. A rigid
    plate and a rigid step give zero and gain of the deflection, silicone sheets those of the
    pressure, and the lag. The curves are kept as CSV in PROBE.curves beside --out.

    With --check: status 0 where the probe agrees, 1 where it differs. When it was checked is kept
    in PROBE.checks, and said by measure and ui, which otherwise ask for a check.

    \b
    Example: skinlab calibrate --port sim:// --out probe.toml
             skinlab calibrate --port /dev/ttyUSB0 --phantoms kit.toml --out probe.toml
             skinlab calibrate --port sim:// --check probe.toml
    """
    from functools import partial

    from drivers.probe import choose_dialect
    from skinlab.acquisition.session_run import probes

    if (out is None) == (checked is None):
        raise click.UsageError("give one of --out and --check")
    simulated = port.startswith("sim:")
    if sheet is None and not simulated and checked is None:
        raise click.UsageError("--phantoms is needed: only the simulated probe brings a kit")
    given = (sheet, aperture_mm, valid_days)
    if checked is not None and any(one is not None for one in given):
        raise click.UsageError(
            "--check has phantom, opening and days in the probe file; leave --phantoms, "
            "--aperture-mm and --valid-days out"
        )
    if not choose_dialect(port, dialect)[1].capabilities.controllable:
        raise click.UsageError("a calibration needs a probe that runs programs")
    make_probe = partial(probes(None, dialect))
    ask = (lambda phantom: None) if simulated else _ask
    if checked is not None:
        return _check(port, checked, ask, make_probe, as_json)
    assert out is not None
    valid_days = 365.0 if valid_days is None else valid_days
    return _calibrate(port, sheet, aperture_mm, valid_days, out, ask, make_probe, as_json)


def _ask(phantom: Phantom) -> None:
    """Have the probe put on a phantom.

    Raises:
        InputError: nobody is there to answer.
    """
    import sys

    from skinlab.cli.keys import drop_typed
    from skinlab.errors import InputError

    drop_typed()  # an Enter of before does not start suction on the phantom that is there now
    echo(f"put the probe on phantom {phantom.name} ({phantom.kind}), then press Enter", err=True)
    if not sys.stdin.readline():
        raise InputError("standard input ended: somebody has to put the probe on the phantoms")


def _tell(message: Message) -> None:
    """Say at once what whoever holds the probe must know."""
    from skinlab.recording.stream import Happened
    from skinlab.report.outage import outage_words

    if isinstance(message, Happened) and (words := outage_words(message.event)):
        echo(f"skinlab: {words}", err=True)


def _calibrate(
    port: str,
    sheet: Path | None,
    aperture_mm: float | None,
    valid_days: float,
    out: Path,
    ask: Callable[[Phantom], None],
    make_probe: Callable[..., Probe],
    as_json: bool,
) -> int:
    from datetime import UTC, datetime

    from skinlab.acquisition.calibrating import measure_phantom
    from skinlab.curves.apertures import check_aperture
    from skinlab.curves.phantoms import read_phantoms
    from skinlab.curves.probe_file import probe_text
    from skinlab.errors import InputError
    from skinlab.inference.calibration import Reading, calibrate
    from skinlab.io.files import write_file

    if aperture_mm is not None:
        check_aperture(aperture_mm)
    if not 0 < valid_days <= 3650:
        raise InputError(f"valid_days {valid_days:g}: expected more than 0, at most 3650")
    folder = _folder_beside(out)
    readings = []
    instruments = set()
    for phantom in read_phantoms(sheet):
        ask(phantom)
        hello, curve = measure_phantom(
            port, phantom, aperture_mm, make_probe, folder, listener=_tell
        )
        instruments.add((hello.serial_number, hello.model))
        if len(instruments) > 1:
            raise InputError("the instrument changed on the way: its serial number is another one")
        readings.append(Reading(phantom, curve))
        echo(f"skinlab: phantom {phantom.name}: {len(curve)} samples", err=True)
    ((serial_number, model),) = instruments
    found = calibrate(
        readings,
        serial_number=serial_number,
        model=model,
        now=datetime.now(UTC),
        valid_days=valid_days,
    )
    write_file(out, probe_text(found))
    if as_json:
        print_json(_document(found, out))
    else:
        _print(found, out)
    if found.misfit > 2.0 or found.phantoms_off:
        which = f" (far off: {', '.join(found.phantoms_off)})" if found.phantoms_off else ""
        echo(
            f"skinlab: the phantoms' sheets do not explain the readings{which}: a phantom is not "
            "what its sheet says, or was not lying well; the intervals are wider by that",
            err=True,
        )
    return 0


def _folder_beside(out: Path) -> Path:
    """Return where the curves of a probe file go, once both can be written.

    Raises:
        InputError: the name is no probe file's, one of them is there already, or cannot be written.
    """
    from skinlab.errors import InputError
    from skinlab.io.files import check_can_write

    if out.suffix != ".toml":  # .curves and .checks are what lies beside it
        raise InputError(f"{out}: expected a name that ends with .toml, as probe files have")
    folder = out.with_suffix(".curves")
    for path in (out, folder):
        if os.path.lexists(path):
            raise InputError(f"{path}: exists already; a calibration is never overwritten")
    check_can_write(out)
    return folder


def _print(found: ProbeFile, out: Path) -> None:
    """Print what the calibration found."""
    echo(f"probe {found.serial_number}, opening {found.aperture_mm:g} mm (90 % intervals):")
    for name, unit in _UNITS.items():
        one = getattr(found, name)
        open_ = "  not determined by these phantoms" if name in found.not_determined else ""
        echo(f"  {name} {one.value:.4g}{unit} ({one.low:.4g} to {one.high:.4g}){open_}")
    echo(f"valid until {found.valid_until_utc[:10]}; probe file: {out}")


def _document(found: ProbeFile, path: Path) -> dict[str, Any]:
    import msgspec

    values: dict[str, Any] = msgspec.to_builtins(found)
    shown = [n for n in values if n not in ("phantoms", "check", "covariance", "schema")]
    return {"schema": "skinlab.calibration/1", **{n: values[n] for n in shown}, "file": str(path)}


def _check(
    port: str,
    path: Path,
    ask: Callable[[Phantom], None],
    make_probe: Callable[..., Probe],
    as_json: bool,
) -> int:
    from datetime import UTC, datetime

    import msgspec

    from skinlab.acquisition.calibrating import measure_phantom
    from skinlab.curves.probe_file import read_probe
    from skinlab.errors import InputError
    from skinlab.inference.calibration import check_probe

    known = read_probe(path)
    stored = known.file.check
    if stored is None:
        raise InputError(f"{path}: has no check curve; calibrate with a silicone phantom")
    known.check_use(None, datetime.now(UTC))
    ask(stored.phantom)

    def check(hello: Hello) -> None:
        known.check_instrument(hello.serial_number, hello.aperture_mm, datetime.now(UTC))

    aperture_mm = known.file.aperture_mm
    hello, curve = measure_phantom(
        port, stored.phantom, aperture_mm, make_probe, check=check, listener=_tell
    )
    found = check_probe(known.file, curve)
    if as_json:
        values = msgspec.to_builtins({"offset_um": found.offset_um, "gain_ratio": found.gain_ratio})
        print_json(
            {
                "schema": "skinlab.probe_check/1",
                "agrees": found.agrees,
                "serial_number": hello.serial_number,
                "phantom": stored.phantom.name,
                **values,
                "statistic": found.statistic,
                "limit": found.limit,
            }
        )
    else:
        gain, offset = found.gain_ratio, found.offset_um
        said = "agrees with its calibration" if found.agrees else "DIFFERS from its calibration"
        echo(f"probe {hello.serial_number} {said} on phantom {stored.phantom.name}:")
        echo(f"  reads {gain.value:.4f} ({gain.low:.4f} to {gain.high:.4f}) times as much as then")
        echo(f"  zero has moved by {offset.value:.1f} µm ({offset.low:.1f} to {offset.high:.1f})")
        if not found.agrees:
            echo("  calibrate again, or look at the phantom; one phantom cannot show which it is")
    known.keep_check(datetime.now(UTC), agrees=found.agrees)  # last: its file may not be writable
    return 0 if found.agrees else 1
