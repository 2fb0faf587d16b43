"""Plugins that misbehave at work: told by name and package, and nothing else goes with them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from plugin_place import FORWARD, REPOSITORY, SKIN, Place, package

PROGRAM = ["--program", "ramp:50@20"]
MEASURE = ["measure", "--port", "sim://?seed=1&speed=50", *PROGRAM, *SKIN, "--json"]

LAWS = f"""
import sys
import numpy as np
sys.path.insert(0, {str(REPOSITORY / "examples" / "plugin")!r})
from skinlab.mechanics.materials.base import Potential
from skinlab_example.fung import Fung
true = Fung.isochoric
def law(name, **own):
    return type(name, (Fung,), {{"name": name, **own}})()
def changed(change):
    return {{"isochoric": lambda self, *given: change(true(self, *given))}}
GOOD = law("good")
NAN = law("nan", **changed(lambda found: found.scaled(np.nan)))
NONE = law("none", **changed(lambda found: None))
SHAPE = law("shape", **changed(lambda found: Potential(*(np.ones(7),) * 10)))
RAISES = law("raises", **changed(lambda found: found["energy"]))
LEAVES = law("leaves", **changed(lambda found: sys.exit(3)))
MODULUS = law("modulus", half_shear_modulus=lambda self, values: float("nan"))
NO_MODULUS = law("no_modulus", half_shear_modulus=lambda self, values: None)
TORN = law("torn", **changed(lambda found: found.scaled(np.where(found.energy > 1e-3, np.nan, 1))))
HUGE = law("huge", **changed(lambda found: found.scaled(1e200)))
"""
OF_LAWS = {
    "nan": "ValueError: energy is nan at a strain below 0.02; expected a finite number",
    "none": "TypeError: isochoric returned a NoneType; expected a Potential",
    "shape": "TypeError: energy has the shape (7,); expected (27,)",
    "raises": "TypeError: 'Potential' object is not subscriptable (works.py line ",
    "leaves": "SystemExit: 3 (works.py line ",
    "modulus": "ValueError: half_shear_modulus is nan MPa; expected more than 0",
    "no_modulus": "TypeError: half_shear_modulus is a NoneType; expected an array of numbers",
}

EFFECTS = """
import sys
import numpy as np
from skinlab.mechanics.effects.base import Effect, Parameter
def effect(name, **own):
    size = Parameter("size_um", "µm", "m", 0.0, 9.0, 0.0, 1.0, "s")
    said = {"meaning": "m", "formula": "f", "source": "s", "physical": False}
    return type(name, (Effect,), {"name": name, "parameters": (size,), **said, **own})()
def once(self, since_s, deflection_mm, values):
    if len(deflection_mm) == 41:
        raise ValueError("this one")
    return deflection_mm + 1e-3 * values["size_um"]
ONCE = effect("once", read=once)
NAN = effect("nan", read=lambda self, t, w, values: w * np.nan)
HUGE = effect("huge", read=lambda self, t, w, values: w + 1e300)
TEXT = effect("text", read=lambda self, t, w, values: w.astype(str))
LEAVES = effect("leaves", read=lambda self, t, w, values: sys.exit(3))
WHEN = effect("when", when=lambda self, t, values: list(t))
FELT = effect("felt", physical=True, felt=lambda self, path, values: None)
CHANGE = effect("change", physical=True, change=lambda self, problem, values, cycle: None)
"""
OF_EFFECTS = {
    "nan": "ValueError: read_along returned a value that is not finite, or beyond 1e+09",
    "huge": "ValueError: read_along returned a value that is not finite, or beyond 1e+09",
    "text": "TypeError: read_along returned an array of <U32; expected numbers",
    "leaves": "SystemExit: 3 (works.py line ",
    "when": "TypeError: when returned list; expected an array of the shape (51,)",
    "felt": "TypeError: felt returned a NoneType; expected a PressurePath",
    "change": "TypeError: change returned a NoneType; expected a SkinProblem",
}

METHODS = """
import sys
import numpy as np
from dataclasses import replace
from skinlab.inference.methods.base import Method, Option
from skinlab.inference.problem import Estimate
def method(name, change):
    def search(problem, options, rng):
        middle = problem.space.from_unit(np.full(len(problem.space.names), 0.5))
        error_um = float(problem.error_um(middle[None])[0])
        return change(Estimate(middle, error_um, 1, 1, True))
    return Method(name, search, "nothing")
