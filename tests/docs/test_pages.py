"""The pages: every link leads somewhere, every command and every Python block runs.

```sh
A block of `sh` is run, after those above it on its page, in an empty folder beside `examples`.
```
A block of `console` needs what nobody else has (an instrument, somebody's sessions): its commands
and options exist. A block of `python` is run, or is an excerpt of a file that other tests run.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import fields
from functools import cached_property
from pathlib import Path

import click
import pytest

from skinlab.cli.main import cli
from skinlab.exchange.codes import CODES, unit_of, words_of
from skinlab.inference.error_models.base import Look
from skinlab.inference.samples import Samples
from skinlab.quality.gates.base import CurveSoFar

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")],
    key=lambda path: path.relative_to(ROOT),
)
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
# Python of these pages is run elsewhere, or is quoted from these files
RUN_BY = {
    "docs/python.md": "tests/unit/api/test_python.py",
    "docs/dialects.md": "tests/unit/drivers/test_capture.py",
}
QUOTED_FROM = {"docs/extending.md": "examples/plugin/**/*.py"}


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def having(language: str) -> list[str]:
    return [name for name in NAMES if blocks(name, language)]


def prose(path: Path) -> str:
    return re.sub(
        r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and the site make them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", prose(path), re.MULTILINE):
        plain = re.sub(r"[`*]|\]\(.*?\)|\[", "", heading).strip().lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", NAMES)
def test_links_lead_somewhere(page):
    path = ROOT / page
    wrong = []
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(path)):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target)
        ):
            wrong.append(link)
    assert not wrong


@pytest.mark.parametrize("kind", ["*.md", "*.py"])
def test_files_that_are_named_exist(kind):
    named = re.compile(
        r"\b((?:tests|benchmarks|docs|examples|skinlab|drivers)/[\w./-]*\.[a-z0-9]+)"
    )
    folders = ["docs", "skinlab", "drivers", "sim_device"]
    found = [path for folder in folders for path in (ROOT / folder).rglob(kind)]
    found += [ROOT / "README.md", ROOT / "CONTRIBUTING.md"] if kind == "*.md" else []
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in found
        for name in named.findall(path.read_text(encoding="utf-8"))
        if not (ROOT / name).exists()
    }
    assert missing == set()


def test_every_page_is_in_the_navigation():
    shown = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [
        str(path.relative_to(ROOT / "docs"))
        for path in (ROOT / "docs").rglob("*.md")
        if "decisions" not in path.parts
    ]
    assert [page for page in pages if not re.search(rf"[ ]{re.escape(page)}$", shown, re.M)] == []


def test_the_readme_is_short():
    text = re.sub(r"\]\([^)]*\)", "]", prose(ROOT / "README.md"))
    assert len(text.split()) <= 500


@pytest.mark.parametrize("page", having("sh"))
def test_what_is_run_has_no_gaps(page):
    for block in blocks(page, "sh"):
        assert "…" not in block
        assert " ..." not in block
        assert "/dev/tty" not in block


def mentioned(page: str) -> list[list[str]]:
    """Return the commands in a page's sentences and indented lines, as words."""
    text = prose(ROOT / page)
    lines = re.findall(r"`((?:skinlab|python -m sim_device)\b[^`]*)`", text)
    lines += re.findall(r"^ {4}(skinlab .*)$", text, re.MULTILINE)
    return [re.sub(r"[\[\]…]|\\\|", " ", " ".join(line.split())).split() for line in lines]


@pytest.mark.parametrize("page", [name for name in NAMES if "decisions" not in name])
def test_commands_in_sentences_exist(page):
    for words in mentioned(page):
        if words[0] != "skinlab":
            continue
        command: click.Command = cli
        for word in words[1:]:
            if not isinstance(command, click.Group) or not re.fullmatch("[a-z]+", word):
                break
            found = command.get_command(click.Context(command), word)
            assert found is not None, words
            command = found
        options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
        used = {word.partition("=")[0] for word in words if re.match("--[a-z]", word)}
        assert used <= options, words


@pytest.mark.parametrize("page", having("toml"))
def test_examples_of_files_are_toml(page):
    for block in blocks(page, "toml"):
        tomllib.loads(block)


