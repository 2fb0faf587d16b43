"""The example is what its script makes."""

import importlib.util
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_example_with_a_missing_effect_can_be_made_again(tmp_path, monkeypatch):
    file = EXAMPLES / "make_missing_effect.py"
    spec = importlib.util.spec_from_file_location("make_missing_effect", file)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    monkeypatch.setattr(script, "FOLDER", tmp_path)
    script.main()
    kept = EXAMPLES / "missing_effect"
    assert (tmp_path / "campaign.toml").read_text() == (kept / "campaign.toml").read_text()
    for name, _, _ in script.CURVES:
        new, old = (np.loadtxt(d / name, delimiter=",", skiprows=1) for d in (tmp_path, kept))
        np.testing.assert_allclose(new, old, rtol=0, atol=0.0011)  # a last digit
