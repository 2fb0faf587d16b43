"""A session's report: page, pictures, and the command that writes them."""

from __future__ import annotations

import base64
import io
import json
import re
import socket
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from empty_pictures import leave_pictures_empty
from PIL import Image
from pypdf import PdfReader

from skinlab.cli.main import run
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.inference.uncertainty import Sensor
from skinlab.mechanics.fem.suction import Geometry
from skinlab.recording.advised import ADVISED, MISSING_EFFECT
from skinlab.recording.audit import note
from skinlab.recording.recorder import identification_settings
from skinlab.recording.session import Session, content_hash, read_session, write_session
from skinlab.report.curve_section import curve_section
from skinlab.report.drawings import curve_drawings
from skinlab.report.flags import explanations
from skinlab.report.measured import measured_curves
from skinlab.report.page import Section, Table
from skinlab.report.page_one import verdict_of
from skinlab.report.pdf import check_pdf, to_pdf
from skinlab.report.pictures import style
from skinlab.report.plots import autocorrelation, left_out, quantiles
from skinlab.report.session_report import FORMATS, SessionReport
from skinlab.report.verdict import FOR_EFFECT, Use
from skinlab.versions import versions

HOSTILE = "<img src=x onerror=alert(1)> \"&'; $\\frac$ \x1b[2J"
SKIN = np.array([[0.025, 2.95, 0.28]])
NOISE_UM, PRESSURE_NOISE_MBAR = 3.0, 0.2


def curve_of(table, name: str, seed: int, **setup) -> Curve:
    """Return a loading and unloading of a known skin, with known noise."""
    rng = np.random.default_rng(seed)
    program = parse_program("ramp:100@20,ramp:0@20")
    time_s = np.arange(200) / 20.0
    pressure = np.interp(time_s, [0, 5, 10], [0, 100, 0])
    model = table.model(Geometry(6.0, 1.0), np.maximum(pressure, 0.01))
    w = model.deflection_mm(SKIN)[0]
    return Curve(
        name,
        Setup(6.0, 1.0, program, **setup),
        time_s,
        pressure + PRESSURE_NOISE_MBAR * rng.standard_normal(200),
        w + 1e-3 * NOISE_UM * rng.standard_normal(200),
        segment=(time_s >= 5).astype(np.intp),
    )


@pytest.fixture(scope="module")
def identifier(table) -> Identifier:
    return Identifier(table, sensor=Sensor(NOISE_UM, PRESSURE_NOISE_MBAR))


@pytest.fixture(scope="module")
def session(table, identifier) -> Session:
    whole = curve_of(table, HOSTILE, 1)
    later = curve_of(table, "later", 2, cycle=2, repeat=2)
    cut = replace(
        whole,
        name="cut",
        partial=True,
        **{k: getattr(whole, k)[:3] for k in ("time_s", "pressure_mbar", "deflection_mm")},
        segment=whole.segment[:3],
    )
    results = (*(identifier(c).to_json() for c in (whole, later, cut)), None)
    meta = {
        "created_utc": "2026-01-02T03:04:05+00:00",
        "subject": "P-1",
        "site": HOSTILE,
        "versions": {"skinlab": "0.0.1", HOSTILE: HOSTILE},
        "identification": identification_settings(identifier),
        "notes": [HOSTILE],
    }
    return Session(meta, (), (whole, later, cut, later), results)


@pytest.fixture(scope="module")
def few(session) -> Session:
    return Session(session.meta, (), session.curves[:1], session.results[:1])


@pytest.fixture(scope="module")
def report(session, identifier) -> SessionReport:
    return SessionReport(session, identifier, ["Another database."])


@pytest.fixture(scope="module")
def page(report) -> str:
    with pytest.MonkeyPatch.context() as patch:
        leave_pictures_empty(patch)
        return report.html()


@pytest.fixture(scope="module")
def drawn_page(report) -> str:
    return report.html()


def text_of(element: ET.Element) -> str:
    return "".join(element.itertext())


def section(page: str, heading: str) -> ET.Element:
    for found in ET.fromstring(page).iter("section"):
        title = found.find("h2")  # a part of a section has a lower heading
        if title is not None and text_of(title) == heading:
            return found
    raise AssertionError(heading)


