"""Every extension that is found, by the rules of its kind: those of `skinlab plugins check`."""

import importlib
import re
from pathlib import Path

import pytest

from drivers.dialects import check_dialect, get_dialect
from skinlab.extensions import dialects
from skinlab.extensions.kinds import KINDS
from skinlab.extensions.rules import BrokenRuleError, broken, expect, says

DOCS = Path(__file__).parents[2] / "docs"
CASES = [(kind, one, rule) for kind in KINDS for one in kind.registry.all() for rule in kind.rules]
# A second or two each; the same rules hold the other methods in `make test`
STUDIES = {
    ("rls", "it_explains_a_curve_of_the_model"),
    ("rls", "the_same_seed_gives_the_same_bits"),
    ("rls", "what_it_says_of_its_answer_holds"),
    ("rls", "a_curve_without_an_answer_is_no_crash"),
    ("hka", "it_explains_a_curve_of_the_model"),
    ("hka", "a_curve_without_an_answer_is_no_crash"),
    ("gn", "a_curve_without_an_answer_is_no_crash"),
}


@pytest.mark.parametrize(
    ("kind", "one", "rule"),
    [
        pytest.param(
            k,
            o,
            r,
            id=f"{k.name}-{o.name}-{r.__name__}",
            marks=pytest.mark.long if (o.name, r.__name__) in STUDIES else (),
        )
        for k, o, r in CASES
    ],
)
def test_it_obeys(kind, one, rule):
    assert broken(rule, one) is None


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_what_is_built_in_bears_the_name_of_its_file(kind):
    for path in Path(__import__(kind.registry.package, fromlist=["_"]).__file__).parent.iterdir():
        text = path.read_text("utf-8") if path.suffix == ".py" else ""
        if re.search(rf"^{kind.registry.attribute} = ", text, re.MULTILINE):
            module = __import__(f"{kind.registry.package}.{path.stem}", fromlist=["_"])
            assert getattr(module, kind.registry.attribute) in kind.registry.all()


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_docs_show_what_is_declared(kind):
    """`skinlab plugins --table KIND` prints it."""
    pages = [page.read_text("utf-8") for page in DOCS.glob("*.md")]
    built_in = [one for one in kind.registry.all() if kind.registry.origin(one.name) is None]
    assert not built_in or sum(kind.markdown() in page for page in pages) == 1


def test_recipes_show_what_the_example_has():
    """The example is installed and run by tests/system/test_plugins.py."""
    page = (DOCS / "extending.md").read_text("utf-8")
    example = DOCS.parent / "examples" / "plugin"
    files = {
        path: path.read_text("utf-8")
        for path in example.rglob("*.*")
        if path.suffix in {".py", ".toml", ".md"}
    }
    shown = re.findall(r"```(?:python|toml)\n(.*?)```", page, re.DOTALL)
    assert len(shown) >= 8
    for code in shown:
        assert any(code.rstrip() in text for text in files.values()), code
    for kind in KINDS:
        assert f"`{kind.registry.group}`" in page
    for path in files:
        if path.suffix == ".py" and path.stem != "__init__":
            assert f"`skinlab_example/{path.name}`" in page
            assert f"`skinlab plugins check {path.stem}`" in page


def test_a_broken_rule_is_a_sentence():
    def rule(one):
        """It is small."""
        expect(one < 3, f"{one} is too much")

    def crash(one):
        raise ZeroDivisionError("of mine")

    assert says(rule) == "It is small"
    assert broken(rule, 2) is None
    assert broken(rule, 5) == "5 is too much"
    assert broken(crash, 5).startswith("ZeroDivisionError: of mine (test_extensions.py line ")
    with pytest.raises(BrokenRuleError):
        rule(5)


def test_what_only_streams_obeys_the_rules_of_what_it_declares(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS.parent / "tests" / "unit" / "drivers"))
    toy = importlib.import_module("toy_dialect").Toy()
    line = get_dialect(str(DOCS.parent / "examples" / "dialects" / "plain_line.toml"))
    for dialect in (toy, line):
        check_dialect(dialect)
        assert [b for rule in dialects.KIND.rules if (b := broken(rule, dialect))] == []

    monkeypatch.setattr(type(toy), "capabilities", "all of them")
    with pytest.raises(TypeError, match="capabilities"):
        check_dialect(toy)
