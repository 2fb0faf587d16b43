"""Which software and machine results come from: what can make a replay differ."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from skinlab.plugins import Origin, installed

__version__ = "0.2.0"

_PLUGIN = "plugin "  # begins the names of what is said of distributions with plugins

# Computes nothing: a change here changes no result.
_SCREENS = frozenset({"tui", "cli", "report", "extensions"})


def versions() -> dict[str, str]:
    """Return what a result may depend on, by name; `plugin NAME` for each distribution of them."""
    from importlib.metadata import version  # slow to import

    return {
        "skinlab": __version__,
        **software(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
        "machine": f"{platform.system()} {platform.machine()}",
    }


def software() -> dict[str, str]:
    """Return the state of the source files: `code`, and the plugins."""
    return {"code": code_hash()} | {f"{_PLUGIN}{name}": v for name, v in installed().items()}


def only_plugins(stated: Mapping[str, str]) -> dict[str, str]:
    """Return the part of a record's `versions` that is about plugins."""
    return {name: version for name, version in stated.items() if name.startswith(_PLUGIN)}


def plugin_versions(origins: Iterable[Origin | None]) -> dict[str, str]:
    """Return the part of `versions` about the plugins that extensions are from; None: built in."""
    here = installed()
    return {f"{_PLUGIN}{o.distribution}": here[o.distribution] for o in origins if o is not None}


def plugin_words(stated: Mapping[str, str]) -> str:
    """Return in words which plugins, of which version and with which source files."""
    found = []
    for name, said in only_plugins(stated).items():
        version, _, sources = said.partition(" ")
        found.append(f"{name} {version}" + (f" (source files {sources})" if sources else ""))
    return " and ".join(found)


def missing_plugins(stated: object, what: str = "it was recorded", told: str = "") -> str:
    """Return in words which plugins of a record's `versions` are not installed; empty: none.

    `what` was done with them: how the sentence begins. Those that an error has `told` are left out.
    """
    if not isinstance(stated, dict):
        return ""
    here = installed()
    names = [name.removeprefix(_PLUGIN) for name in stated if str(name).startswith(_PLUGIN)]
    missing = [f"{n} {str(stated[_PLUGIN + n]).partition(' ')[0]}" for n in names if n not in here]
    missing = [one for one in missing if one not in told]
    if not missing:
        return ""
    one = len(missing) == 1
    return (
        f"{what} with the plugin{'' if one else 's'} {', '.join(missing)}, which "
        f"{'is' if one else 'are'} not installed here"
    )


@cache
def code_hash() -> str:
    """Return a hash of the source files that curves and results are computed with."""
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for folder in (package, package.parent / "drivers"):
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.c")]):
            name = path.relative_to(folder.parent)
            if not _SCREENS & set(name.parts):
                digest.update(f"{name.as_posix()} ".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