def test_every_curve_has_its_numbers_and_pictures_with_words(page, session):
    for number, result in enumerate(session.results, start=1):
        found = section(page, f"Curve {number}")
        text = text_of(found)
        pictures = list(found.iter("img"))
        values = (result or {}).get("parameters") or {}
        assert len(pictures) == (5 if values else 2)
        assert all(p.get("src").startswith("data:image/svg+xml;base64,") for p in pictures)
        words = " ".join(p.get("alt") for p in pictures)
        for value in values.values():
            for end in value.values():
                assert f"{end:#.4g}" in text
                assert f"{end:.4g}" in words
        if values:
            assert f"{result['rms_um']:#.3g}" in text
            assert f"{result['nu_consistent']:#.4g}" in text
            assert f"{result['correlation'][0][1]:+.2f}".replace("-", "−") in text
    rows = list(section(page, "Curve by curve").iter("tr"))
    assert len(rows) == 1 + len(session.curves)
    assert "not identified" in text_of(rows[3])
    assert f"Not identified: {session.results[2]['error']}." in text_of(section(page, "Curve 3"))
    assert "The session stores no values of this curve" in text_of(section(page, "Curve 4"))


def test_page_one_says_what_is_good_what_was_left_out_and_what_comes_next(page, session):
    first = next(ET.fromstring(page).iter("section"))
    text = text_of(first)
    assert text_of(first.find("h2")) == "Result"
    assert f"{len(session.curves)} curves; " in text
    assert "stiffness at small stretch" in text
    assert " to " in text
    assert "is left out: " in text
    assert "Next step: " in text
    assert "What the curves together leave open" in page  # the valley, pair by pair


@pytest.mark.usefixtures("empty_pictures")
@pytest.mark.parametrize("count", [1, 2])
def test_page_one_of_an_imported_session_agrees_with_its_values(table, identifier, count):
    curves = tuple(curve_of(table, f"curve {i}", i) for i in range(count))
    page = SessionReport(Session({}, (), curves, (None,) * count), identifier).html()
    text = text_of(next(ET.fromstring(page).iter("section")))
    assert "stiffness at small stretch" in text
    assert "The session stores no values; these were computed for this page." in text
    assert "none is good" not in text
    assert "Measure again" not in text
    assert "Nothing was identified" not in page
    assert "values that the session stores" in text_of(section(page, "Curve by curve"))
    how = text_of(section(page, "How the numbers were found"))
    assumed = text_of(section(page, "What was assumed"))
    assert "shortest one that holds 88 %" in how
    assert "Errors of the samples, of the curve" in how
    alone = count == 1
    assert ("nearest to it in the sum of squared differences" in how) is alone
    assert ("likeliest for all of them" in how) is not alone
    assert ("Placements: 2, their stiffnesses differ by" in how) is not alone
    assert ("the zero of each placement may be off" in assumed) is not alone


@pytest.mark.usefixtures("empty_pictures")
def test_page_one_of_a_later_loading_says_why_it_is_left_out(table, identifier, session):
    curves = [curve_of(table, "curve 1", 1), curve_of(table, "curve 2", 2, cycle=2)]
    results = [identifier(curve).to_json() for curve in curves]
    two = replace(session, curves=curves, results=results)
    text = SessionReport(two, identifier).html()
    assert "curve 2 is left out: it is loading 2 of the site" in text
    assert "Values of one curve with 90 % intervals" in text
    unknown = SessionReport(two, "its database is gone").html()
    assert "No values of all curves together: there is none, because its database" in unknown


def test_hostile_names_stay_text(page):
    root = ET.fromstring(page)
    tags = {element.tag for element in root.iter()}
    assert "script" not in tags
    assert all(set(e.attrib) <= {"src", "alt"} for e in root.iter("img"))
    shown = HOSTILE.replace("\x1b", "␛")
    assert shown in text_of(section(page, "Curve 1"))
    assert shown in text_of(section(page, "Versions and hashes"))
    assert "P-1" in text_of(root.find("body"))


@pytest.mark.parametrize("made", ["page", pytest.param("drawn_page", marks=pytest.mark.long)])
def test_nothing_is_fetched(made, request):
    page = request.getfixturevalue(made)
    assert not re.search(r"https?:|url\(|@import", page)
    pictures = []
    for element in ET.fromstring(page).iter():
        for name, value in element.attrib.items():
            if name == "href":
                assert value.startswith("#")
            if name == "src":
                pictures.append(base64.b64decode(value.partition(",")[2], validate=True))
    assert pictures
    for picture in pictures:
        inside = {a for e in ET.fromstring(picture).iter() for k, a in e.items() if "href" in k}
        assert all(value.startswith(("#", "data:image/png")) for value in inside)