GOOD = method("good", lambda e: replace(e, parameters=list(e.parameters)))
LOUD = method("loud", lambda e: print("found") or e)
NAN = method("nan", lambda e: replace(e, parameters=e.parameters * np.nan))
RAISES = method("raises", lambda e: e["parameters"])
LEAVES = method("leaves", lambda e: sys.exit(3))
OUTSIDE = method("outside", lambda e: replace(e, parameters=e.parameters * 1e6))
ERROR = method("error", lambda e: replace(e, error_um=np.nan))
MINIMA = method("minima", lambda e: replace(e, minima=np.full((2, 3), np.nan)))
COUNTS = method("counts", lambda e: replace(e, iterations=None))
PICKY = replace(GOOD, name="picky", options=(Option("bad", 1, "b", accepts=lambda v: [v][v - 1]),))
"""
OF_METHODS = {
    "nan": "ValueError: its parameters hold nan; expected finite numbers",
    "raises": "TypeError: 'Estimate' object is not subscriptable (works.py line ",
    "leaves": "SystemExit: 3 (works.py line ",
    "outside": "ValueError: X1_MPa is 31622.8; expected 0.005 to 0.2",
    "error": "ValueError: its error_um is nan; expected a finite number",
    "minima": "ValueError: its minima hold nan; expected finite numbers",
    "counts": "TypeError: its iterations are None; expected an int, 0 or more",
}


def works(folder: Path, group: str, names: list[str], text: str) -> Place:
    points = {f"skinlab.{group}": {name: f"works:{name.upper()}" for name in names}}
    return Place(package(folder / "site", "works", points, works=text))


def model_of(folder: Path, effect: str) -> Path:
    path = folder / f"{effect}.toml"
    path.write_text(f'[model]\nname = "m"\n[effects.{effect}.size_um]\nvalue = 1.0\n')
    return path


def test_a_law_that_says_no_energy_is_named(tmp_path):
    """And one that says none at strains beyond the smallest is named where the model ends."""
    place = works(tmp_path, "laws", ["good", "torn", "huge", *OF_LAWS], LAWS)
    skin = ["--c1-mpa", "0.066", "--c2", "11", "--nu", "0.33", *SKIN, *PROGRAM]
    names = ["good", "torn", "huge", *OF_LAWS]
    good, torn, huge, *told = place.each(
        *(["forward", "--direct", "--law", name, *skin] for name in names)
    )
    assert (good.returncode, good.stderr) == (0, "")
    for done, name in ((torn, "torn"), (huge, "huge")):
        assert done.returncode == 5
        assert f"the model of plugin works, law '{name}' holds to " in done.stderr
    for (name, why), done in zip(OF_LAWS.items(), told, strict=True):
        assert (done.returncode, done.stdout) == (3, "")
        assert done.stderr.startswith(f"skinlab: plugin works, law {name!r}: broke down: {why}")


def test_no_table_is_made_of_a_law_that_says_no_energy(tmp_path):
    from fung_table import DIMENSIONLESS

    place = works(tmp_path, "laws", ["nan", "huge", "modulus"], LAWS)
    for name in ("nan", "huge", "modulus"):
        text = DIMENSIONLESS.replace('law = "fung"', f'law = "{name}"')
        (tmp_path / f"{name}.toml").write_text(text)
    build = ["database", "build", "--out", "t.h5", "--workers", "1", "--spec"]
    told = place.each(*([*build, f"{n}.toml"] for n in ("nan", "huge", "modulus")), cwd=tmp_path)
    whys = (
        f"plugin works, law 'nan': broke down: {OF_LAWS['nan']}",
        "plugin works, law 'huge': it does not hold for any suction where thickness_over_radius is "
        "0.24, C2 is 6, kappa_over_half_shear is 4",
        f"plugin works, law 'modulus': broke down: {OF_LAWS['modulus']}",
    )
    for done, why in zip(told, whys, strict=True):
        assert done.returncode == 3
        assert done.stderr.splitlines()[-1] == f"skinlab: {why}"
    assert not (tmp_path / "t.h5").exists()


def test_an_effect_that_breaks_down_at_one_curve_leaves_the_others_their_answers(tmp_path):
    place = works(tmp_path, "effects", ["once", *OF_EFFECTS], EFFECTS)
    models = {name: model_of(tmp_path, name) for name in ("once", *OF_EFFECTS)}
    identify = ["identify", "50.csv", "40.csv", "30.csv", *SKIN, "--json"]
    *made, found, again = place.each(
        *([*FORWARD, "--program", f"ramp:{p}@20", "--csv", f"{p}.csv"] for p in (30, 40, 50)),
        [*identify, "--model", models["once"]],
        [*identify, "--model", models["once"], "--workers", "2"],
        cwd=tmp_path,
    )
    assert [done.returncode for done in made] == [0, 0, 0]
    why = "plugin works, effect 'once': broke down: ValueError: this one (works.py line 11)"
    for done in (found, again):
        assert (done.returncode, done.stderr) == (3, f"skinlab: {why}\n")
        curves = json.loads(done.stdout)["curves"]
        assert [(c["file"], c["error"]) for c in curves] == [
            ("50.csv", None), ("40.csv", why), ("30.csv", None),
        ]  # fmt: skip
        assert [bool(c["parameters"]) for c in curves] == [True, False, True]
    forward = [*FORWARD, *PROGRAM, "--direct", "--model"]
    for name, done in zip(
        OF_EFFECTS, place.each(*([*forward, models[name]] for name in OF_EFFECTS)), strict=True
    ):
        assert (done.returncode, done.stdout) == (3, "")
        begin = f"skinlab: plugin works, effect {name!r}: broke down: {OF_EFFECTS[name]}"
        assert done.stderr.startswith(begin)


def test_a_method_that_has_no_answer_ends_no_measurement(tmp_path):
    place = works(tmp_path, "methods", ["good", *OF_METHODS], METHODS)
    repeats = ["--repeats", "2", "--rest-s", "0"]
    good, *told, again = place.each(
        [*MEASURE, "--method", "good", "--out", "good.h5"],
        *([*MEASURE, *repeats, "--method", m, "--out", f"{m}.h5"] for m in OF_METHODS),
        ["replay", "nan.h5", "--verify", "--speed", "max"],
        cwd=tmp_path,
    )
    assert good.returncode == 0, good.stderr
    assert json.loads(good.stdout)["curves"][0]["parameters"]
    for (name, why), done in zip(OF_METHODS.items(), told, strict=True):
        errors = [curve["error"] for curve in json.loads(done.stdout)["curves"]]
        assert len(errors) == 2
        assert all(
            e.startswith(f"plugin works, method {name!r}: broke down: {why}") for e in errors
        )
    assert again.returncode == 0, again.stderr


def test_a_method_that_cannot_judge_its_option_is_named(tmp_path):
    place = works(tmp_path, "methods", ["picky"], METHODS)
    (told,) = place.each([*MEASURE, "--method", "picky", "--bad", "7", "--out", "s.h5"])
    assert told.returncode == 3
    assert told.stderr.startswith("skinlab: plugin works, method 'picky': broke down: IndexError: ")


def test_what_a_plugin_prints_is_no_part_of_a_document(tmp_path):
    place = works(tmp_path, "methods", ["loud"], METHODS + 'print("here")\n')
    loud = ["--method", "loud"]
    document, text, listed = place.each(
        [*MEASURE, *loud, "--out", "s.h5"],
        [*MEASURE[:-1], *loud, "--out", "t.h5"],
        ["plugins", "--json"],
        cwd=tmp_path,
    )
    assert json.loads(document.stdout)["curves"][0]["parameters"]
    assert {"here", "found"} <= set(document.stderr.splitlines())
    assert "found" in text.stdout.splitlines()
    assert json.loads(listed.stdout)["plugins"]


# ---- records of plugins that are not there any more ----------------------------------------------

DIALECT = """
from drivers.dialects import get_dialect
class Ours:
    name = "ours"
    def __getattr__(self, attribute):
        return getattr(get_dialect("reference"), attribute)
