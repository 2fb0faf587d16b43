"""Build wheel and sdist, install each into an empty environment, and use it from an empty folder.

    python tests/installed.py            # wheel and sdist, with nothing but what they need
    python tests/installed.py --keep DIR # the same; both stay in DIR, with a bill of materials
    python tests/installed.py --lowest   # the wheel, with the lowest versions that are allowed

Installs with uv where it is there, else with pip.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
GEOMETRY = ("--aperture-mm", "6", "--thickness-mm", "1")
SKIN = ("--x1-mpa", "0.03", "--x2-mpa", "1.0", "--nu", "0.32")


def run(*command: str | Path, cwd: Path, status: int = 0) -> str:
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, capture_output=True, text=True, check=False
    )
    if done.returncode != status:
        sys.exit(f"{' '.join(map(str, command))}: status {done.returncode}\n{done.stderr}")
    return done.stdout + done.stderr


def build(folder: Path) -> tuple[Path, Path]:
    """Return wheel and sdist, made by hatchling in this environment."""
    code = (
        "import sys; from hatchling.build import build_wheel, build_sdist; "
        "print(build_wheel(sys.argv[1])); print(build_sdist(sys.argv[1]))"
    )
    wheel, sdist = run(sys.executable, "-c", code, folder, cwd=ROOT).split()
    return folder / wheel, folder / sdist


def whole(wheel: Path) -> None:
    """Refuse a wheel in which a file of the packages is missing."""
    with zipfile.ZipFile(wheel) as packed:
        there = set(packed.namelist())
    listed = run("git", "ls-files", "skinlab", "drivers", "sim_device", cwd=ROOT).split("\n")
    missing = sorted(set(filter(None, listed)) - there)
    if missing:
        sys.exit(f"{wheel.name} lacks {', '.join(missing)}")


def bill_of_materials(programs: Path, version: str, out: Path) -> None:
    """Write what is installed there, with versions and licences, as CycloneDX."""
    make = Path(sys.executable).with_name("cyclonedx-py")
    environment = ("environment", "--output-reproducible", "--pyproject", ROOT / "pyproject.toml")
    run(make, *environment, "-o", out, programs / "python", cwd=out.parent)
    found = json.loads(out.read_text(encoding="utf-8"))
    found["metadata"]["component"]["version"] = version  # the tool reads none that is dynamic
    out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    names = {_normal(component["name"]) for component in found["components"]}
    with (ROOT / "pyproject.toml").open("rb") as file:
        stated = tomllib.load(file)["project"]["dependencies"]
    missing = {_normal(re.match(r"[\w.-]+", line).group()) for line in stated} - names
    if missing:
        sys.exit(f"{out.name} lacks {', '.join(sorted(missing))}")


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def lowest() -> str:
    """Return constraints that allow of each dependency only the lowest minor version stated."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        stated = tomllib.load(file)["project"]["dependencies"]
    found = []
    for line in stated:
        name, version = re.match(r"([\w.-]+)>=([\d.]+)", line).groups()
        found.append(f"{name}=={'.'.join((version + '.0').split('.')[:2])}.*")
    return "\n".join(found) + "\n"


def environment(folder: Path, package: Path, constraints: str) -> Path:
    """Return the programs of a new environment with the package in it."""
    limits = folder / "constraints.txt"
    limits.write_text(constraints, encoding="utf-8")
    run(sys.executable, "-m", "venv", folder / "env", cwd=folder)
    programs = folder / "env" / "bin"
    uv = shutil.which("uv")
    works = (
        uv and not subprocess.run([uv, "--version"], capture_output=True, check=False).returncode
    )
    if works:
        install = [uv, "pip", "install", "--quiet", "--python", programs / "python"]
    else:
        install = [programs / "python", "-m", "pip", "install", "--quiet"]
    run(*install, "--constraint", limits, package, cwd=folder)
    return programs


def use(programs: Path, folder: Path, version: str) -> None:
    """Do at least once what a bedside machine does, and see what is missing named."""
    skinlab = programs / "skinlab"
    assert version in run(skinlab, "--version", cwd=folder)
    curve = ("--program", "ramp:100@20", "--csv", "curve.csv")
    run(skinlab, "forward", *SKIN, *GEOMETRY, *curve, cwd=folder)
    found = json.loads(run(skinlab, "identify", "curve.csv", *GEOMETRY, "--json", cwd=folder))
    assert abs(found["curves"][0]["parameters"]["X1_MPa"]["value"] - 0.03) < 1e-3
    program = ("--program", "ramp:60@60", "--out", "visit.h5")
    run(skinlab, "measure", "--port", "sim://?seed=1", *GEOMETRY, *program, cwd=folder)
    run(skinlab, "replay", "visit.h5", "--speed", "max", "--verify", cwd=folder)
    run(skinlab, "export", "visit.h5", "--to", "csv", "visit", cwd=folder)
    run(skinlab, "import", "curve.csv", *GEOMETRY, "--out", "imported.h5", cwd=folder)
    run(skinlab, "database", "info", cwd=folder)
    run(programs / "python", "-c", "import skinlab.tui.app", cwd=folder)
    with zipfile.ZipFile(folder / "curve.xlsx", "w") as book:
        book.writestr("xl/workbook.xml", "")
    for command, extra in (
        (("export", "visit.h5", "--to", "html", "page"), "skinlab[pictures]"),
        (
            ("import", "curve.xlsx", *GEOMETRY, *program[:1], "ramp:60@60", "--out", "s.h5"),
            "[excel]",
        ),
    ):
        said = run(skinlab, *command, cwd=folder, status=3)
        assert extra in said, said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lowest", action="store_true")
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="skinlab-installed-") as name:
        top = Path(name)
        wheel, sdist = build(top)
        version = wheel.name.split("-")[1]
        whole(wheel)
        packages = [wheel] if asked.lowest else [wheel, sdist]
        for package in packages:
            folder = top / package.suffix.strip(".")
            folder.mkdir()
            programs = environment(folder, package, lowest() if asked.lowest else "")
            use(programs, folder, version)
            print(f"{package.name}: installed and used")
            if asked.keep is not None:
                asked.keep.mkdir(parents=True, exist_ok=True)
                shutil.copy(package, asked.keep)
                if package is wheel:
                    bill = asked.keep.resolve() / f"skinlab-{version}.cdx.json"
                    bill_of_materials(programs, version, bill)
                    print(f"{bill.name}: all that it stands on")


if __name__ == "__main__":
    main()
