"""What an installed error model returns is checked, by `skinlab plugins check` as well."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from skinlab import plugins
from skinlab.errors import BrokenPluginError
from skinlab.extensions.error_models import _looks, what_it_returns_can_be_computed_with
from skinlab.extensions.rules import broken
from skinlab.inference.covariance import OrnsteinUhlenbeck
from skinlab.inference.error_models import ERROR_MODELS, check_error_model, part_of
from skinlab.inference.error_models.base import Hyperparameter, Part, Terms
from skinlab.inference.error_models.checked import checked_part

LOOK = next(_looks())
COUNT = len(LOOK.samples)
SIZE = Hyperparameter("hum_um", 3.0, 0.7)


class Model:
    name, meaning, prior = "hum", "m", "p"

    def __init__(self, part):
        self.part = lambda look: part(len(look.samples))


def of(terms=lambda count, values: Terms(1e-6 * values[0] ** 2), **own):
    """A model whose parts have these terms of so many samples, and else what is given."""

    def part(count):
        given = {key: make(count) if key == "variances" else make for key, make in own.items()}
        ours = {"name": "hum", "parameters": (SIZE,), "why": "it hums"} | given
        return Part(terms=lambda values: terms(count, values), **ours)

    return Model(part)


def with_columns(**own):
    return of(lambda count, values: Terms(columns_mm=np.ones((count, 1)), **own))


def moving(size_mm, time_s):
    return of(lambda count, values: Terms(ou=OrnsteinUhlenbeck(size_mm, time_s)))


def stretched(value):
    return of(lambda count, values: Terms(stretch=np.full(count, value)))


def called(*names):
    return of(parameters=tuple(replace(SIZE, name=name) for name in names))


def prior(**own):
    return of(parameters=(replace(SIZE, **own),))


def first(variance_mm2):
    return of(variances=lambda count: lambda values: np.full((len(values), count), variance_mm2))


@pytest.fixture
def installed(monkeypatch):
    """Take a model for one of the package `works`."""

    def install(model):
        monkeypatch.setitem(ERROR_MODELS._all(), model.name, model)
        monkeypatch.setitem(ERROR_MODELS._origins, model.name, plugins.Origin("works", "1.0"))
        monkeypatch.setattr(plugins, "_said", set())
        return model

    return install


BAD = {
    "process": (moving(math.nan, 1.0), "size_mm of ou is nan; expected a finite number"),
    "time": (moving(1e-3, -1.0), "time_s of ou is -1.0; expected more than 0"),
    "a pair": (of(lambda n, v: Terms(ou=(1, 1))), "ou is a tuple; expected an OrnsteinUhlenbeck"),
    "sizes": (with_columns(sizes=np.array([np.nan])), "sizes is not finite"),
    "as many": (with_columns(sizes=np.ones(3)), "sizes has the shape (3,); expected (1,)"),
    "a row": (
        of(lambda n, v: Terms(columns_mm=np.ones(n))),
        f"has the shape ({COUNT},); expected ({COUNT}, m)",
    ),
    "turned": (
        of(lambda n, v: Terms(columns_mm=np.ones((2, n)))),
        f"(2, {COUNT}); expected ({COUNT}, m)",
    ),
    "none stated": (of(stated=None), "its stated is a NoneType; expected a mapping"),
    "one prior": (of(parameters=SIZE), "its parameters is a Hyperparameter; expected a tuple"),
    "text": (of(lambda n, v: Terms("a")), "variance_mm2 is of the type <U1; expected numbers"),
    "flat": (stretched(0.0), "stretch is not above 0"),
    "below": (stretched(-1.0), "stretch is not above 0"),
    "variances": (first(-1.0), "variances are below 0"),
    "others": (first(1.0), "its variances are not those of its terms"),
    "stated": (of(stated={"hum_hz": "text"}), "its hum_hz is 'text'; expected a finite number"),
    "size": (of(size_um=lambda values: math.nan), "size_um is nan; expected a finite number"),
    "width": (prior(log_sd=math.inf), "the prior of hum_um: log_sd is inf; expected a finite n"),
    "wide": (prior(log_sd=1e3), "the prior of hum_um: log_sd is 1000.0; expected more than 0, at"),
    "median": (prior(median=0.0), "the prior of hum_um: median is 0.0; expected more than 0"),
    "share": (prior(absent=1.0), "the prior of hum_um: absent is 1.0; expected a share below 1"),
    "odds": (of(log_odds=None), "log_odds is None; expected a finite number"),
    "white": (called("white_um"), "its parameter white_um is called as those of white are; exp"),
    "freedom": (of(stated={"freedom": 3.0}), "its parameter freedom is called as those of heavy"),
    "twice": (called("a_um", "a_um"), "two of its parameters have one name: a_um, a_um"),
    "ou": (of(name="ou"), "its part is called 'ou'; expected 'hum'"),
    "mixture": (
        of(lambda n, v: Terms(), parameters=(), again=lambda square: None),
        "it is a scale mixture without a stretch; expected one",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_computed_with_is_left_out_and_named(case, installed, capsys):
    model, why = BAD[case]
    assert part_of(installed(model), LOOK) is None
    said = capsys.readouterr().err
    assert said.startswith(
        "skinlab: plugin works, error model 'hum': broke down, and is left out: "
    )
    assert why in said
    assert said.count("\n") == 1
    assert why in broken(what_it_returns_can_be_computed_with, model)


LATER = {
    "negative": (lambda n, v: Terms(4.0 - v[0]), "variance_mm2 is below 0"),
    "process": (
        lambda n, v: Terms(ou=OrnsteinUhlenbeck(1e-3, 4.0 - v[0])),
        "time_s of ou is -1.0; expected more than 0",
    ),
    "columns": (
        lambda n, v: Terms(columns_mm=np.ones((n, 1 + int(v[0] > 4.0)))),
        f"its terms have the shapes {{'variance_mm2': (), 'columns_mm': ({COUNT}, 2)}} at [5.0]; ",
    ),
}


@pytest.mark.parametrize("case", LATER)
def test_what_goes_wrong_at_another_size_names_the_model(case, installed):
    terms, why = LATER[case]
    part = part_of(installed(of(terms)), LOOK)
    part.terms([3.0])
    with pytest.raises(BrokenPluginError, match="plugin works, error model 'hum': broke ") as told:
        part.terms([5.0])
    assert why in str(told.value)


def test_a_scale_mixture_is_checked_and_named_each_time(installed):
    def mixture(stretch):
        return Part(
            "hum", (), lambda values: Terms(stretch=np.full(COUNT, stretch)), why="tails",
            again=lambda square: mixture(float(square[0])),
        )  # fmt: skip

    part = part_of(installed(Model(lambda count: mixture(1.0))), LOOK).again(np.full(COUNT, 2.0))
    assert part.terms(()).stretch[0] == 2.0
    with pytest.raises(BrokenPluginError, match=r"error model 'hum': .* stretch is not above 0"):
        part.again(np.full(COUNT, -1.0))


@pytest.mark.parametrize("model", ERROR_MODELS.all(), ids=lambda model: model.name)
def test_what_is_right_is_returned_as_it_was(model):
    for look in _looks():
        if (part := model.part(look)) is None:
            continue
        checked = checked_part(model.name, part, len(look.samples))
        assert (checked.parameters, checked.stated) == (part.parameters, part.stated)
        values = [1.3 * p.median for p in part.parameters]
        one, other = checked.terms(values), part.terms(values)
        assert one.ou == other.ou
        for name in ("variance_mm2", "columns_mm", "sizes", "stretch"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        if part.variances is not None:
            each = np.array([values, values])
            np.testing.assert_array_equal(checked.variances(each), part.variances(each))
        if part.size_um is not None:
            assert checked.size_um(values) == part.size_um(values)


def test_names_of_ones_own_and_plain_ones_are_taken(installed):
    for names in (("hum_um", "hum_hz"), ("a_um",), ("whites_um",)):
        assert part_of(installed(called(*names)), LOOK) is not None


def test_what_a_model_changes_in_place_is_its_own(installed):
    def in_place(look):
        look.residual_mm[:] = look.samples.time_s[:] = 0.0

        def terms(values):
            values[0] *= 1e-3
            return Terms(values[0] ** 2)

        return Part("hum", (SIZE,), terms, why="it hums")

    model = of()
    model.part = in_place
    residual, time, values = LOOK.residual_mm.copy(), LOOK.samples.time_s.copy(), [3.0]
    part = part_of(installed(model), LOOK)
    assert part.terms(values).variance_mm2 == pytest.approx(9e-6)
    assert values == [3.0]
    assert np.array_equal(LOOK.residual_mm, residual)
    assert np.array_equal(LOOK.samples.time_s, time)


def test_a_why_has_its_own_parameters_in_braces():
    """What is none of them is told in braces to who reads the result."""
    assert broken(what_it_returns_can_be_computed_with, of(why="of {hum_um} µm")) is None
    told = broken(what_it_returns_can_be_computed_with, of(why="of {hum} µm"))
    assert told == "its why has hum in braces; expected parameters"


def test_a_name_that_would_be_two_is_refused():
    model = of()
    model.name = "hum+ou"
    with pytest.raises(TypeError, match=r"its name has a \+ in it"):
        check_error_model(model)