OURS = Ours()
"""
OF_OURS = """
import sys
from dataclasses import replace
from pathlib import Path
from skinlab.recording.session import read_session, write_session
session = read_session(Path(sys.argv[1]))
said = session.meta["dialect"] | {"name": "ours", "plugin": ["works", "1.0"]}
write_session(Path(sys.argv[2]), replace(session, meta=session.meta | {"dialect": said}))
"""
MISSING = "it was recorded with the plugin works 1.0, which is not installed here"


@pytest.mark.parametrize(
    ("group", "name", "text", "told"),
    [
        ("methods", "good", METHODS, "the session's field identification: method 'good' is not k"),
        ("effects", "once", EFFECTS, "the session's field identification.model: effects.once is "),
    ],
    ids=["method", "effect"],
)
def test_a_session_says_which_plugin_it_lacks(tmp_path, group, name, text, told):
    """What is stored needs none of it."""
    place = works(tmp_path, group, [name], text)
    by = ["--method", name] if group == "methods" else ["--model", model_of(tmp_path, name)]
    assert place.skinlab(*MEASURE, *by, "--out", "s.h5", cwd=tmp_path).returncode == 0
    replayed, verified, *others = Place().each(
        ["replay", "s.h5"],
        ["replay", "s.h5", "--verify"],
        ["session", "info", "s.h5"],
        ["session", "verify", "s.h5"],
        ["identify", "s.h5"],
        ["export", "s.h5", "--to", "csv", "out"],
        cwd=tmp_path,
    )
    for done in (replayed, verified):
        assert done.returncode == 3
        assert done.stderr.startswith(f"skinlab: {told}")
        assert done.stderr.endswith(f"; {MISSING}\n")
    assert [done.returncode for done in others] == [0] * 4


def test_a_session_says_which_dialect_it_lacks(tmp_path):
    """The record of a simulated probe, said to be of an installed dialect."""
    path = tmp_path / "ours.h5"
    ours = works(tmp_path, "dialects", ["ours"], DIALECT)
    assert ours.skinlab(*MEASURE, "--out", tmp_path / "s.h5").returncode == 0
    done = ours.run("-c", OF_OURS, tmp_path / "s.h5", path)
    assert done.returncode == 0, done.stderr
    assert ours.skinlab("replay", path, "--verify").returncode == 0
    replayed, page, info, identified = Place().each(
        ["replay", path],
        ["export", path, "--to", "html", tmp_path / "out"],
        ["session", "info", path],
        ["identify", path],
    )
    for done in (replayed, page):
        assert done.returncode == 3
        assert "the session's field dialect: dialect 'ours' is not known" in done.stderr
        assert done.stderr.endswith(f"; {MISSING}\n")
    assert (info.returncode, identified.returncode) == (0, 0)


# ---- what is wrong with one before it is used ----------------------------------------------------

ODD = f"""
import sys
import numpy as np
from dataclasses import replace
sys.path.insert(0, {str(REPOSITORY / "examples" / "plugin")!r})
from skinlab.inference.error_models.base import Hyperparameter, Part, Terms
from skinlab.inference.methods.base import Method, Option
from skinlab.mechanics.effects.base import Effect, Parameter
from skinlab.quality.gates.base import Finding, Gate
from skinlab_example.fung import Fung
from skinlab_example.mains_hum import MainsHum
def law(name, **own):
    return type(name, (Fung,), {{"name": name, **own}})()
