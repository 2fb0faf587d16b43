"""Plugins that are installed for real: one of each kind, and all the ways to be broken."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest
from plugin_place import FORWARD, REPOSITORY, SKIN, Place, package

from skinlab.cli.main import run
from skinlab.discrepancy.cache import key
from skinlab.versions import versions

NAME = "skinlab-example"
KINDS = {
    "law": "fung",
    "effect": "warm_up",
    "method": "pattern_search",
    "error model": "mains_hum",
    "gate": "house_limit",
    "dialect": "json_lines",
}


@pytest.fixture(scope="module")
def example(tmp_path_factory) -> Place:
    """`pip install examples/plugin`, without a network, into a folder."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("target")
    shutil.copytree(REPOSITORY / "examples" / "plugin", source, dirs_exist_ok=True)
    pip = "-m pip install --quiet --no-deps --no-build-isolation --disable-pip-version-check"
    done = Place().run(*pip.split(), "--no-index", "--target", target, source)
    assert done.returncode == 0, done.stderr
    return Place(target)


# ---- one of each kind ----------------------------------------------------------------------------


@pytest.mark.long
def test_the_example_is_listed_with_its_package_and_obeys_the_rules_of_its_kinds(example):
    check = ["plugins", "check", *KINDS.values(), "--json"]
    listed, text, checked = example.each(["plugins", "--json"], ["plugins"], check)
    assert (listed.returncode, listed.stderr) == (0, "")
    plugins = json.loads(listed.stdout)["plugins"]
    assert {p["kind"]: p["name"] for p in plugins if p["distribution"] == NAME} == KINDS
    assert {p["version"] for p in plugins if p["distribution"] == NAME} == {"0.1.0"}
    assert "warm_up                   skinlab-example 0.1.0" in text.stdout
    assert "viscoelasticity           built in" in text.stdout
    assert (checked.returncode, checked.stderr) == (0, ""), checked.stdout
    rules = json.loads(checked.stdout)["rules"]
    assert {row["kind"]: row["name"] for row in rules} == KINDS
    assert all(row["broken"] is None for row in rules)
    assert len(rules) > 25


@pytest.mark.long
def test_a_group_with_a_slip_is_named(tmp_path):
    points = {"skinlab.effect": {"creeping": "creeping:EFFECT"}}
    place = Place(package(tmp_path / "there", "slip", points, creeping="EFFECT = None"))
    for command, status in ((["plugins"], 0), (["plugins", "check"], 1)):
        done = place.skinlab(*command)
        assert done.returncode == status
        assert done.stderr.count("\n") == 1
        assert done.stderr.startswith(
            "skinlab: plugin slip, 'creeping': left out, because its group"
        )
        assert done.stderr.endswith("; did you mean skinlab.effects?\n")