def test_flags_and_findings_are_explained(page, session, report):
    for measured, result in zip(report.curves, session.results, strict=True):
        points = explanations(measured)
        told = {point.partition(": ")[0] for point in points} | {
            ":".join(point.split(":")[:2]) for point in points
        }
        assert set((result or {}).get("flags", ())) <= told
        assert {f.gate for f in measured.judged.findings} <= told
        assert not any("does not know" in point for point in points)
        for point in points:
            assert point in text_of(section(page, f"Curve {measured.number}"))
    assert "not_first_cycle: This is loading 2 of the site" in page


def test_methods_assumptions_versions_and_hashes(page, session, identifier):
    how = text_of(section(page, "How the numbers were found"))
    assert "Method auto" in how
    assert f"of the deflection {NOISE_UM:g} µm (stated)" in how
    assert "nearest to it in the sum of squared differences of the deflection." in how
    assert "isotropic" in text_of(section(page, "What was assumed"))
    found = text_of(section(page, "Versions and hashes"))
    for value in (
        content_hash(session),
        identifier.provenance().model_hash,
        identifier.database.content_hash,
        "0.0.1",
        *versions().values(),
    ):
        assert value in found
    assert "Another database." in page


def test_the_fitted_curve_is_the_one_that_was_found(report, session):
    fit = report.curves[0].fit
    result = session.results[0]
    rms_um = 1e3 * np.sqrt(np.mean(fit.residual_mm**2))
    assert rms_um == pytest.approx(result["rms_um"], rel=1e-9)
    assert fit.mask.sum() == result["fitted_points"]
    assert not fit.remark
    # 99.9 % of binomial counts of 100 samples, 95.4 % of which lie inside two deviations
    assert 0.87 < fit.within <= 1.0
    line = np.interp(session.curves[0].pressure_mbar[fit.mask], fit.line_mbar, fit.line_mm)
    np.testing.assert_allclose(line, fit.model_mm, atol=2e-3)
    assert fit.ranges["nu"] == pytest.approx((0.0, 0.499))


def test_errors_and_glitches_are_told_and_drawn(table, identifier):
    clean = curve_of(table, "knocked", 3)
    rng, w = np.random.default_rng(5), clean.deflection_mm.copy()
    lasting = np.zeros(len(w))
    for i in range(1, len(w)):
        lasting[i] = 0.9 * lasting[i - 1] + 4e-3 * rng.standard_normal()
    w += lasting
    w[[30, 60]] += (0.3, -0.25)
    curve = replace(clean, deflection_mm=w)
    result = identifier(curve).to_json()
    assert result["outliers"] == [30, 60]
    session = Session({}, (), (curve,), (json.loads(json.dumps(result)),))
    (measured,) = measured_curves(session, identifier)
    assert left_out(measured) == [30, 60]
    rows = dict(row for row in curve_section(measured, ()).tables[1].rows)
    assert "lasting" in rows["errors of the samples"]
    assert rows["left out as glitches, samples"] == "31, 61"
    drawn = {d.name: d for d in curve_drawings(measured)}
    assert "Rings: 2 left out" in drawn["curve_0001_fit"].caption
    assert rows["errors of the samples"] in drawn["curve_0001_errors"].caption
    with style():
        for name in ("curve_0001_fit", "curve_0001_time"):
            axes = drawn[name].draw().axes[name.endswith("time")]
            (ring,) = [x for x in axes.lines if x.get_label() == "left out: glitch"]
            assert ring.get_ydata().tolist() == w[[30, 60]].tolist()
        left, right = drawn["curve_0001_errors"].draw().axes
    assert left.get_ylabel() == "autocorrelation"
    assert right.get_xlabel() == "normal quantile"


