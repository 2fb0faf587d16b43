"""Text from outside, in every field that takes it, through all that shows or writes it."""

from __future__ import annotations

import dataclasses
import shutil
import unicodedata
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from sim_device import __main__ as sim_device
from skinlab.cli.main import run
from skinlab.recording.audit import Chain, note
from skinlab.recording.session import read_session, write_session

EVIL = "e\x1b]0;evil\x07\x9b2J\u202e\u200b[red]x[/"
EVIL_FILE = EVIL.replace("/", "") + "\n\udc9f"
UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def assert_inert(text: str, where: object = "") -> None:
    found = {hex(ord(c)) for c in text if unicodedata.category(c) in UNSEEN}
    assert found <= {"0xa"}, where


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A measured session whose instrument, operator and names are hostile."""
    path = tmp_path_factory.mktemp("hostile") / "s.h5"
    _session(path)
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch, hostile):
    """A folder of a hostile name, which holds what a stranger may send."""
    inside = tmp_path / EVIL_FILE
    inside.mkdir()
    monkeypatch.chdir(inside)
    time_s = np.linspace(0.0, 5.0, 51)
    rows = [f"{t:.2f},{20 * t:.2f},{0.02 * t:.5f}" for t in time_s]
    plain = "time_s,pressure_mbar,deflection_mm\n" + "\n".join(rows) + "\n"
    Path(f"{EVIL_FILE}.csv").write_text(plain)
    header = f"time_s,pressure_mbar,deflection_mm,{EVIL.replace(chr(10), '')}\n"
    Path("header.csv").write_text(header + "\n".join(f"{row},x{EVIL}" for row in rows) + "\n")
    Path("bad.csv").write_text(plain.replace("\n0.10,", f"\n{EVIL},"))
    escaped = EVIL.encode("unicode_escape").decode().replace("\\x", "\\u00")
    Path("model.toml").write_text(
        f'[model]\nname = "{escaped}"\n[effects.deflection_gain.gain]\nvalue = 1.1\n'
    )
    Path("bad.toml").write_text(f'[model]\nname = "x"\n"{escaped}" = 1\n')
    Path("campaign.toml").write_text(
        f'[campaign]\ntitle = "{escaped}"\n[[curve]]\nfile = "header.csv"\n'
        'aperture_mm = 6\nthickness_mm = 1\nprogram = "ramp:100@20"\n'
    )
    Path("outside.toml").write_text(
        f'[campaign]\n[[curve]]\nfile = "../{escaped}"\naperture_mm = 6\nthickness_mm = 1\n'
    )
    Path("skin.toml").write_text(f'[skin]\n"{escaped}" = 1\n')
    Path("protocol.toml").write_text(
        f'[study]\ntitle = "{escaped}"\nsites = ["{escaped}"]\n[[step]]\nname = "{escaped}"\n'
        'aperture_mm = 6.0\nprogram = "ramp:100@20"\n'
    )
    Path("reference.toml").write_text(
        f'schema = "skinlab.reference/1"\ntitle = "{escaped}"\nsource = "{escaped}"\n'
        f'licence = "{escaped}"\n[[range]]\nquantity = "X1_MPa"\nsite = "{escaped}"\n'
        'aperture_mm = 6.0\nprogram = "ramp:100@20"\nn = 75\n'
        "[range.percentiles]\n5 = 0.02\n50 = 0.03\n95 = 0.05\n"
    )
    _study(Path("people"), plain)
    shutil.copy(hostile, "s.h5")
    return inside


def _study(at: Path, curve: str) -> None:
    """Curves under a hostile name, and a table that says hostile things of them."""
    at.mkdir()
    lines = ["file,subject,site,operator,probe,visit,aperture_mm,thickness_mm,program,note"]
    for k in range(4):
        name = f"{EVIL_FILE[:-2]}{k}.csv"
        (at / name).write_text(curve)
        quoted = '"' + f"{EVIL}".replace('"', '""') + '"'
        lines.append(f'"{name}",P-{k % 2},{quoted},{quoted},{quoted},{k},6,1,ramp:100@20,"={EVIL}"')
    (at / "curves.csv").write_text("\n".join(lines) + "\n")
    (at / f"{EVIL_FILE}.csv").write_text(f"{EVIL}\n")
    (at / "subjects.csv").write_text(f'subject,group\nP-0,"{EVIL}"\nP-1,"={EVIL}"\n')


def _session(path: Path) -> None:
    """Write a measured session whose instrument, operator and names are hostile."""
    session = read_session(Path(str(files("skinlab") / "data" / "example.h5")))
    deed = note(0.0, 1e9, EVIL, EVIL, {EVIL: EVIL})
    records = (*session.records, Chain(session.records).add(deed))
    instrument = {"model": EVIL, "firmware": EVIL, "serial": EVIL, "simulated": True}
    meta = session.meta | {"site": "=" + EVIL, "url": EVIL, "instrument": instrument}
    curves = tuple(dataclasses.replace(c, name="=" + EVIL) for c in session.curves)
    results = tuple(
        None if r is None else r | {"file": EVIL, "flags": [*r["flags"], EVIL], "error": EVIL}
        for r in session.results
    )
    write_session(path, dataclasses.replace(
        session, meta=meta, records=records, curves=curves, results=results
    ))  # fmt: skip


GEOMETRY = ["--aperture-mm", "6", "--thickness-mm", "1"]
RAMP = ["--program", "ramp:100@20"]
CSV = f"{EVIL_FILE}.csv"
HTML = ["export", "s.h5", "--to", "html", "html", "--reference", "reference.toml"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["session", "info", "s.h5"],
        ["session", "verify", "s.h5"],
        ["session", "info", EVIL_FILE],
        ["replay", "s.h5", "--speed", "max", "--verify"],
        ["replay", "s.h5", "--speed", "max", "--json"],
        ["compare", "s.h5", "s.h5"],
        ["identify", CSV, "header.csv", "bad.csv", *GEOMETRY],
        ["identify", CSV, *GEOMETRY, "--json"],
        ["identify", "s.h5", "campaign.toml", EVIL_FILE],
        ["identify", "outside.toml"],
        ["identify", CSV, *GEOMETRY, "--model", "bad.toml"],
        ["identify", "campaign.toml", "--model", "model.toml", "--json"],
        ["identify", f"--{EVIL}"],
        ["identify", CSV, *GEOMETRY, "--method", EVIL],
        [EVIL],
        ["cutometer", CSV, "bad.csv", "--program", "mode1:100,2,2"],
        ["discrepancy", "outside.toml"],
        ["discrepancy", "campaign.toml", "--model", "bad.toml"],
        ["import", "header.csv", CSV, "bad.csv", *GEOMETRY, "--site", EVIL, "--out", "n\udc9f.h5"],
        ["import", CSV, *GEOMETRY, "--program", EVIL, "--out", "x.h5"],
        ["watch", EVIL_FILE, *GEOMETRY],
        ["recover", EVIL_FILE],
        ["recover", CSV],
        ["export", "s.h5", "--to", "csv", "csv"],
        ["export", "s.h5", "--to", "json", "json"],
        pytest.param(["export", "s.h5", "--to", "svg", EVIL_FILE], marks=pytest.mark.long),
        ["export", "s.h5", "--to", "fhir", "fhir"],
        ["export", "s.h5", "--to", "parameters", "parameters"],
        pytest.param(HTML, marks=pytest.mark.long),  # with its pictures
        ["export", "s.h5", "--to", "html", "html", "--reference", EVIL_FILE],
        ["study", "people", "--out", "study", "--workers", "1"],
        ["study", "people", "--out", EVIL_FILE + "s", "--workers", "1", "--json"],
        ["study", EVIL, "--out", "study"],
        ["study", "people", "--out", "study", "--layout", "{" + EVIL + "}"],
        ["identify", CSV, *GEOMETRY, "--prior", "bad.toml"],
        ["identify", CSV, *GEOMETRY, "--probe", "bad.toml"],
        ["calibrate", "--port", "sim://", "--phantoms", "bad.toml", "--out", "p.toml"],
        ["calibrate", "--port", EVIL, "--out", f"{EVIL_FILE}.toml"],
        ["measure", "--port", "sim://?speed=50", "--protocol", "protocol.toml",
         "--thickness-mm", "1", "--condition", EVIL, "--out", "m.h5"],
        ["measure", "--port", "sim://?speed=50", "--protocol", "protocol.toml",
         "--thickness-mm", "1", "--out", "m.h5"],
        ["measure", "--port", "sim://", "--protocol", "bad.toml", *GEOMETRY, "--out", "m.h5"],
        ["forward", "--x1-mpa", "0.02", "--x2-mpa", "1", "--nu", "0.3", *GEOMETRY,
         *RAMP, "--model", "model.toml", "--csv", f"{EVIL_FILE}.out"],
        ["forward", "--x1-mpa", "0.02", "--x2-mpa", "1", "--nu", "0.3", *GEOMETRY,
         "--program", EVIL],
        ["measure", "--port", EVIL, *GEOMETRY, *RAMP, "--out", f"{EVIL_FILE}.h5"],
        ["measure", "--port", "sim://?skin=skin.toml", *GEOMETRY, *RAMP, "--out", "m.h5"],
        ["measure", "--port", "sim://?skin=a%00b", *GEOMETRY, *RAMP, "--out", "m.h5"],
        ["database", "info", EVIL_FILE],
        ["database", "build", "--spec", "bad.toml"],
        ["capture", "--port", EVIL, "--out", f"{EVIL_FILE}.jsonl"],
        ["capture", "--port", "loop://", "--out", CSV],
        ["paper", "--out", CSV],
    ],
)  # fmt: skip
def test_no_command_prints_or_writes_what_acts(folder, capfd, arguments):
    before = set(folder.rglob("*"))
    status = run(arguments)
    assert status in {0, 1, 2, 3, 4, 5}
    shown = capfd.readouterr()
    assert_inert(shown.out)
    assert_inert(shown.err)
    for path in set(folder.rglob("*")) - before:
        if path.suffix in {".csv", ".json", ".html", ".toml", ".svg", ".out"} and path.is_file():
            assert_inert(path.read_text(encoding="utf-8"), path)


@pytest.mark.usefixtures("empty_pictures")
def test_a_page_holds_nothing_that_acts(folder, capfd):
    test_no_command_prints_or_writes_what_acts(folder, capfd, HTML)
    assert list(Path("html").glob("*.html"))


def test_the_simulated_probe_says_it_as_symbols(folder, capfd):
    with pytest.raises(SystemExit):
        sim_device.main(["--pty", "--skin", "skin.toml"])
    shown = capfd.readouterr()
    assert "␛" in shown.err
    assert_inert(shown.err)


def test_cells_of_an_export_are_no_formulas(folder):
    assert run(["export", "s.h5", "--to", "csv", "csv"]) == 0
    assert "'=e␛" in Path("csv/curves.csv").read_text(encoding="utf-8")
    title = Path("csv/campaign.toml").read_text(encoding="utf-8")
    assert "␛" in title


@pytest.mark.usefixtures("empty_pictures")
def test_a_pdf_shows_text_and_nothing_in_it_acts(folder):
    pytest.importorskip("weasyprint")
    import pypdf

    assert run(["export", "s.h5", "--to", "pdf", "pdf"]) == 0
    (path,) = Path("pdf").iterdir()
    for way in (b"/JavaScript", b"/URI", b"/Launch", b"/OpenAction", b"/EmbeddedFile"):
        assert way not in path.read_bytes()
    text = "".join(page.extract_text() for page in pypdf.PdfReader(path).pages)
    assert "\\u202e" in text.replace("\0", "")  # pypdf reads UTF-16 by bytes


def test_commands_print_through_one_place():
    folder = Path(str(files("skinlab"))) / "cli"
    for path in folder.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        if path.name != "output.py":
            assert "click.echo" not in text, path
            assert "stdout.write(" not in text, path


def test_files_are_written_through_one_place():
    """Only `io` opens files for writing; SQLite and the dialect-free capture make their own."""
    folder = Path(str(files("skinlab")))
    for path in folder.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if path.parent.name == "io" or path.name == "start.py":
            continue
        for way in (
            ".write_text(",
            ".write_bytes(",
            '.open("w',
            '.open("a',
            '.open("x',
            "os.replace(",
        ):
            assert way not in text, (path, way)
