"""Which plugins a model's law and effects are from: when it was adopted, and here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from skinlab.errors import InputError
from skinlab.mechanics.effects import EFFECTS
from skinlab.mechanics.materials import LAWS
from skinlab.plugins import Origin, warn
from skinlab.versions import missing_plugins, only_plugins, plugin_versions, plugin_words

_ADOPTED = "the model was adopted"
_BUILT = "the table was built"


def plugins_of(law: str, effects: Iterable[str]) -> dict[str, str]:
    """Return the versions of the plugins that a law and effects are from, as records state them."""
    return plugin_versions(_origins(law, effects).values())


def check_installed(
    law: str, effects: Iterable[str], stated: Mapping[str, str], when: str = _ADOPTED
) -> None:
    """Refuse a model whose law or effect is from a plugin that is not installed.

    `stated` are the versions that it was adopted with, or what else was done `when`.

    Raises:
        InputError: names what is missing, and the plugin.
    """
    missing = missing_plugins(stated, when)
    if not missing:
        return
    if law not in LAWS.names():
        raise InputError(f"model.law: law {law!r} is not known: {missing}")
    for name in effects:
        if name not in EFFECTS.names():
            raise InputError(f"effects.{name} is not known: {missing}")


def what_differs(
    law: str, effects: Iterable[str], stated: Mapping[str, str], when: str = _ADOPTED
) -> str:
    """Return in words what may be another law or effect than at adoption; empty: nothing.

    A model that states no plugin says nothing of where its effects are from.
    """
    then = only_plugins(stated)
    if not then:
        return ""
    here = {where: plugin_versions([o]) for where, o in _origins(law, effects).items()}
    left = {k: v for k, v in then.items() if not any(k in now for now in here.values())}
    found = []
    for where, now in here.items():
        for name in now:
            was = {name: then[name]} if name in then else left
            if was and was != now:
                then_, here_ = plugin_words(was), plugin_words(now)
                found.append(f"{where} was of {then_} when {when}, and is of {here_} here")
    if left and not found:
        found.append(f"{when} with {plugin_words(left)}, and nothing of it is of that here")
    what = when.partition(" was ")[0]
    return f"{'; '.join(found)}: what {what} says of it may not hold" if found else ""


def warn_of_table(path: str, law: str, effects: Iterable[str], stated: Mapping[str, str]) -> None:
    """Warn where a table's law or effect is of another state of its plugin than it was built with.

    `stated` are the versions that it was built with: of all plugins that there were.

    Raises:
        InputError: that plugin is not installed; names it.
    """
    effects = tuple(effects)
    check_installed(law, effects, stated, _BUILT)
    own = {k: v for k, v in stated.items() if k in plugins_of(law, effects)}
    if differs := what_differs(law, effects, own, _BUILT):
        warn(f"{path}: {differs}")


def _origins(law: str, effects: Iterable[str]) -> dict[str, Origin | None]:
    found = {f"law {law!r}": LAWS.origin(law)}
    return found | {f"effects.{name}": EFFECTS.origin(name) for name in effects}