def test_the_autocorrelation_and_quantiles_are_those_of_textbooks():
    rng = np.random.default_rng(0)
    process = np.zeros(40_000)
    white = rng.standard_normal(len(process))
    for i in range(1, len(process)):
        process[i] = 0.8 * process[i - 1] + white[i]
    np.testing.assert_allclose(autocorrelation(process)[:5], 0.8 ** np.arange(1, 6), atol=0.02)
    assert np.abs(autocorrelation(white)).max() < 0.02
    expected, seen = quantiles(2.0 * white, np.full(len(white), 2.0))
    np.testing.assert_allclose(seen[100:-100], expected[100:-100], atol=0.1)
    assert quantiles(3.0 * white, None)[1].std() == pytest.approx(1.0)


def test_a_stored_result_that_this_database_does_not_give_is_remarked(session, identifier):
    changed = json.loads(json.dumps(session.results[0]))
    changed["rms_um"] *= 1.01
    other = Session(session.meta, (), session.curves[:1], (changed,))
    (measured,) = measured_curves(other, identifier)
    assert "differs from then" in measured.fit.remark
    assert measured.fit.remark in curve_section(measured, ()).paragraphs


@pytest.mark.usefixtures("empty_pictures")
def test_without_the_identification_the_stored_numbers_are_shown(few, session):
    page = SessionReport(few, "the session does not say how").html()
    found = text_of(section(page, "Curve 1"))
    assert "There is no fitted curve to draw: the session does not say how." in found
    assert f"{session.results[0]['parameters']['X1_MPa']['value']:#.4g}" in found
    assert "Not known" in text_of(section(page, "How the numbers were found"))


@pytest.mark.usefixtures("empty_pictures")
def test_a_method_without_intervals(session, identifier):
    bare = json.loads(json.dumps(session.results[0]))
    for value in bare["parameters"].values():
        value["low"] = value["high"] = None
    bare.update(correlation=None, noise_um=None)
    other = Session(session.meta, (), session.curves[:1], (bare,))
    found = section(SessionReport(other, identifier).html(), "Curve 1")
    alts = [p.get("alt") for p in found.iter("img")]
    assert len(alts) == 4
    assert "no interval" in alts[3]
    assert "noise is unknown" in text_of(found)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["png", "svg"])
def test_pictures_are_valid_and_the_same_twice(few, identifier, kind):
    drawn: list[None] = []
    report = SessionReport(few, identifier)
    files = report.files(kind, lambda: drawn.append(None))
    assert list(files) == report.names(kind)
    assert len(drawn) == len(files) == 6
    for name, content in files.items():
        if kind == "png":
            image = Image.open(io.BytesIO(content)).convert("RGB")
            assert min(image.size) > 200
            assert len(image.getcolors(maxcolors=2**20)) > 20, name
        else:
            assert ET.fromstring(content).tag == "{http://www.w3.org/2000/svg}svg"
    if kind == "svg":  # which has names and times inside
        assert SessionReport(few, identifier).files(kind) == files


def test_the_pictures_of_a_session_are_those_of_its_page(report):
    each = [5, 5, 2, 2]
    names = [f"curve_{k:04d}_" for k, count in enumerate(each, start=1) for _ in range(count)]
    found = report.names("svg")
    assert found[:2] == ["all_curves.svg", "all_intervals.svg"]
    assert [name[: len("curve_0001_")] for name in found[3:]] == names


@pytest.fixture
def pango():
    try:
        check_pdf()
    except InputError:
        pytest.skip("the library Pango is not installed")


@pytest.mark.long
@pytest.mark.usefixtures("pango")
def test_the_pdf_is_on_a4_and_begins_with_page_one_and_a_comparison(few, identifier):
    head = ("quantity", "answer", "change", "between", "smallest that could be shown")
    rows = [(name, "too uncertain to say", "+5 %", "−46 to +104 %", "94 %") for name in "abcd"]
    changed = Section("Changed?", ("Compared with the visit before. " * 4,), (Table(head, rows),))
    (written,) = SessionReport(few, identifier, more=[changed]).files("pdf").values()
    pages = PdfReader(io.BytesIO(written)).pages
    assert [round(float(x) / 72 * 25.4) for x in pages[0].mediabox[2:]] == [210, 297]
    first, second = (  # pypdf reads UTF-16 by bytes
        page.extract_text().replace("\0", "") for page in pages[:2]
    )
    assert "Next step:" in first
    assert "90 % intervals" in first
    assert "smallest that could be shown" in first
    assert first.count("+104") == len(rows)
    assert "+104" not in second
    assert "Curve by curve" not in first  # behind it
    assert "Curve by curve" in second