def first(**own):
    return tuple([replace(Fung.parameters[0], **own), *Fung.parameters[1:]])
DASH = law("dash", parameters=first(name="bad name!"))
BOUNDS = law("bounds", parameters=first(low=100.0, high=1.0))
NOT_A_NUMBER = law("not_a_number", parameters=first(low="a"))
FORMULA = law("formula", formula=None)
OURS = law("ours", parameters=first(name="aperture_mm"))
SIZE = Parameter("size_um", "µm", "m", 0.0, 9.0, 0.0, 1.0, "s")
def effect(name, **own):
    said = {{"meaning": "m", "formula": "f", "source": "s", "physical": False}}
    return type(name, (Effect,), {{"name": name, "parameters": (SIZE,), **said, **own}})()
PHYSICAL = effect("physical", physical="yes")
TYPICAL = effect("typical", parameters=(replace(SIZE, typical=99.0),))
TWICE = effect("twice", parameters=(SIZE, SIZE))
def method(name, search=lambda problem, options, rng: None, **own):
    return Method(name, search, **{{"meaning": "m", **own}})
SEARCH = method("search", None)
SETTLE = method("settle", settle=lambda options: None)
REMARKS = method("remarks", remarks=lambda options: 1 / 0)
def errors(name, part):
    return type(name, (MainsHum,), {{"name": name, "part": part}})()
def of(name, terms, **own):
    return errors(name, lambda self, look: Part(
        name, (Hyperparameter("a_um", 1.0, 1.0),), lambda values: terms(len(look.samples)), **own))
