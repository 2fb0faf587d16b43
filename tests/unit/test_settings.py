"""Numbers that decide stand in settings, each with a sentence of what it is."""

import ast
import dataclasses
import importlib
from pathlib import Path

import pytest

import skinlab

ROOMS = ("curves", "discrepancy", "inference", "quality", "studies", "tables")


@pytest.mark.parametrize("room", ROOMS)
def test_each_number_has_its_sentence_and_nobody_changes_it(room: str) -> None:
    """A field without a unit or a reason, or one that a caller may set, fails."""
    module = importlib.import_module(f"skinlab.{room}.settings")
    source = (Path(skinlab.__file__).parent / room / "settings.py").read_text()
    for group in (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)):
        for field, after in zip(group.body, [*group.body[1:], ast.Pass()], strict=True):
            if isinstance(field, ast.AnnAssign):
                said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                assert said, f"{room}: {group.name}.{ast.unparse(field.target)}"
        assert ast.get_docstring(group), group.name
        rules = getattr(module, group.name)()
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(rules, dataclasses.fields(rules)[0].name, 0)