@pytest.mark.usefixtures("pango")
def test_a_pdf_fetches_nothing():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        to_pdf(f'<img src="http://127.0.0.1:{server.getsockname()[1]}/x">')
        with pytest.raises(BlockingIOError):
            server.accept()


@pytest.mark.parametrize("kind", FORMATS)
def test_an_empty_session(kind, tmp_path, capsys, request):
    if kind == "pdf":
        request.getfixturevalue("pango")
    path = tmp_path / "empty.h5"
    write_session(path, Session({}, (), (), ()))
    assert run(["export", str(path), str(tmp_path / "out"), "--to", kind]) == 0
    if kind == "html":
        page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
        assert "The session holds no curves." in page
        assert ET.fromstring(page).tag == "html"
    elif kind == "pdf":
        assert (tmp_path / "out" / "report.pdf").read_bytes().startswith(b"%PDF-")
    else:
        assert capsys.readouterr().out == ""


def test_a_curve_without_samples(identifier):
    none = Curve("none", Setup(6.0, 1.0), np.empty(0), np.empty(0), np.empty(0), partial=True)
    page = SessionReport(Session({}, (), (none,), (None,)), identifier).html()
    assert "0 samples" in text_of(section(page, "Curve 1"))


@pytest.mark.usefixtures("empty_pictures")
def test_the_command_writes_what_it_says_and_nothing_over_anything(few, tmp_path, capsys):
    path = tmp_path / "s.h5"
    write_session(path, few)
    out = tmp_path / "new" / "out"
    assert run(["export", str(path), str(out), "--to", "html"]) == 0
    (name,) = capsys.readouterr().out.splitlines()
    page = (out / "report.html").read_bytes()
    assert name == str(out / "report.html")
    report = SessionReport(read_session(path), _identifier(path), file=path.name)
    assert page == report.files("html")["report.html"]
    (out / "curve_0001_time.svg").write_text("mine")
    for kind, standing in (("html", "report.html"), ("svg", "curve_0001_time.svg")):
        before = sorted((p.name, p.read_bytes()) for p in out.iterdir())
        assert run(["export", str(path), str(out), "--to", kind]) == 3
        said = capsys.readouterr().err
        assert f"{out / standing}: exists already" in said
        assert said.count("\n") == 1
        assert sorted((p.name, p.read_bytes()) for p in out.iterdir()) == before
    assert run(["export", str(path), str(path), "--to", "png"]) == 3
    assert "is not a folder" in capsys.readouterr().err


def visit_file(path, session, day, curve, identifier, **meta):
    """Write one curve as the visit of a day; return the path as text."""
    about = {**session.meta, "created_utc": f"2026-01-0{day}T03:04:05+00:00", **meta}
    write_session(path, Session(about, (), (curve,), (identifier(curve).to_json(),)))
    return str(path)


def exported(path, out, *options):
    assert run(["export", path, str(out), "--to", "html", *options]) == 0
    first = next(ET.fromstring((out / "report.html").read_text(encoding="utf-8")).iter("section"))
    return text_of(first)


@pytest.mark.long
@pytest.mark.usefixtures("empty_pictures")
def test_page_one_compares_with_the_visit_before(table, session, identifier, tmp_path):
    same, later = (curve_of(table, "curve 1", seed) for seed in (1, 2))
    other = replace(curve_of(table, "curve 1", 3), setup=Setup(8.0, 1.0, same.setup.program))
    monday = visit_file(tmp_path / "monday.h5", session, 2, same, identifier)
    friday = visit_file(tmp_path / "friday.h5", session, 6, later, identifier)
    assert "Changed?" not in exported(monday, tmp_path / "1")
    text = exported(friday, tmp_path / "2")
    assert "Compared with monday.h5 of 2026-01-02" in text
    assert "smallest that could be shown" in text
    assert "stiffness as a whole" in text
    assert "lower with" not in text
    assert sorted(p.name for p in tmp_path.glob("*")) == ["1", "2", "friday.h5", "monday.h5"]
    assert "Changed?" not in exported(friday, tmp_path / "3", "--since", "none")
    # Two sites on the same days, of which one was left alone
    left = [
        visit_file(tmp_path / f"{day}.h5", session, day, curve, identifier, site="other arm")
        for day, curve in ((2, same), (6, later))
    ]
    text = exported(friday, tmp_path / "4", "--control", *left)
    assert "a site that was left alone (2.h5 and 6.h5) is taken away" in text
    sunday = visit_file(tmp_path / "sunday.h5", session, 8, other, identifier)
    assert "Not compared: friday.h5 and sunday.h5: measured" in exported(sunday, tmp_path / "5")
    assert run(["export", sunday, str(tmp_path / "6"), "--to", "html", "--since", friday]) == 3
    assert run(["export", monday, str(tmp_path / "7"), "--to", "csv", "--since", friday]) == 2