def test_tables_have_a_head():
    """A row behind an empty line is shown as text with bars in it."""
    rows = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)
    heads = {page: rows.findall(prose(ROOT / page)) for page in NAMES}
    headless = [
        (page, table[:60])
        for page, tables in heads.items()
        for table in tables
        if not re.match(r"\|.*\n\|[\s:|-]+\|\n", table)
    ]
    assert headless == []


def test_all_codes_of_fhir_are_listed():
    page = (ROOT / "docs" / "exchange.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(\S+)` \| (.+?) \| `?(\S*?)`? \|$", page, re.MULTILINE))
    law = {(name, words_of(name), unit_of(name)) for name in ("X1_MPa", "X2_MPa", "nu")}
    assert listed >= law | {(code, *said) for code, said in CODES.items()}


def test_the_index_leads_to_every_page():
    shown = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = re.findall(r"([\w/-]+\.md)$", shown, re.MULTILINE)
    assert [page for page in pages if page != "index.md" and f"({page})" not in index] == []


def test_the_glossary_has_each_word_once_and_those_that_are_used_everywhere():
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = [row.split("|")[1].strip() for row in text.splitlines() if row.startswith("| ")][1:]
    words = [word.strip() for row in rows for word in row.split(",")]
    assert len(set(words)) == len(words)
    effects = {"effect", "gap", "held out", "verdict", "placement", "cycle", "opening", "aperture"}
    files = {"visit", "session", "recording", "campaign", "study", "protocol", "dialect", "seal"}
    numbers = {"interval", "prior", "flag", "gate", "dose", "goal", "phantom", "error model"}
    assert effects | files | numbers <= set(words)


def commands_of(block: str) -> list[list[str]]:
    lines = block.replace("\\\n", " ").splitlines()
    words = [shlex.split(line, comments=True) for line in lines]
    return [line for line in words if line and line[0] == "skinlab"]


@pytest.mark.parametrize("page", having("console"))
def test_what_cannot_be_run_here_exists(page):
    for words in [words for block in blocks(page, "console") for words in commands_of(block)]:
        command: click.Command = cli
        for word in words[1:]:
            if isinstance(command, click.Group) and not word.startswith("-"):
                found = command.get_command(click.Context(command), word)
                assert found is not None, words
                command = found
        options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}
        used = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert used <= options, words


@pytest.mark.parametrize("page", having("python"))
def test_python_is_run(page, tmp_path):
    found = blocks(page, "python")
    if page in RUN_BY:
        assert page in (ROOT / RUN_BY[page]).read_text(encoding="utf-8")
    elif page in QUOTED_FROM:
        sources = [path.read_text(encoding="utf-8") for path in ROOT.glob(QUOTED_FROM[page])]
        lines = {line.strip() for text in sources for line in text.splitlines()}
        said = [line.strip() for block in found for line in block.splitlines()]
        assert [line for line in said if line not in lines] == []
    else:
        script = tmp_path / "page.py"
        script.write_text("\n".join(found), encoding="utf-8")
        done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, check=False)
        assert done.returncode == 0


@pytest.mark.docs
@pytest.mark.parametrize("page", [page for page in having("sh") if page != "CONTRIBUTING.md"])
def test_commands_run(page, tmp_path):
    script = "\n".join(block for block in blocks(page, "sh") if not block.startswith("make "))
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / ".venv").symlink_to(sys.prefix)
    programs = str(Path(sys.executable).parent)
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=tmp_path,
        env={
            **os.environ,
            "PATH": f"{programs}:{os.environ['PATH']}",
            "OPENBLAS_NUM_THREADS": "1",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_make_has_what_the_readme_says():
    said = re.findall(r"^make (\w+)", "\n".join(blocks("README.md", "sh")), re.MULTILINE)
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert said == ["run", "test"]
    assert all(re.search(rf"^{name}:", rules, re.MULTILINE) for name in said)


def test_a_plugin_learns_all_that_it_is_shown():
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w.]+)`", "\n".join(re.findall(r"^\| .*$", page, re.MULTILINE))))

    def shown(kind: type) -> set[str]:
        own = {n for n, v in vars(kind).items() if isinstance(v, property | cached_property)}
        return {f.name for f in fields(kind)} | own

    assert shown(CurveSoFar) <= named
    assert {f"samples.{name}" for name in shown(Samples)} <= named
    assert shown(Look) - {"samples"} <= named
