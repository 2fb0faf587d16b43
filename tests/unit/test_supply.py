"""The lock file of the tests: all that pyproject.toml asks for, in its ranges, each with hashes."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]


def asked():
    """Requirements of the package and of its extra `dev`, other extras of ours resolved."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    found, waiting = [], [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    while waiting:
        one = Requirement(waiting.pop())
        if one.name == "skinlab":
            for extra in one.extras:
                waiting += project["optional-dependencies"][extra]
        else:
            found.append(one)
    return found


def locked():
    """Versions by name; every one has a hash."""
    found: dict[str, list[str]] = {}
    text = (ROOT / "requirements-dev.lock").read_text(encoding="utf-8")
    for block in re.split(r"\n(?=[A-Za-z0-9])", text.replace("\\\n", "")):
        match = re.match(r"([\w.-]+)==([\w.+!]+)", block)
        if match is not None:
            assert re.search(r"--hash=sha256:[0-9a-f]{64}", block), match[1]
            found.setdefault(canonicalize_name(match[1]), []).append(match[2])
    return found


def test_the_lock_file_holds_what_is_asked_for():
    versions = locked()
    assert len(versions) > 50
    for one in asked():
        assert versions.get(canonicalize_name(one.name)), one.name
        for version in versions[canonicalize_name(one.name)]:
            assert one.specifier.contains(version, prereleases=True), (one.name, version)