def test_a_name_that_nothing_has_is_wrong_usage(capsys):
    assert run(["plugins", "check", "warm_up"]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "nothing is called warm_up" in told.err


@pytest.mark.long
def test_a_method_brings_its_options(example, tmp_path):
    csv = tmp_path / "c.csv"
    identify = ["identify", csv, *SKIN, "--json", "--method"]
    wrong = [
        (["pattern_search", "--shrink", "1"], 3, "shrink 1.0: expected more than 0, less than 1"),
        (["pattern_search", "--shrink", "much"], 2, "'much' is not a number"),
        (["auto", "--shrink", "0.4"], 2, "--shrink belongs to --method pattern_search"),
        (["pattern_search", "--passes", "3"], 2, "--passes belongs to --method rls"),
    ]
    right = [["pattern_search"], ["pattern_search", "--shrink", "0.8"]]
    made, *found, explained = example.each(
        [*FORWARD, "--program", "ramp:100@20", "--csv", csv],
        *([*identify, *arguments] for arguments in (*right, *(w for w, _, _ in wrong))),
        ["measure", "--help"],
    )
    assert made.returncode == 0
    curves = []
    for done in found[:2]:
        assert (done.returncode, done.stderr) == (0, "")
        document = json.loads(done.stdout)
        assert document["method"] == "pattern_search"
        curves += document["curves"]
    assert curves[0]["error_um"] < 5
    assert curves[0]["parameters"] != curves[1]["parameters"]  # the other steps end elsewhere
    for done, (_, status, says) in zip(found[2:], wrong, strict=True):
        assert (done.returncode, done.stdout) == (status, "")
        assert says in done.stderr
    assert "--shrink NUMBER" in explained.stdout


def test_a_law_and_an_error_model_are_used(example, tmp_path):
    """The law with its own options; the error that was added to a curve is named."""
    of_the_law = ["forward", "--direct", "--law", "fung", "--c1-mpa", "0.066", "--c2", "11"]
    csv = tmp_path / "hum.csv"
    assert run([*FORWARD, "--program", "ramp:100@20", "--csv", str(csv)]) == 0
    rng = np.random.default_rng(1)
    lines = []
    for line in csv.read_text("utf-8").splitlines():
        if line[:1].isdigit():
            time_s, pressure, deflection, *rest = line.split(",")
            hum_mm = 5e-3 * np.sin(2 * np.pi * 50 * float(time_s) + 1) + rng.normal(0, 1e-3)
            lines += [",".join([time_s, pressure, f"{float(deflection) + hum_mm:.6f}", *rest])]
        else:
            lines += [line]
    csv.write_text("\n".join(lines) + "\n", "utf-8")
    of_the_law = ["forward", "--direct", "--law", "fung", "--c1-mpa", "0.066", "--c2", "11"]
    law, done = example.each(
        [*of_the_law, "--nu", "0.33", *SKIN, "--program", "ramp:50@20"],
        ["identify", csv, *SKIN, "--json"],
    )
    assert (law.returncode, law.stderr) == (0, "")
    assert (done.returncode, done.stderr) == (0, "")
    (curve,) = json.loads(done.stdout)["curves"]
    assert "mains_hum" in curve["error_model"]["name"]
    assert "the mains hum" in curve["error_model"]["why"]


def test_an_effect_is_in_the_model(example, tmp_path, capsys):
    model = tmp_path / "m.toml"
    model.write_text(
        '[model]\nname = "warm"\n[effects.warm_up]\n'
        "rise_um = { value = 50.0 }\ntau_s = { value = 1.0 }\n"
    )
    forward = [*FORWARD, "--program", "ramp:50@20,ramp:0@20"]
    plain, warm = example.each([*forward, "--direct"], [*forward, "--direct", "--model", model])
    assert (warm.returncode, warm.stderr) == (0, "")
    last = [float(done.stdout.splitlines()[-1].split(",")[2]) for done in (plain, warm)]
    assert last[1] - last[0] == pytest.approx(0.05 * (1 - np.exp(-5)), rel=1e-3)
    assert run([*forward, "--model", str(model)]) == 3
    assert "effects.warm_up is not known; expected one of: " in capsys.readouterr().err


WORKERS = """
import multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
from drivers.dialects import get_dialect
from skinlab.inference.error_models import ERROR_MODELS
from skinlab.inference.methods import get_method
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.materials import get_law
from skinlab.quality.gates import GATES

def told(_):
    return (get_law("fung").name, get_effect("warm_up").name,
            get_method("pattern_search").name, GATES.get("house_limit").name,
            get_dialect("json_lines").name, ERROR_MODELS.get("mains_hum").name)

if __name__ == "__main__":
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        print(len(set(pool.map(told, range(2)))))
"""


@pytest.mark.long
def test_worker_processes_find_them_by_themselves(example, tmp_path):
    assert example.says(WORKERS, tmp_path) == "1"


HIDDEN = """
import numpy as np
from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.workflow import explain
from skinlab.mechanics.effects.model import response
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.fem.suction import Geometry
from skinlab.tables.store import shipped_table

if __name__ == "__main__":
    rng, curves = np.random.default_rng(1), []
    for aperture, text in ((6.0, "ramp:100@20,ramp:0@20"), (2.0, "ramp:200@40,ramp:0@40")):
        program = parse_program(text)
        t = np.arange(int(program.duration_s * 8 + 1e-9) + 1) / 8
        path = PressurePath.of_program(program)
        effects = {"warm_up": {"rise_um": 60.0, "tau_s": 2.0}}
        w = response(Skin((0.04, 1.5, 0.32)), effects, Geometry(aperture, 1.0), path, t)
        w = w.deflection_mm + rng.normal(0, 3e-3, len(t))
        curves.append(Curve(f"{aperture}.csv", Setup(aperture, 1.0, program), t, path(t), w))
    campaign = Campaign("hidden", 3.0, 0.0, tuple(curves))
    found = explain(campaign, shipped_table(), workers=1, finite_elements=False).to_json()
    print(found["verdict"], found["effects"])
    shown = {name.split(".")[0] for name in found["detectable"]}
    print(found["not_screened"])
    print(*sorted(shown))
"""


@pytest.mark.long
def test_a_gate_judges_and_the_session_knows_the_plugin(example, tmp_path, capsys):
    measure = ["measure", "--port", "sim://?seed=1&speed=10", "--program", "ramp:200@100"]
    measure += [*SKIN, "--method", "pattern_search", "--shrink", "0.6", "--json"]
    done, again, page = example.each(
        [*measure, "--out", "s.h5"],
        ["replay", "s.h5", "--verify", "--speed", "max"],
        ["export", "s.h5", "--to", "html", "out"],
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "house_limit: the suction reached 1" in done.stderr
    assert "house_limit" in json.loads(done.stdout)["curves"][0]["flags"]
    assert again.returncode == 0, again.stderr
    assert page.returncode == 0, page.stderr
    text = next((tmp_path / "out").glob("*.html")).read_text("utf-8")
    assert "pattern search from the best of random candidates" in text
    assert "plugin skinlab-example" in text
    # Where the plugin is not installed, the session says by which method it was identified.
    assert run(["replay", str(tmp_path / "s.h5"), "--verify"]) == 3
    assert "method 'pattern_search' is not known" in capsys.readouterr().err


PROVENANCE = """
from skinlab.discrepancy.cache import key
from skinlab.versions import versions
print(key(["data"]), versions().get("plugin skinlab-example", "none"))
from drivers.connection import Connection
from drivers.dialects import dialect_names, dialect_origin, get_dialect
from drivers.events import Identify
from sim_device.device import Device
from sim_device.files import SensorSection, SkinSection
from sim_device.skin import make_skin

dialect = get_dialect("json_lines")
device = Device(make_skin(SkinSection(), {}), SensorSection(), dialect=dialect)
connection = Connection(dialect)
device.receive(connection.send(Identify()))
connection.receive_data(device.transmit())
print(connection.next_event().dialect, dialect_origin("json_lines"), dialect_names())
"""


@pytest.mark.long
def test_versions_and_cache_keys_know_the_plugin_and_its_source(example, tmp_path):
    (target,) = example.folders
    changed = tmp_path / "changed"
    shutil.copytree(target, changed)
    with (changed / "skinlab_example" / "warm_up.py").open("a") as stream:
        stream.write("# changed, under the same version\n")
    found = [place.says(PROVENANCE, tmp_path).splitlines() for place in (example, Place(changed))]
    named = [first.split(maxsplit=1) for first, _ in found]
    assert len({key(["data"]), *(name for name, _ in named)}) == 3
    assert all(said.startswith("0.1.0 ") for _, said in named)
    # A simulated probe speaks the installed dialect
    spoken = "json_lines ('skinlab-example', '0.1.0') ('json_lines', 'reference')"
    assert [said for _, said in found] == [spoken, spoken]
    assert "plugin skinlab-example" not in versions()


# ---- all the ways to be broken -------------------------------------------------------------------

EFFECT = """
from skinlab.mechanics.effects.base import Effect, Parameter
class Mine(Effect):
    name = {name!r}
    meaning, formula, source, physical = "m", "f", "s", False
    parameters = (Parameter("size_um", "µm", "m", 0.0, 9.0, 0.0, 1.0, "s"),)
EFFECT = Mine()
"""
BROKEN = {
    "no_module": ("not_there:EFFECT", "ModuleNotFoundError: No module named 'not_there'"),
    "no_object": ("good:NOTHING", "AttributeError: module 'good' has no attribute 'NOTHING'"),
    "raises": ("raises:EFFECT", "ZeroDivisionError: division by zero (raises.py line 1)"),
    "leaves": ("leaves:EFFECT", "SystemExit: 3"),
    "no_effect": ("good:NUMBER", "TypeError: int has no name, meaning"),
    "half": ("half:EFFECT", "TypeError: it is a Half; expected a skinlab.mechanics.effects.base"),
    "other_name": ("good:EFFECT", "it calls itself 'good'; expected its entry point's name"),
}


@pytest.fixture
def wreck(tmp_path) -> Place:
    points = {name: value for name, (value, _) in BROKEN.items()}
    points |= {"good": "good:EFFECT", "viscoelasticity": "taken:EFFECT"}
    package(
        tmp_path / "site",
        "wreck",
        {"skinlab.effects": points},
        good=EFFECT.format(name="good") + "NUMBER = 1\n",
        taken=EFFECT.format(name="viscoelasticity"),
        raises="1 / 0\n",
        leaves="import sys\nsys.exit(3)\n",
        half="class Half:\n    name = meaning = formula = source = 'x'\n    physical = False\n"
        "    parameters = ()\nEFFECT = Half()\n",
    )
    package(tmp_path / "site", "zwilling", {"skinlab.effects": {"good": "good:EFFECT"}})
    return Place(tmp_path / "site")


def test_each_broken_plugin_is_one_warning_that_names_it(wreck, tmp_path):
    model = tmp_path / "m.toml"
    model.write_text('[model]\nname = "a"\n[effects.raises.size_um]\nvalue = 1.0\n')
    done, checked, asked = wreck.each(
        ["plugins", "--json"],
        ["plugins", "check", "raises"],
        [*FORWARD, "--program", "ramp:50@20", "--model", model],
    )
    assert done.returncode == 0
    listed = json.loads(done.stdout)["plugins"]
    effects = {p["name"]: p for p in listed if p["kind"] == "effect" and p["error"] is None}
    assert effects["good"]["distribution"] == "wreck"
    assert effects["viscoelasticity"]["distribution"] is None  # the built-in one stays
    lines = done.stderr.splitlines()
    expected = {
        f"skinlab: plugin wreck, effect {name!r}: left out, because it is broken: ": says
        for name, (_, says) in BROKEN.items()
    }
    expected["skinlab: plugin wreck, effect 'viscoelasticity': left out, because "] = (
        "one of this name is built in"
    )
    expected["skinlab: plugin zwilling, effect 'good': left out, because "] = (
        "one of this name comes from wreck"
    )
    assert len(lines) == len(expected)
    for begin, says in expected.items():
        (line,) = [line for line in lines if line.startswith(begin)]
        assert says in line
    refused = {p["name"]: p["error"] for p in listed if p["error"] is not None}
    assert set(refused) == {*BROKEN, "viscoelasticity", "good"}
    assert checked.returncode == 1
    # Who asks for a broken one hears why
    assert asked.returncode == 3
    last = asked.stderr.splitlines()[-1]
    assert "effects.raises is not known (plugin wreck, effect 'raises': left out" in last


@pytest.mark.long
def test_workers_do_not_warn_again(wreck, tmp_path):
    script = tmp_path / "program.py"
    script.write_text(
        "import multiprocessing\n"
        "from concurrent.futures import ProcessPoolExecutor\n"
        "from skinlab.mechanics.effects import effect_names\n"
        "def count(_):\n    return len(effect_names())\n"
        "if __name__ == '__main__':\n"
        "    effect_names()\n"
        "    with ProcessPoolExecutor(1, multiprocessing.get_context('spawn')) as pool:\n"
        "        print(len(set(pool.map(count, range(2)))))\n"
    )
    done = wreck.run(script)
    assert done.stdout == "1\n"
    assert len(done.stderr.splitlines()) == len(BROKEN) + 2


HELP = """
from skinlab.cli.main import run
for command in (["--help"], ["--version"], ["session", "--help"], ["compare", "--help"]):
    assert run(command) == 0
"""


def test_help_imports_no_plugin(tmp_path):
    trace = tmp_path / "imported"
    text = f"open({str(trace)!r}, 'w')\n"
    groups = ("laws", "effects", "methods", "error_models", "gates", "dialects")
    points = {f"skinlab.{group}": {"spy": "spy:SPY"} for group in groups}
    place = Place(package(tmp_path / "site", "spy", points, spy=text))
    assert "Usage: skinlab" in place.says(HELP, tmp_path)
    assert not trace.exists()
    assert len(place.skinlab("plugins").stderr.splitlines()) == len(groups)
    assert trace.exists()


def test_damaged_metadata_is_no_crash(tmp_path):
    site = package(tmp_path / "site", "odd", {"skinlab.gates": {"x": ""}})
    (site / "odd-1.0.dist-info" / "METADATA").unlink()
    done = Place(site).skinlab("plugins")
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


GATE = """
from skinlab.quality.gates.base import Gate
def check(view):
    return [][1]
def oops(view):
    return "oops"
GATE = Gate("breaks", check, meaning="never", threshold="none")
OOPS = Gate("oops", oops, meaning="never", threshold="none")
"""
AT_WORK = """
from skinlab.inference.error_models.base import Hyperparameter, Part
from skinlab.inference.methods.base import Method
from skinlab.mechanics.effects.base import Effect, Parameter
class Errors:
    name, meaning, prior = "boo", "m", "p"
    def part(self, look):
        raise KeyError("boo")
class Parts(Errors):
    name = "no_part"
    def part(self, look):
        return 3
class Terms(Errors):
    name = "no_terms"
    def part(self, look):
        return Part(self.name, (Hyperparameter("x_um", 1.0, 1.0),), lambda values: values[7])
def identify(problem, options, rng):
    return {}["start"]
class Mine(Effect):
    name, meaning, formula, source, physical = "mine", "m", "f", "s", False
    parameters = (Parameter("size_um", "µm", "m", 0.0, 9.0, 0.0, 1.0, "s"),)
    def read(self, since_s, deflection_mm, values):
        return 1 // 0
ERRORS, PARTS, TERMS, EFFECT = Errors(), Parts(), Terms(), Mine()
SEARCH = Method("lost", identify, "nothing")
NO_ANSWER = Method("silent", lambda problem, options, rng: None, "nothing")

import numpy as np
from skinlab.inference.error_models.base import Terms as Found
class Flat(Errors):
    name = "flat"
    def part(self, look):
        return Part(self.name, (), lambda values: Found(columns_mm=np.ones(3)))
class Nothing(Errors):
    name = "nothing"
    def part(self, look):
        columns = np.full((len(look.samples), 1), np.nan)
        return Part(self.name, (), lambda values: Found(columns_mm=columns))
class Short(Mine):
    name = "short"
    def read(self, since_s, deflection_mm, values):
        return deflection_mm[1:]
FLAT, NOTHING, SHORT = Flat(), Nothing(), Short()
"""


@pytest.fixture
def at_work(tmp_path) -> Place:
    """What is well declared, and breaks down when it is used."""
    points = {
        "error_models": {
            "boo": "ERRORS", "flat": "FLAT", "no_part": "PARTS", "no_terms": "TERMS",
            "nothing": "NOTHING",
        },
        "methods": {"lost": "SEARCH", "silent": "NO_ANSWER"},
        "effects": {"mine": "EFFECT", "short": "SHORT"},
    }  # fmt: skip
    groups = {f"skinlab.{g}": {n: f"works:{o}" for n, o in p.items()} for g, p in points.items()}
    return Place(package(tmp_path / "site", "works", groups, works=AT_WORK))


def without_places(text: str) -> list[str]:
    """Lines, without where in a plugin's file an error is from."""
    return [re.sub(r" \(\w+\.py line \d+\)$", "", line) for line in text.splitlines()]


def test_what_breaks_down_at_work_is_named_and_everything_else_goes_on(at_work, tmp_path):
    csv, model = tmp_path / "c.csv", tmp_path / "m.toml"
    model.write_text('[model]\nname = "m"\n[effects.mine.size_um]\nvalue = 1.0\n')
    program = ["--program", "ramp:50@20"]
    assert run([*FORWARD, *program, "--csv", str(csv)]) == 0
    measure = ["measure", "--port", "sim://?seed=1&speed=50", *program, *SKIN, "--json"]
    short = tmp_path / "short.toml"
    short.write_text(model.read_text().replace("effects.mine", "effects.short"))
    plain, by_lost, by_silent, effect, of_model, too_short, measured, again = at_work.each(
        ["identify", csv, *SKIN, "--json"],
        ["identify", csv, *SKIN, "--method", "lost"],
        ["identify", csv, *SKIN, "--method", "silent"],
        [*FORWARD, *program, "--direct", "--model", model],
        ["identify", csv, *SKIN, "--model", model],
        [*FORWARD, *program, "--direct", "--model", short],
        [*measure, "--method", "lost", "--repeats", "2", "--rest-s", "0", "--out", "s.h5"],
        ["replay", "s.h5", "--verify", "--speed", "max"],
        cwd=tmp_path,
    )
    assert plain.returncode == 0, plain.stderr
    assert json.loads(plain.stdout)["curves"][0]["parameters"]
    left_out = {
        "boo": "KeyError: 'boo'",
        "flat": "TypeError: columns_mm has the shape (3,); expected (51, m), a row a sample",
        "no_part": "TypeError: it returned a int; expected a Part or None",
        "no_terms": "IndexError: list index out of range",
        "nothing": "TypeError: columns_mm is not finite",
    }
    assert without_places(plain.stderr) == [
        f"skinlab: plugin works, error model {name!r}: broke down, and is left out: {why}"
        for name, why in left_out.items()
    ]
    lost = "plugin works, method 'lost': broke down: KeyError: 'start' (works.py line 18)"
    assert (by_lost.returncode, by_lost.stderr) == (3, f"skinlab: {lost}\n")
    assert by_silent.returncode == 3
    assert "method 'silent': broke down: TypeError: it returned a NoneType" in by_silent.stderr
    for done in (effect, of_model):
        assert done.returncode == 3
        assert done.stderr.startswith("skinlab: plugin works, effect 'mine': broke down: ZeroDiv")
    assert too_short.returncode == 3
    assert "effect 'short': broke down: TypeError: read_along returned an arr" in too_short.stderr
    curves = json.loads(measured.stdout)["curves"]
    assert [curve["error"] for curve in curves] == [lost, lost]
    assert again.returncode == 0, again.stderr


LATER = """
from skinlab.inference.error_models.base import Hyperparameter, Part, Terms
from skinlab_example.fung import Fung
class Late:
    name, meaning, prior = "late", "m", "p"
    def part(self, look):
        def terms(values):
            return Terms({1.0: 1e-6}[values[0]])
        return Part(self.name, (Hyperparameter("x_um", 1.0, 1.0),), terms)
class Torn(Fung):
    name = "torn"
    def isochoric(self, i1, i2, j, parameters):
        return {}["energy"]
ERRORS, LAW = Late(), Torn()
"""


def test_what_breaks_down_late_is_named_too(example, tmp_path):
    csv = tmp_path / "c.csv"
    program = ["--program", "ramp:50@20"]
    assert run([*FORWARD, *program, "--csv", str(csv)]) == 0
    points = {
        "skinlab.error_models": {"late": "later:ERRORS"},
        "skinlab.laws": {"torn": "later:LAW"},
    }
    later = package(tmp_path / "site", "later", points, later=LATER)
    place = Place(later, *example.folders)
    of_the_law = ["forward", "--direct", "--law", "torn", "--c1-mpa", "0.066", "--c2", "11"]
    errors, law = place.each(
        ["identify", csv, *SKIN, "--json"], [*of_the_law, "--nu", "0.33", *SKIN, *program]
    )
    assert errors.returncode == 3
    (curve,) = json.loads(errors.stdout)["curves"]
    assert curve["error"].startswith("plugin later, error model 'late': broke down: KeyError: ")
    assert law.returncode == 3
    why = "plugin later, law 'torn': broke down: KeyError: 'energy' (later.py line 13)"
    assert law.stderr == f"skinlab: {why}\n"


def test_a_gate_that_breaks_down_ends_no_measurement(tmp_path):
    points = {"skinlab.gates": {"breaks": "breaks:GATE", "oops": "breaks:OOPS"}}
    place = Place(package(tmp_path / "site", "breaks", points, breaks=GATE))
    measure = ["measure", "--port", "sim://?seed=1&speed=50", "--program", "ramp:50@100", *SKIN]
    done = place.skinlab(*measure, "--out", "s.h5", "--json", cwd=tmp_path)
    assert done.returncode == 0
    assert [line for line in without_places(done.stderr) if "plugin" in line] == [
        f"skinlab: plugin breaks, gate {name!r}: broke down, and judges nothing: {why}"
        for name, why in (
            ("breaks", "IndexError: list index out of range"),
            ("oops", "TypeError: it returned a str; expected a Finding or None"),
        )
    ]
    assert json.loads(done.stdout)["curves"][0]["parameters"]


@pytest.mark.long
def test_a_search_names_an_installed_effect_and_tells_of_one_that_breaks_down(example, tmp_path):
    """The installed one and the broken one, in one search."""
    effect = EFFECT.format(name="breaks") + (
        "def read(self, since_s, deflection_mm, values):\n    raise KeyError('mine')\n"
        "Mine.read = read\n"
    )
    points = {"skinlab.effects": {"breaks": "breaks:EFFECT"}}
    broken = package(tmp_path / "site", "breaks", points, breaks=effect)
    place = Place(broken, *example.folders)
    verdict, not_screened, shown = place.says(HIDDEN, tmp_path).splitlines()
    assert verdict == "named [['warm_up']]"
    assert not_screened == "{'breaks': \"plugin breaks broke down: KeyError: 'mine'\"}"
    assert {"warm_up", "deflection_offset"} <= set(shown.split())
