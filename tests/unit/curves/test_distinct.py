"""Which curves are refused because they are there twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.distinct import check_distinct, named_apart
from skinlab.errors import InputError

TIME = 0.1 * np.arange(11)
ONE = Curve("a.csv", Setup(6.0, 1.0), TIME, 100 * TIME, 0.5 * TIME)
OTHER = replace(ONE, name="b.csv", deflection_mm=0.6 * TIME)


def test_the_same_readings_are_refused_under_any_name():
    check_distinct([ONE, OTHER])
    with pytest.raises(
        InputError, match=r"a\.csv: the same readings are given twice; expected each"
    ):
        check_distinct([ONE, OTHER, ONE])
    second = replace(ONE, name="c.csv", setup=replace(ONE.setup, repeat=2))
    with pytest.raises(InputError, match=r"c\.csv: .* also as a\.csv"):
        check_distinct([ONE, OTHER, second])


def test_repeats_of_a_session_may_be_alike_but_are_not_the_same_one():
    first = replace(ONE, segment=np.zeros(11, dtype=np.intp))
    second = replace(first, name="2", setup=replace(ONE.setup, repeat=2))
    check_distinct([first, second])
    with pytest.raises(InputError, match="twice"):
        check_distinct([first, second, first])
    of_a_file = replace(first, source="sha256:0")
    with pytest.raises(InputError, match="twice"):
        check_distinct([of_a_file, replace(of_a_file, setup=second.setup)])


def test_commands_that_explain_curves_together_refuse(tmp_path, capsys):
    path = tmp_path / "a.csv"
    rows = [f"{0.1 * i:.1f},{2 * i},{0.01 * i:.2f}" for i in range(20)]
    path.write_text("\n".join(["time_s,pressure_mbar,deflection_mm", *rows]))
    entry = '[[curve]]\nfile = "a.csv"\naperture_mm = 6.0\nthickness_mm = 1.0\n'
    (tmp_path / "campaign.toml").write_text("[campaign]\n" + entry + entry + "repeat = 2\n")
    geometry = ["--aperture-mm", "6", "--thickness-mm", "1"]
    for command in (
        ["discrepancy", str(tmp_path)],
        ["identify", str(path), str(path), *geometry, "--joint"],
    ):
        assert run(command) == 3
        said = capsys.readouterr().err
        assert "a.csv: the same readings are given twice" in said


def test_curves_of_one_name_are_told_apart():
    """A part of the data is left out by its curve's name, and what is left out is told by it."""
    session = replace(ONE, name="curve 1", campaign="monday.h5")
    other = replace(session, campaign="friday.h5")
    given = [session, other, ONE, OTHER, ONE, replace(ONE, name="a.csv (2)"), ONE]
    assert [curve.name for curve in named_apart(given)] == [
        "monday.h5:curve 1",
        "friday.h5:curve 1",
        "a.csv",
        "b.csv",
        "a.csv (3)",
        "a.csv (2)",
        "a.csv (4)",
    ]
    assert named_apart([session, OTHER]) == (session, OTHER)