LEAVES = errors("leaves", lambda self, look: sys.exit(3))
BELOW = of("below", lambda n: Terms(variance_mm2=np.full(n, -1.0)))
BEYOND = of("beyond", lambda n: Terms(variance_mm2=np.full(n, 1e300)))
LOST = of("lost", lambda n: None)
WHY = of("why", lambda n: Terms(), why=7)
STATED = of("stated", lambda n: Terms(), stated={{"k": "text"}})
SIZE_UM = of("size_um", lambda n: Terms(), size_um=lambda values: float("nan"))
GONE = Gate("gone", lambda view: sys.exit(3), meaning="m", threshold="t")
SILENT = Gate("silent", lambda view: Finding("silent", None, "a"), meaning="m", threshold="t")
NO_CHECK = Gate("no_check", None, meaning="m", threshold="t")
"""
LEFT_OUT = {
    ("laws", "dash"): "TypeError: its parameter 'bad name!': expected a name of letters, digits",
    ("laws", "bounds"): "ValueError: its parameter C1_MPa: low is 100 in 100 to 1; expected low b",
    ("laws", "not_a_number"): "TypeError: its parameter C1_MPa: low is 'a'; expected a number",
    ("laws", "formula"): "TypeError: its formula is None; expected a text",
    ("effects", "physical"): "TypeError: its physical is 'yes'; expected True or False",
    ("effects", "typical"): "ValueError: its parameter size_um: typical is 99 in 0 to 9; expecte",
    ("effects", "twice"): "ValueError: two of its parameters have one name: size_um, size_um",
    ("methods", "search"): "TypeError: its search is a NoneType; expected a function",
    ("methods", "settle"): "TypeError: its settle returns no Options",
    ("methods", "remarks"): "ZeroDivisionError: division by zero (odd.py line ",
    ("gates", "no_check"): "TypeError: its check is a NoneType; expected a function",
}
LATER = {
    "error model 'below': broke down, and is left out: TypeError: variance_mm2 is below 0",
    "error model 'beyond': broke down, and is left out: TypeError: variance_mm2 is beyond 1e+09",
    "error model 'leaves': broke down, and is left out: SystemExit: 3",
    "error model 'lost': broke down, and is left out: TypeError: terms returned a NoneType; exp"
    "ected Terms",
    "error model 'why': broke down, and is left out: TypeError: its why is 7; expected a text",
    "error model 'stated': broke down, and is left out: TypeError: its k is 'text'; expected a "
    "finite number",
    "error model 'size_um': broke down, and is left out: TypeError: size_um is nan; expected a fi"
    "nite number",
    "gate 'gone': broke down, and judges nothing: SystemExit: 3",
    "gate 'silent': broke down, and judges nothing: TypeError: its sentence is None; expected a t"
    "ext",
}


def test_what_cannot_work_is_left_out_and_takes_no_command_with_it(tmp_path):
    later = {
        "laws": ["ours"],
        "error_models": ["below", "beyond", "leaves", "lost", "size_um", "stated", "why"],
        "gates": ["gone", "silent"],
    }
    points: dict[str, dict[str, str]] = {}
    for group, name in [*LEFT_OUT, *((g, n) for g, names in later.items() for n in names)]:
        points.setdefault(f"skinlab.{group}", {})[name] = f"odd:{name.upper()}"
    place = Place(package(tmp_path / "site", "odd", points, odd=ODD))
    listed, simulated, measured = place.each(
        ["plugins", "--json"],
        [*FORWARD, *PROGRAM, "--csv", "c.csv"],
        [*MEASURE, "--out", "s.h5"],
        cwd=tmp_path,
    )
    refused = {p["name"]: p["error"] for p in json.loads(listed.stdout)["plugins"] if p["error"]}
    assert set(refused) == {name for _, name in LEFT_OUT}
    for (_, name), why in LEFT_OUT.items():
        assert f"{name!r}: left out, because it is broken: {why}" in refused[name]
    assert simulated.returncode == 0
    assert simulated.stderr == (
        "skinlab: plugin odd, law 'ours': its option --aperture-mm is the command's; expected "
        "another name\n"
    )
    assert measured.returncode == 0
    told = {re.sub(r" \(odd\.py line \d+\)$", "", line) for line in measured.stderr.splitlines()}
    assert {f"skinlab: plugin odd, {why}" for why in LATER} == told
    assert "SystemExit: 3 (odd.py line " in measured.stderr
    assert json.loads(measured.stdout)["curves"][0]["parameters"]
