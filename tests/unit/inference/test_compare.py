from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.inference.compare import compare, in_words, overlap, probability_higher
from skinlab.inference.identify import Identifier
from skinlab.inference.result import Identification
from skinlab.inference.samples import choose, group
from skinlab.tables.store import shipped_table

SETUP = Setup(6.0, 1.0, parse_program("ramp:100@20"))


def draws(values, weight=None):
    values = np.asarray(values, dtype=float)
    weight = np.ones(len(values)) if weight is None else np.asarray(weight, dtype=float)
    return values, weight / weight.sum()


def brute(a, b):
    higher = (b[0][None] > a[0][:, None]) + 0.5 * (b[0][None] == a[0][:, None])
    return float(a[1] @ higher @ b[1])


@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(1, 9)), min_size=1, max_size=12),
    st.lists(st.tuples(st.integers(0, 5), st.integers(1, 9)), min_size=1, max_size=12),
)
def test_the_probability_is_that_of_all_pairs(first, second):
    a, b = (draws(*zip(*pairs, strict=True)) for pairs in (first, second))
    assert probability_higher(a, b) == pytest.approx(brute(a, b))
    assert probability_higher(a, b) + probability_higher(b, a) == pytest.approx(1.0)


def test_two_normal_distributions():
    at = norm.ppf((np.arange(20000) + 0.5) / 20000)
    a, b = draws(at), draws(at + 1.0)
    assert probability_higher(a, b) == pytest.approx(norm.cdf(1 / np.sqrt(2)), abs=1e-3)
    assert overlap(a, b) == pytest.approx(2 * norm.cdf(-0.5), abs=0.02)
    assert overlap(a, a) == pytest.approx(1.0)
    assert overlap(a, draws(at + 100)) == 0.0
    assert overlap(draws([1.0]), draws([1.0])) == 1.0


@pytest.fixture(scope="module")
def identifier():
    return Identifier(shipped_table())


def answer(identifier, parameters, seed, noise_mm=0.003):
    time_s = np.arange(101) * 0.05
    blank = Curve("c", SETUP, time_s, 20 * time_s, np.zeros(101))
    model = group([choose(blank, ("load",), identifier.database)])[0].model(
        identifier.database, "paper"
    )
    clean = model.deflection_mm(np.array([parameters]))[0]
    noise = noise_mm * np.random.default_rng(seed).standard_normal(101)
    return identifier(Curve(f"c{seed}", SETUP, time_s, 20 * time_s, clean + noise))


def test_the_same_skin_twice_is_no_change_and_a_stiffer_one_is(identifier):
    before = answer(identifier, (0.025, 2.9, 0.28), 1)
    again = answer(identifier, (0.025, 2.9, 0.28), 2)
    stiffer = answer(identifier, (0.035, 2.9, 0.28), 3)
    same, other = compare(before, again), compare(before, stiffer)
    assert not same.real
    assert other.real
    assert other.p_value < 1e-6
    x1 = other.changes[0]
    assert x1.name == "X1_MPa"
    assert x1.sign == 1
    assert "X1 is higher now" in "\n".join(in_words(other))
    assert compare(stiffer, before).changes[0].sign == -1


@pytest.mark.long
@pytest.mark.parametrize("pairs", [2, 6])
def test_one_skin_is_seldom_called_two(identifier, pairs):
    answers = [answer(identifier, (0.025, 2.9, 0.28), 10 + k) for k in range(2 * pairs)]
    p = [compare(a, b).p_value for a, b in zip(answers[::2], answers[1::2], strict=True)]
    assert min(p) > 1e-4
    assert max(p) > 0.1


def test_without_intervals_there_is_nothing_to_compare(identifier):
    good = answer(identifier, (0.025, 2.9, 0.28), 1)
    with pytest.raises(InputError, match="too few"):
        compare(good, Identification("x", SETUP, "too few samples"))