def _identifier(path):
    from skinlab.acquisition.replay import identifier_of

    return identifier_of(read_session(path))[0]


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("rms_um", "much", "rms_um"),
        ("correlation", [[1.0]], "3 × 3"),
        ("parameters", {"X1_MPa": {"value": float("nan")}}, "finite"),
        ("flags", 7, "flags"),
    ],
)
def test_a_damaged_result_is_named(session, tmp_path, capsys, field, value, said):
    path = tmp_path / "s.h5"
    damaged = {**session.results[0], field: value}
    write_session(path, Session(session.meta, (), session.curves[:1], (damaged,)))
    assert run(["export", str(path), str(tmp_path / "out"), "--to", "html"]) == 3
    error = capsys.readouterr().err
    assert f"{path}: the stored result of curve 1 is damaged" in error
    assert said in error
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError):
        _ = SessionReport(read_session(path), "unknown").curves


@pytest.mark.usefixtures("empty_pictures")
def test_a_measured_session_is_judged_again_from_its_bytes(tmp_path, capsys):
    path = tmp_path / "visit.h5"
    arguments = "--port sim://?seed=1&speed=50 --aperture-mm 6 --thickness-mm 1 --rate-hz 10"
    arguments += " --program ramp:60@60 --first-cycle 2"
    assert run(["measure", *arguments.split(), "--out", str(path)]) == 0
    session = read_session(path)
    (measured,) = measured_curves(session, _identifier(path))
    gates = {finding.gate for finding in measured.judged.findings}
    assert {"not_first_cycle", "too_few_points"} <= gates
    assert gates <= set(session.results[0]["flags"])
    page = SessionReport(session, _identifier(path)).html()
    notice = ET.fromstring(page).find("body/p[@class='notice']")
    assert text_of(notice).startswith("SIMULATED")
    assert "What to do:" in text_of(section(page, "Curve 1"))


def test_what_was_measured_for_a_missing_effect_is_not_scolded(tmp_path, capsys):
    """The screen knew what F7 had loaded; replay and report told it off for its few samples."""
    path, advised = tmp_path / "visit.h5", tmp_path / "advised.h5"
    arguments = "--port sim://?seed=1&speed=50 --aperture-mm 6 --thickness-mm 1 --rate-hz 10"
    program = "ramp:60@60"
    assert run(["measure", *arguments.split(), "--program", program, "--out", str(path)]) == 0
    session, identifier = read_session(path), _identifier(path)
    (before,) = measured_curves(session, identifier)
    assert "too_few_points" in " ".join(explanations(before))
    said = {"aperture_mm": 6.0, "program": program, "because": MISSING_EFFECT}
    loaded = note(0.0, 0.0, "op", ADVISED, said)
    noted = Session(session.meta, (loaded, *session.records), session.curves, session.results)
    (measured,) = measured_curves(noted, identifier)
    assert verdict_of(before).use is Use.REPEAT
    assert verdict_of(measured).use is Use.GOOD
    assert "too_few_points" not in " ".join(explanations(measured))
    page = SessionReport(noted, identifier).html()
    told = f"It was measured as was advised: {FOR_EFFECT}."
    assert told in text_of(section(page, "Curve 1"))
    write_session(advised, noted)
    capsys.readouterr()
    assert run(["replay", str(advised), "--verify"]) == 0
    told = capsys.readouterr().err
    assert f"curve 1: {FOR_EFFECT}" in told
    assert "too_few_points" not in told
    assert run(["session", "info", str(advised)]) == 0
    assert "measurement advised: aperture_mm 6.0, program ramp:60@60" in capsys.readouterr().out
