"""What is concluded from fits: whether they are adequate, what is missing, what to measure next."""

from dataclasses import make_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_effects import RAMPS, SKIN, TRUE, fitter_of, learned, measured

from drivers.limits import DEFAULT_DOSE_MBAR_S
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy import heldout, pair_search, workflow
from skinlab.discrepancy import search as search_module
from skinlab.discrepancy.adequacy import Residual, judge, look
from skinlab.discrepancy.campaign_errors import CampaignErrors, Linearised
from skinlab.discrepancy.candidates import Candidate, Found, may_still_win, with_members
from skinlab.discrepancy.discipline import Trial
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.heldout import HeldOut, conditions_of, predict_held_out
from skinlab.discrepancy.misfit import errors_of, mesh_columns
from skinlab.discrepancy.next_measurement import (
    Plan,
    Planned,
    _bearable,
    _Look,
    _looks,
    _most_telling,
    _Odds,
    advise,
)
from skinlab.discrepancy.pair_search import PairSearch, beside_which, leading
from skinlab.discrepancy.planned_curve import (
    PlannedCurve,
    PlannedErrors,
    menu,
    planned_record,
    rig_lag_s,
)
from skinlab.discrepancy.records import records_of, without
from skinlab.discrepancy.screen import LinearPair
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import ERRORS, NAMES, PLANS, SEARCH
from skinlab.discrepancy.space_mapping import MappedModel
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.text import in_all_words
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.discrepancy.verdict import (
    Verdict,
    decide,
    decide_learned,
    disciplined,
    may_be_chance,
    outdone_by_names,
    tied_kinds,
)
from skinlab.mechanics.effects import all_effects, get_effect
from skinlab.mechanics.effects.model import felt_path, solve_skin
from skinlab.mechanics.fem.skin import SkinProblem
from skinlab.mechanics.fem.suction import Geometry


@pytest.fixture(scope="module")
def looks(table):
    """Return p-values of white noise on known deflections, and the fitter."""
    fitter = fitter_of(measured({}, RAMPS, noise_um=2.0), table)
    zero = [r.curve.deflection_mm for r in fitter.records]
    rng = np.random.default_rng(5)
    found = []
    for _ in range(400):
        noise = fitter.errors.split(rng.normal(size=fitter.errors.count) * fitter.errors.sigma_mm)
        off = [w + n for w, n in zip(zero, noise, strict=True)]
        found.append(look(fitter.records, fitter.errors, off, 0).p_value)
    return fitter, np.array(found)


def test_p_values_of_white_noise_are_no_smaller_than_uniform(looks):
    _, p = looks
    for level in (0.05, 0.2, 0.5):
        spread = np.sqrt(level * (1 - level) / len(p))
        assert np.mean(p < level) < level + 4 * spread
    # Not blunt either: the mesh's share, taken off, two tests, and a correlation of 0.02 that
    # counts as none cost some of it.
    assert np.mean(p < 0.5) > 0.05


def test_structure_is_seen_and_said_where(looks):
    fitter, _ = looks
    zero = [r.curve.deflection_mm for r in fitter.records]
    rng = np.random.default_rng(6)
    noise = fitter.errors.split(rng.normal(size=fitter.errors.count) * fitter.errors.sigma_mm)
    off = [w + n for w, n in zip(zero, noise, strict=True)]
    unload = fitter.records[0].curve.phase == "unload"
    off[0] = off[0] - 0.006 * unload  # the model is 6 µm too low there
    left = look(fitter.records, fitter.errors, off, 0)
    assert left.p_value < 1e-6
    place = left.places[0]
    assert (place.file, place.phase) == ("c0", "unload")
    assert place.mean_um == pytest.approx(6.0, abs=1.5)
    assert place.p_value < 1e-3
    others = [p for p in left.places if p.file == "c2"]
    assert min(p.p_value for p in others) > 1e-3


def test_each_setting_of_the_errors_is_looked_at_from_its_own_optimum(table):
    """A fit by errors that may be any stiffness ends anywhere: no structure to errors of none."""
    fitter = fitter_of(measured({}, RAMPS, noise_um=2.0), table)
    unknowns = Unknowns(())
    model = fitter.model(unknowns)
    u = unknowns.space.coordinates(np.array([SKIN.values]))[0]
    u[unknowns.space.scale] += 0.03
    jacobian = fitter.jacobian(model, u)
    softer_mm = fitter.errors.colour(jacobian)[:, [unknowns.space.scale]]
    wide = replace(fitter.errors, shapes_mm=np.hstack([fitter.errors.columns_mm, 10.0 * softer_mm]))
    fit = Fit(unknowns, u, model.predict(u), 0.0, 0.0, jacobian, settled=True, corrected=False)
    fit = fit.with_errors(fitter.errors, wide)
    narrow = [(fitter.errors, 1.0)]
    assert look(fitter.records, fitter.errors, fit.deflections_mm, 3).p_value < 1e-9
    assert judge(fitter.records, narrow, fit, wide).p_value > 0.05
    # What no parameter takes up stays.
    up = [0.006 * (r.curve.phase == "unload") for r in fitter.records]
    off = replace(fit, deflections_mm=[w + e for w, e in zip(fit.deflections_mm, up, strict=True)])
    assert judge(fitter.records, narrow, off, wide).p_value < 1e-9


@pytest.fixture(scope="module")
def repeats(table):
    """Return a fitter of each ramp measured three times, and its curves without noise."""
    fitter = fitter_of(measured({}, RAMPS * 3, noise_um=2.0), table)
    return fitter, [r.curve.deflection_mm for r in fitter.records]


def judged(fitter, zero, phases, rng):
    """Return p values (as judged, by the errors alone) of noise and a breath of 0.6 µm."""
    noise = fitter.errors.split(rng.normal(size=fitter.errors.count) * fitter.errors.sigma_mm)
    off = [
        w + n + 6e-4 * np.sin(2 * np.pi * 0.5 * record.curve.time_s + phase)
        for w, n, record, phase in zip(zero, noise, fitter.records, phases, strict=True)
    ]
    left = look(fitter.records, fitter.errors, off, 0)
    return left.p_value, left.by_errors


def test_what_each_repeat_has_for_itself_is_no_fault_of_the_model(repeats):
    fitter, zero = repeats
    rng = np.random.default_rng(8)
    p, by_errors = np.array(
        [judged(fitter, zero, rng.uniform(0, 6, len(zero)), rng) for _ in range(60)]
    ).T
    assert np.mean(by_errors < ERRORS.adequate) > 0.2
    level, decided = 0.05, by_errors >= ERRORS.hardly
    assert np.mean(p[decided] < level) < level + 4 * np.sqrt(level / 60)
    assert (p[~decided] == by_errors[~decided]).all()


def test_what_repeats_have_in_common_stays_its_fault(repeats):
    fitter, zero = repeats
    rng = np.random.default_rng(8)
    p, by_errors = np.array(
        [judged(fitter, zero, np.tile(rng.uniform(0, 6, len(RAMPS)), 3), rng) for _ in range(60)]
    ).T
    assert np.mean(p < 0.05) > 0.35
    assert (p >= by_errors).all()


def test_a_repeat_that_was_cut_short_excuses_nothing(repeats):
    """What it read last is no error of all that the others read after it."""
    fitter, zero = repeats
    cut = len(RAMPS)
    long = [np.arange(len(w)) < (20 if i == cut else len(w)) for i, w in enumerate(zero)]
    records = without(fitter.records, long)
    errors = errors_of(records)
    rng = np.random.default_rng(8)
    seen = []
    for _ in range(40):
        noise = errors.split(rng.normal(size=errors.count) * errors.sigma_mm)
        phases = np.tile(rng.uniform(0, 6, len(RAMPS)), 3)
        off = [
            w[kept] + n + 6e-4 * np.sin(2 * np.pi * 0.5 * record.curve.time_s + phase)
            for w, kept, n, record, phase in zip(zero, long, noise, records, phases, strict=True)
        ]
        each = []
        for last_mm in (0.0, 8e-3):
            off[cut][-1] += last_mm
            each.append(look(records, errors, off, 0).p_value)
        seen.append(each)
    plain, ends_badly = np.array(seen).T
    assert np.mean(plain < 0.05) > 0.35
    assert np.mean(ends_badly < 0.05) > 0.9 * np.mean(plain < 0.05)


def test_without_repeats_nothing_says_whose_fault_it_is(looks):
    fitter, _ = looks
    zero = [r.curve.deflection_mm for r in fitter.records]
    rng = np.random.default_rng(8)
    for _ in range(20):
        p, by_errors = judged(fitter, zero, rng.uniform(0, 6, len(zero)), rng)
        assert p == by_errors


# ---- the verdict, on made-up candidates ----------------------------------------------------------


def candidate(effects, evidence, p_value=0.5):
    unknowns = Unknowns(tuple(effects))
    k = len(unknowns)
    fit = Fit(unknowns, np.zeros(k), [], 0.0, 0.0, np.zeros((1, k)), settled=True, corrected=False)
    return Candidate(fit, Residual(p_value, (), p_value), evidence)


def verdict(base_p, *candidates, plan=RAMPS):
    ranked = sorted(candidates, key=lambda c: -c.log10_evidence)
    records = records_of(measured({}, plan))
    found = decide(Found(candidate((), 0.0, base_p), {}, ranked, records))
    return found.name, [set(c.effects) for c in found.explanations]


GOOD, BAD = 0.5, 1e-2 * ERRORS.adequate
LAG, GAIN, SLIP = ("pressure_lag",), ("deflection_gain",), ("tape_slip",)


def test_without_a_gap_nothing_is_missing():
    assert verdict(GOOD) == ("none", [])
    assert verdict(GOOD, candidate(LAG, 1.0)) == ("none", [])
    assert verdict(GOOD, candidate(LAG, -1.0), candidate(GAIN, 1.2)) == ("none", [])


def test_one_explanation_that_is_ahead_is_named():
    assert verdict(BAD, candidate(LAG, 20.0), candidate(GAIN, 18.0)) == ("named", [{*LAG}])
    # Even where the gap alone would not have been remarkable.
    assert verdict(GOOD, candidate(LAG, 3.0), candidate(GAIN, 0.5)) == ("named", [{*LAG}])


@pytest.mark.parametrize(
    ("failed", "left"), [((), "named"), (("size",), "none"), (("size", "again"), "unknown")]
)
def test_what_is_there_and_too_small_to_matter_is_nothing(failed, left):
    found = Found(candidate((), 0.0, BAD), {}, [candidate(LAG, 9.0)])
    stood = [Trial(name, name not in failed, "") for name in ("size", "again")]
    assert disciplined(Verdict("named", found.candidates), found, stood).name == left


@pytest.mark.parametrize(
    ("behind", "found"), [(2.0, ("ambiguous", [{*LAG}, {*GAIN}])), (1e3, ("named", [{*LAG}]))]
)
def test_a_hair_of_what_is_left_makes_no_name(behind, found):
    """Where one of two that are tied may just be noise, and the other just not, both are told."""
    just = 1.2 * ERRORS.adequate
    made = verdict(BAD, candidate(LAG, 20.0, just), candidate(GAIN, 19.0, just / behind))
    assert made == found


@pytest.mark.parametrize(
    ("ahead", "left", "told"),
    [
        (-0.5, 0.4, ("ambiguous", [{*GAIN}, {*LAG}])), (0.5, 0.4, ("named", [{*LAG, *SLIP}])),
        (-0.5, 1e-4, ("named", [{*LAG, *SLIP}])),
    ],
)  # fmt: skip
def test_what_a_second_effect_makes_likelier_in_its_residual_alone_is_not_out(ahead, left, told):
    """A lag left 0.4 of what may be noise, with a pulse beside it enough; of the two no data told.

    What is as likely as that lag, and leaves as much, is told as well.
    """
    just = left * ERRORS.adequate
    made = verdict(
        BAD, candidate((*LAG, *SLIP), 20.0 + ahead), candidate(LAG, 20.0, just),
        candidate(GAIN, 20.4, 1.1 * just),
    )  # fmt: skip
    assert made == told


def test_what_all_that_are_tied_have_is_said():
    pairs = [(*LAG, *SLIP), (*LAG, *GAIN)]
    assert in_all_words(pairs) == f" All of them have {LAG[0]}."
    assert in_all_words([*pairs, GAIN]) == ""
    assert in_all_words(pairs, own=LAG) == ""


def test_a_tie_names_everything_that_is_tied():
    found = verdict(BAD, candidate(LAG, 20.0), candidate(GAIN, 19.0), candidate(SLIP, 18.0))
    assert found == ("ambiguous", [{*LAG}, {*GAIN}])


def test_what_explains_alone_is_fitted_again_with_the_pair_that_leads():
    """Its fit by wide errors may have ended elsewhere in a valley, far behind the pair's."""
    alone, worse = candidate(LAG, 1033.0), candidate(GAIN, 40.0, p_value=1e-9)
    pair, other = candidate((*LAG, *GAIN), 1050.0), candidate(SLIP, 1049.0)
    every = [pair, other, alone, worse]
    leading = may_still_win(every)
    assert leading == [pair, other]
    assert with_members(leading, every) == [pair, other, alone]
    assert with_members([alone, pair], every) == [alone, pair]


@pytest.mark.parametrize(("gain", "asked"), [(0.9, False), (1.1, True)])
def test_the_best_with_another_effect_may_win_where_it_gains_much(gain, asked):
    """Errors as the best alone needs them may be what the second effect does."""
    alone, pair = candidate(LAG, 215.2), candidate((*LAG, *SLIP), 214.3)

    def gains(one, best):
        assert (one, best) == (pair, alone)
        return gain * SEARCH.behind

    assert may_still_win([pair, alone]) == [alone]
    assert may_still_win([pair, alone], gains) == ([alone, pair] if asked else [alone])


@pytest.mark.parametrize(
    ("p_value", "gap_um", "named", "learned", "chance"),
    [
        (1e-4, 3.0, 0.5, 0.5, True),
        (1e-7, 3.0, 0.5, 0.5, False),  # no chance does that
        (1e-4, 3.4, 0.5, 0.5, False),  # what was left out is 1.6 µm further off than expected
        (1e-4, 3.0, 1.5, 0.5, False),  # an effect is likelier, though it leaves more than noise
        (1e-4, 3.0, 0.5, 1.5, False),  # or a function, which is not told from another kind
    ],
)
def test_what_nothing_explains_and_predicts_as_expected_may_be_chance(
    p_value, gap_um, named, learned, chance
):
    base = candidate((), 0.0, p_value)
    found = Found(base, {}, [candidate(LAG, named, p_value)], [])
    kinds = Found(base, {}, [candidate(("learned_creep",), learned, p_value)], [])
    left = HeldOut(gap_um, 2.9, 3.0, ("a.csv",), gap_um)
    assert may_be_chance(found, kinds, left) is chance
    assert not may_be_chance(replace(found, implausible="too large"), kinds, left)
    assert not may_be_chance(found, kinds, replace(left, files=()))  # nothing was left out


@pytest.mark.parametrize(
    ("gap_um", "files", "asked"),
    [(2.99, ("a.csv",), False), (3.05, ("a.csv",), True), (2.99, (), True)],
)
def test_without_a_gap_no_function_is_asked_for(monkeypatch, gap_um, files, asked):
    """Where meshes differ beyond a crease, a pressure channel was bent: by 3.6 mbar, 10⁶ : 1."""
    base = candidate((), 0.0, 0.08)
    found = Found(base, {}, [], [])
    left = HeldOut(gap_um, 2.9, 3.0, files, gap_um)
    tried = workflow._Tried(Verdict("none", []), found, None, None, left, {})
    families = []

    def find_families(search, found, least):
        families.append(least)
        return found

    monkeypatch.setattr(workflow, "find_families", find_families)
    search = SimpleNamespace(errors=None)
    told, _ = workflow._or_a_kind(search, tried, found, lambda _: None)
    assert told is tried
    assert families == [NAMES.unasked] * asked


@pytest.mark.parametrize(
    ("left", "behind", "outdone"),
    [(BAD, 65.0, True), (BAD, 1.0, False), (GOOD, 65.0, False)],
)
def test_what_is_learned_and_leaves_more_gives_way_to_names_that_do_not(left, behind, outdone):
    learned = Verdict("learned", [candidate(("learned_creep",), 81.0, left)])
    named = [candidate((*LAG, *SLIP), 81.0 + behind), candidate(GAIN, 200.0, BAD)]
    assert outdone_by_names(learned, named) is outdone


@pytest.mark.parametrize(("ahead", "outdone"), [(1.0, False), (3.0, True)])
def test_what_is_learned_gives_way_to_a_single_effect_that_leads_and_failed_a_trial(ahead, outdone):
    """A layer that was 13 and not 20 times likelier without a condition was told as an opening."""
    learned = Verdict("learned", [candidate(("learned_opening",), 8.7)])
    assert outdone_by_names(learned, [candidate(SLIP, 8.7 + ahead)]) is outdone


@pytest.mark.parametrize(
    ("kind", "name", "ahead", "outdone"),
    [
        ("learned_pressure_bow", "sensor_curve", 1.0, True),
        ("learned_pressure_bow", "sensor_curve", 1.5, False),
        ("learned_sensor_curve", "sensor_curve", 1.0, False),  # the name is a form of that kind
    ],
)
def test_a_function_is_learned_where_it_leads_the_name_that_it_took_the_place_of(
    kind, name, ahead, outdone
):
    learned = Verdict("learned", [candidate((kind,), 10.0 + ahead)])
    stood = candidate((name,), 10.0)
    assert outdone_by_names(learned, [stood], stood) is outdone
    assert outdone_by_names(learned, [stood], None) is False


def test_functions_of_one_kind_are_one_answer():
    """The next one is tried where the first does not stand its trials."""
    bow, curve = (candidate((f"learned_pressure_{n}",), e) for n, e in (("bow", 9), ("curve", 8.5)))
    frame = candidate(("learned_frame",), 7.0)
    base = candidate((), 0.0, BAD)
    found = SimpleNamespace(
        candidates=[bow, curve, frame], base=base, tie=1.3, errors=SimpleNamespace(count=1)
    )
    verdict = decide_learned(found)
    assert verdict.explanations == [bow, curve]
    assert verdict.without(0).explanations == [bow]
    assert (verdict.without(1).name, verdict.without(1).explanations) == ("learned", [curve])


def test_kinds_of_functions_that_do_equally_well_are_told():
    """Nothing was said of them: as if none had explained anything."""
    ones = [candidate((f"learned_{n}",), e) for n, e in (("frame", 9), ("time", 8.5), ("law", 7.0))]
    base = candidate((), 0.0, BAD)
    found = SimpleNamespace(
        candidates=ones, base=base, tie=1.3, errors=SimpleNamespace(count=1), implausible=""
    )
    assert decide_learned(found).name == "unknown"
    assert tied_kinds(found) == ("frame", "time")
    assert tied_kinds(SimpleNamespace(**{**vars(found), "candidates": ones[1:]})) == ()
    assert tied_kinds(SimpleNamespace(**{**vars(found), "candidates": []})) == ()


def test_less_than_a_period_is_no_motion():
    """A zero that went with the square of time was a motion of 0.05 Hz beside a drift."""
    one = get_effect("periodic_motion")
    values = {"amplitude_um": 20.0, "frequency_hz": 0.05}
    assert one.unseen(values, 10.5) == "a period of 20 s is longer than any curve (10 s)"
    assert one.unseen(values, 20.0) == ""
    assert all(e.unseen(e.typical, 0.0) == "" for e in all_effects() if e is not one)


def test_where_nothing_fits_it_is_unknown():
    assert verdict(BAD) == ("unknown", [])
    assert verdict(BAD, candidate(LAG, 50.0, BAD)) == ("unknown", [])


def test_what_does_not_fit_is_no_explanation():
    found = verdict(BAD, candidate(LAG, 20.0, BAD), candidate(GAIN, 19.5))
    assert found == ("named", [{*GAIN}])


def test_what_is_outdone_by_what_does_not_fit_is_no_name():
    found = verdict(BAD, candidate(LAG, 22.0, BAD), candidate(GAIN, 19.5))
    assert found == ("unknown", [])
    both = (*LAG, *GAIN)
    found = verdict(BAD, candidate(LAG, 22.0, BAD), candidate(GAIN, 19.5), candidate(both, 24.0))
    assert found == ("named", [{*both}])


# ---- where a search goes on, on made-up candidates -----------------------------------------------


@pytest.mark.parametrize(("p_value", "enough"), [(0.5, True), (0.02, False)])
def test_a_single_effect_that_chance_hardly_leaves_so_is_not_enough(p_value, enough):
    """A bent sensor left 0.002 of what may be noise; a preload and a stiffening were there."""
    pairs = PairSearch(SimpleNamespace(own=()), None)
    singles = [candidate(LAG, 20.0, p_value), candidate(SLIP, 1.0)]
    assert pairs.one_is_enough([*singles, candidate((*LAG, *GAIN), 21.0)]) is enough
    # An effect with a number for each opening that leads asks for pairs, whatever it leaves.
    flexible = candidate(("aperture_error",), 23.0, p_value)
    assert not pairs.one_is_enough([*singles, flexible])


def test_what_fits_best_gets_partners_however_unlikely_it_is_alone():
    """A layer, which was right, was 10^70 less likely by errors that the bare model needs."""
    screened = []

    def screen(fit, names, errors=None):
        screened.append(fit.effects)
        return {}, {}

    def of(effects, evidence, cost):
        made = candidate(effects, evidence, BAD)
        return replace(made, fit=replace(made.fit, cost=cost))

    search = SimpleNamespace(own=(), library=[*LAG, *GAIN, *SLIP], looks=[], progress=lambda _: 0)
    pairs = PairSearch(search, SimpleNamespace(screen=screen, held=lambda fit: []))
    layer = ("surface_layer",)
    singles = [of(LAG, -8.0, 1e4), of(layer, -70.0, 3800.0), of(GAIN, -10.0, 4600.0)]
    assert pairs.beside(singles, 2, SEARCH.seen) == []
    assert screened == [LAG, GAIN, layer]


def test_partners_are_looked_for_beside_what_explains_and_the_likeliest_that_does_not():
    """A thickness left more than noise, as likely as a layer that explains: it was one of two."""
    layer, lag, gain = (
        candidate(n, e) for n, e in ((("surface_layer",), 11.1), (LAG, 9.0), (GAIN, 8.0))
    )
    thickness = candidate(("thickness_error",), 10.9, BAD)
    below, far = (
        candidate(("hypodermis",), 10.7, BAD),
        candidate(SLIP, 11.1 - SEARCH.not_enough, BAD),
    )
    found = beside_which([gain, below, lag, thickness, layer, far], 11.1)
    assert found == [layer, lag, thickness]
    assert beside_which([layer, far], 11.1) == [layer]
    # What fits best gets one too, however many are likelier.
    worse = [replace(c, fit=replace(c.fit, cost=9.0)) for c in (layer, lag)]
    assert beside_which([*worse, gain], 11.1) == [*worse, gain]


def test_what_explains_gets_a_partner_however_unlikely_it_is():
    """Of a slip beside a stiffening the slip alone explained, ten decades behind a sensor."""
    sensor, slip = candidate(("sensor_curve",), 13.7), candidate(SLIP, 3.7)
    unlikelier = candidate(LAG, 1.0)
    leaving = [
        candidate((name,), 9.0 - k, BAD)
        for k, name in enumerate(("contact_preload", "natural_tension", "hypodermis"))
    ]
    nearest = candidate(("aperture_error",), -5.0, BAD)
    nearest = replace(nearest, fit=replace(nearest.fit, cost=nearest.fit.cost - 50.0))
    every = [unlikelier, slip, nearest, *leaving, sensor]
    assert leading(every, 4) == [sensor, *leaving, nearest, slip]
    assert leading([slip, sensor], 4) == [sensor, slip]


def test_beside_a_law_at_its_end_partners_are_seen_from_the_middle_of_its_range(monkeypatch):
    """Beside a creep at ν 0.498 a stiffening promised 3 and a gain 88; at 0.25 it promised most."""
    creep = candidate(LAG, 9.0, BAD)
    creep = replace(creep, fit=replace(creep.fit, cost=2370.0))
    held = replace(creep.fit, cost=2419.0)
    stiffening = "strain_stiffening"
    gains = {creep.fit: {GAIN[0]: 88.0, stiffening: 3.0}, held: {GAIN[0]: 193.0, stiffening: 260.0}}

    def screen(fit, names, errors=None):
        return {n: SimpleNamespace(effect=n, gain=gains[fit][n]) for n in names}, {}

    search = SimpleNamespace(
        own=(), library=[*LAG, *GAIN, stiffening], looks=[], progress=lambda _: 0
    )
    fitted = []
    race = SimpleNamespace(
        screen=screen, held=lambda fit: [held], run=lambda tasks, _: fitted.extend(tasks) or []
    )
    PairSearch(search, race).beside([creep], 1, SEARCH.seen)
    assert [(fit, seen.effect) for fit, seen in fitted] == [(held, stiffening), (held, GAIN[0])]
    # What promises more where the fit is, is begun there; and next to nothing is not fitted.
    gains[held] = {GAIN[0]: 130.0, stiffening: 50.0}
    fitted.clear()
    PairSearch(search, race).beside([creep], 1, SEARCH.seen)
    assert [(fit, seen.effect) for fit, seen in fitted] == [(creep.fit, GAIN[0])]


def test_beside_a_fit_each_partner_is_screened_once():
    lag, asked = candidate(LAG, 9.0, BAD), []

    def screen(fit, names, errors=None):
        asked.append(list(names))
        # No model of the slip's holds beside it.
        return {n: SimpleNamespace(effect=n, gain=50.0) for n in names if n not in SLIP}, {}

    search = SimpleNamespace(own=(), library=[], looks=[], progress=lambda _: 0)
    pairs = PairSearch(search, SimpleNamespace(screen=screen, held=lambda fit: []))
    for library in ([*GAIN, *SLIP], [*GAIN, *SLIP], [*SLIP, "strain_stiffening"]):
        found = pairs._partners(library, lag)
        assert [s.effect for _, s in found] == [n for n in library if n not in SLIP]
    assert asked == [[*GAIN, *SLIP], ["strain_stiffening"]]
    # By the errors that it needs, once these are known, they may promise something else.
    search.looks.append((lag.fit, SimpleNamespace(mode=SimpleNamespace(count=0))))
    search.linear = lambda fit: SimpleNamespace(beside=lambda columns: None)
    search.gains_by_its_own_errors = lambda fit, others: []
    asked.clear()
    assert pairs._partners(SLIP, lag) == []
    assert asked == [[*SLIP], [*SLIP]]


@pytest.mark.parametrize(
    ("ahead", "rise", "tried"),
    [(NAMES.tie + 1.0, 900.0, True), (NAMES.tie - 1.0, 300.0, True), (0.0, 900.0, False)],
)
def test_what_a_range_s_end_hides_is_fitted(ahead, rise, tried):
    """A stiffening passed for a skin of nu 0.495, where it promised 2: a gain was named.

    Where nothing leads it has to take up a quarter of what holding the skin off that end costs.
    """
    gain, held = candidate(GAIN, ahead), replace(candidate((), 0.0).fit, cost=rise)
    asked, fitted = [], []

    def screen(fit, names):
        asked.append((fit, names))
        gains = {"strain_stiffening": 143.0, LAG[0]: 0.1}
        return {n: SimpleNamespace(effect=n, gain=gains[n]) for n in names}, {}

    def run(tasks, known):
        fitted.extend(tasks)
        return [candidate(("strain_stiffening",), 10.9), candidate(SLIP, 1.0, BAD)]

    race = SimpleNamespace(
        base=candidate((), 0.0, BAD), held=lambda fit: [held], screen=screen, run=run
    )
    search = SimpleNamespace(
        own=(), library=[*GAIN, *LAG, "strain_stiffening"], progress=lambda _: 0
    )
    # Beside something else it was fitted, which does not say what it explains alone.
    both = candidate((*GAIN, "strain_stiffening"), ahead - 1.0)
    found = Search._seen_off_the_wall(search, race, [gain, both])
    assert asked == [(held, [*LAG, "strain_stiffening"])]
    if not tried:
        assert found == fitted == []
        return
    assert [(fit, seen.effect) for fit, seen in fitted] == [(held, "strain_stiffening")]
    assert [c.effects for c in found] == [("strain_stiffening",)]


@pytest.mark.parametrize(("promised", "fitted"), [(19_850.0, True), (19_400.0, False)])
def test_a_pair_is_worth_what_the_base_or_a_leader_promises(monkeypatch, promised, fitted):
    """Beside a tension that had ended in a wrong valley a thickness promised too little."""
    others = [f"other {k}" for k in range(SEARCH.most_pairs - 1)]
    gains = {LAG: {GAIN[0]: 100.0}, SLIP: dict.fromkeys(others, 1000.0)}

    def screen(fit, names, errors=None):
        own = gains[fit.effects]
        return {n: SimpleNamespace(effect=n, gain=own[n]) for n in names if n in own}, {}

    unknowns = SimpleNamespace(effects=("one", "two"))
    linear = [
        LinearPair((LAG[0], GAIN[0]), promised, (unknowns, np.zeros(5))),
        LinearPair(("one", "two"), 19_500.0, (unknowns, np.zeros(5))),
    ]
    monkeypatch.setattr(pair_search, "linear_pairs", lambda *_: linear)
    tasks = []
    race = SimpleNamespace(
        screen=screen,
        held=lambda fit: [],
        base=SimpleNamespace(fit=SimpleNamespace(cost=22_500.0)),
        run=lambda ranked, known: tasks.extend((f.effects[0], s.effect) for f, s in ranked) or [],
        fitted=lambda function, some: tasks.extend(task[0].effects for task in some) or [],
        limit=lambda known: None,
    )
    search = SimpleNamespace(
        own=(), library=[*LAG, *SLIP, *GAIN, *others], looks=[], progress=lambda _: 0, fitter=None
    )
    alone = [candidate(LAG, 13.0, BAD), candidate(SLIP, 19.0, BAD)]
    singles = [replace(c, fit=replace(c.fit, cost=3400.0)) for c in alone]
    PairSearch(search, race).beside(singles, 2, SEARCH.seen, {"any": None}, partners=len(others))
    assert len(tasks) == SEARCH.most_pairs
    assert tasks[-1] == ((LAG[0], GAIN[0]) if fitted else unknowns.effects)


@pytest.fixture(params=[(1.7, True), (2.5, False)], ids=["as told", "larger"])
def breathing(request, monkeypatch, looks):
    """Return a search whose repeats tell a breath of 1.5 µm, and the errors that its best needs.

    By these everything may be noise; whether they are as repeats tell comes last.
    """

    def errors(um):
        node = SimpleNamespace(sizes_um={"white": 3.0, "breathing": um})
        return SimpleNamespace(nodes=[node], median=lambda of: of(node))

    def left_of(self, fit, told):
        assert told is own
        return Residual(GOOD, (), GOOD)

    monkeypatch.setattr(search_module.Search, "left_of", left_of)
    breath_um, as_told = request.param
    own, search = errors(breath_um), search_module.Search(looks[0])
    search.errors = CampaignErrors((errors(1.5),))
    return search, own, as_told


def test_the_model_as_it_is_needs_no_name_for_what_repeats_tell(breathing):
    search, own, as_told = breathing
    base = candidate((), 0.0, BAD)
    search.looks = [(base.fit, own)]
    one, again = records_of(measured({}, RAMPS[:1]))[0], records_of(measured({}, RAMPS[:1]))[0]
    found = search.by_its_own_errors(Found(base, {}, [], [one, again]))
    assert (found is not None and found.base.adequate) is as_told
    leading = Found(base, {}, [candidate(LAG, 5.0)], [one, again])
    assert search.by_its_own_errors(leading) is None


def test_the_likeliest_is_judged_by_its_own_errors_if_repeats_tell_as_much(breathing):
    """Repeats told a breath of 1.5 µm at 0.24 Hz, and it was at 0.26 Hz."""
    search, own, judged = breathing
    best, rival, far = (
        candidate(names, evidence, BAD)
        for names, evidence in (((*LAG, *GAIN), 66.0), ((*LAG, *SLIP), 62.0), (LAG, 50.0))
    )
    search.looks = [(best.fit, own)]
    found = search._by_errors_as_told([far, rival, best])
    assert [c.effects for c in found if c.adequate] == (
        [best.effects, rival.effects] if judged else []
    )
    # What may be noise already needs no other errors.
    assert search._by_errors_as_told([candidate(LAG, 70.0), best]) == []


@pytest.mark.parametrize(("own_um", "said"), [(4.0, False), (15.0, True)])
def test_errors_are_too_large_only_if_the_best_says_what_stiffness_does(
    monkeypatch, looks, own_um, said
):
    """Measured curves of what relaxes tell it badly: errors that last 16 µm were none."""

    def errors(um):
        node = SimpleNamespace(sizes_um={"ou": um})
        return SimpleNamespace(nodes=[node], median=lambda of: of(node))

    search = search_module.Search(looks[0])
    best = candidate(("viscoelasticity",), 40.0)
    slopes_mm = np.arange(12.0).reshape(2, -1)
    linear = SimpleNamespace(slopes_mm=slopes_mm)
    monkeypatch.setattr(search, "linear", lambda fit: linear if fit is best.fit else None)
    asked = []

    def look_at_errors(*_, own_softer_mm, **__):
        asked.append(own_softer_mm.tolist())
        return errors(own_um)

    monkeypatch.setattr(search_module, "look_at_errors", look_at_errors)
    search.errors = CampaignErrors((errors(5.0),))
    assert search._implausible([best]) == ""
    search.errors = CampaignErrors((errors(5.0), errors(16.0)))
    assert search._implausible([candidate(LAG, 50.0, BAD)]).startswith("lasting errors of 16.0 µm")
    assert not asked
    found = search._implausible([candidate(LAG, 50.0, BAD), best])
    assert found.startswith("lasting errors of 15.0 µm") if said else found == ""
    assert asked == [slopes_mm[:, best.fit.unknowns.space.scale].tolist()]


def test_of_a_tie_without_its_first_the_others_are_left():
    """A bent sensor, 13 times less likely than a tension that failed a trial, was a name."""
    tied = [candidate(LAG, 20.0), candidate(GAIN, 19.5), candidate(SLIP, 19.0)]
    left = [(v.name, v.explanations) for v in map(Verdict("ambiguous", tied).without, range(3))]
    lag, gain, slip = tied
    assert left == [("ambiguous", tied), ("ambiguous", tied[1:]), ("ambiguous", [slip, lag, gain])]
    pair = candidate((*LAG, *SLIP), 20.2)
    alone = Verdict("ambiguous", [pair, gain, lag]).without(2)
    assert (alone.name, alone.explanations) == ("named", [lag])
    assert Verdict("named", tied[:1]).without(0).name == "named"


def test_more_effects_where_fewer_do_are_no_other_explanation():
    both = (*LAG, *GAIN)
    assert verdict(BAD, candidate(LAG, 20.0), candidate(both, 20.5)) == ("named", [{*LAG}])
    assert verdict(BAD, candidate(LAG, 20.0, BAD), candidate(both, 20.5)) == (
        "named",
        [{*both}],
    )


def test_one_condition_alone_has_to_be_surer():
    lone = RAMPS[:1]
    candidates = candidate(LAG, 20.0), candidate(GAIN, 18.0)
    assert verdict(BAD, *candidates, plan=RAMPS) == ("named", [{*LAG}])
    assert verdict(BAD, *candidates, plan=lone) == ("ambiguous", [{*LAG}, {*GAIN}])
    assert verdict(BAD, candidate(LAG, 20.0), candidate(GAIN, 15.0), plan=lone) == (
        "named",
        [{*LAG}],
    )
    assert verdict(GOOD, candidate(LAG, 3.0), plan=lone) == ("none", [])


# ---- held out ------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_gap_of_a_model_without_fault_is_the_one_that_is_expected(table):
    squares, expected, noise = [], [], []
    for seed in range(8):
        fitter = fitter_of(measured({}, RAMPS, seed=seed), table)
        fit = fitter.fit(Unknowns(()), TRUE)
        found = predict_held_out(fitter, fit, conditions_of(fitter, [fit]))
        squares.append(found.rms_um**2)
        expected.append(found.expected_um**2)
        noise.append(found.noise_um**2)
    assert np.mean(noise) < np.mean(expected)
    assert np.mean(squares) == pytest.approx(np.mean(expected), rel=0.1)


# ---- what to measure next ------------------------------------------------------------------------


class Bent:
    """A model of one number that is exact where it is anchored, and off by the square beside it."""

    corrected = True

    def __init__(self, holds, anchor=1.0):
        self.holds, self.at = holds, anchor

    def predict(self, u):
        return [u + np.square(u - self.at)]

    def exact(self):
        return Bent(self.holds)

    def anchor(self, u):
        self.at = u[0]
        return self.holds


@pytest.mark.parametrize(
    ("most", "holds", "off"), [(0.5, True, 0.0), (2.0, True, 1.0), (0.5, False, 1.0)]
)
def test_what_is_predicted_badly_is_asked_of_the_finite_elements_there(most, holds, off):
    """The others lead to 2, which was measured; slopes at 1 predict 3."""
    fitter = SimpleNamespace(
        measured=np.array([2.0]),
        minimise=lambda *_: np.array([2.0]),
        jacobian=lambda model, u: np.array([[10.0 * model.at]]),
    )
    fit = make_dataclass("Fit", ["u", "jacobian"])(np.array([1.0]), np.array([[10.0]]))
    box = (np.zeros(1), np.full(1, 3.0))
    errors = SimpleNamespace(whiten=lambda values: values)
    part = SimpleNamespace(out=np.array([True]), errors=errors, kept=None)
    found, there = heldout._off(fitter, Bent(holds), fit, box, part, most)
    assert found == pytest.approx([off])
    asked = holds and most < 1.0  # then slopes, and the doubt by them, are those of that place
    assert there.jacobian.tolist() == [[20.0 if asked else 10.0]]


def test_what_may_be_advised_is_what_a_driver_allows():
    for aperture, top in PLANS.tops_mbar.items():
        assert aperture in (2.0, 4.0, 6.0, 8.0)
        assert not menu(aperture, 30.0)
        for holds_to in (34.0, 77.0, 102.0, 311.0, float("inf")):
            for text in (
                *menu(aperture, holds_to),
                *menu(aperture, holds_to, relaxes=True),
            ):
                program = parse_program(text)
                assert program.max_pressure_mbar <= min(500, top, 0.9 * holds_to)
                assert program.duration_s <= 60
    # Many pulses of a skin that relaxes take long to foresee: a jump that is held instead.
    programs, relaxing = menu(6.0), menu(6.0, relaxes=True)
    assert "mode1:100,1,1,8" in programs
    assert set(relaxing) - set(programs) == {
        "ramp:100@2000,hold:10,ramp:0@2000,hold:5,ramp:100@5,ramp:0@5"
    }
    assert set(programs) - set(relaxing) == {"mode1:100,1,1,8"}


def test_a_plan_that_confirms_the_leader_alone_settles_nothing():
    """What leads by 18 : 1 has a name by a little more; what is behind would hardly ever have."""
    normal = np.random.default_rng(0).standard_normal((4000, 2))
    odds = _Odds([("LAG",), ("GAIN",)], np.array([1.25, 0.0]), 2, [0, 0], PLANS.tie, normal)
    apart = np.array([[[0.0, 0.0], [0.0, 6.0]]])  # 2.4 standard deviations
    plan = odds.plan([_Look(Planned(6.0, "ramp:100@20", 1, 2.0), 500.0, apart, fresh=True)])
    assert plan.settled > 0.8
    assert plan.fair == pytest.approx(0.5, abs=0.1)
    assert plan.sure == plan.fair
    far = odds.plan([_Look(Planned(6.0, "ramp:100@20", 1, 2.0), 500.0, 8.0 * apart, fresh=True)])
    assert far.sure > PLANS.settled


@pytest.mark.parametrize(
    ("sure", "advised"),
    [
        ((0.7, 0.91, 0.97, 0.99), 1),  # the quickest that settles it
        ((0.5, 0.78, 0.8, 0.7), 1),  # the quickest of those that come as near
        ((0.5, 0.7, 0.8, 0.7), 2),
    ],
)
def test_what_settles_it_alone_is_advised(sure, advised):
    """One part of a plan came first, and left three ties of ten as they were."""
    looks = [
        _Look(Planned(6.0, f"ramp:{k}@20", 1, 2.0 + k), 500.0, np.zeros((1, 2, 2)), fresh=True)
        for k in range(4)
    ]
    plans = [
        Plan((look.planned,), ((LAG, s),), 0.0, 1.0 - s)
        for look, s in zip(looks, sure, strict=True)
    ]
    assert _most_telling(list(zip(looks, plans, strict=True)))[0] is looks[advised]


@pytest.mark.long
def test_the_advice_separates_what_one_ramp_leaves_tied(table):
    fitter = fitter_of(measured({}, [(6.0, "ramp:100@20", 1)]), table)
    offset, drift = Unknowns(("deflection_offset",)), Unknowns(("baseline_drift",))
    tied = [fitter.fit(offset, np.append(TRUE, 1.0)), fitter.fit(drift, np.append(TRUE, 3.0))]
    base = fitter.fit(Unknowns(()), TRUE)
    errors, rng = [PlannedErrors(white_um=3.0)], np.random.default_rng(0)
    same = advise(fitter, [base, base], [0.0, 0.0], errors, rng)
    assert same is None  # nothing tells a thing from itself
    # Two explanations with sizes that one ramp cannot see, but a long hold can.
    far = [replace(f, u=np.append(f.u[:3], s)) for f, s in zip(tied, (1.0, 10.0), strict=True)]
    found = advise(fitter, far, [0.0, 0.5], errors, rng)
    assert found is not None
    assert found.separates == (("deflection_offset",), ("baseline_drift",))
    assert found.expected_log10_evidence > 1.3
    assert (found.aperture_mm, found.program) != (6.0, "ramp:100@20")
    # What it is expected to lead to adds up, and a name is more probable with it than without.
    alone = found.alone
    assert alone is not None
    assert alone.settled + alone.wrong + alone.tied == pytest.approx(1.0)
    assert alone.settled > 0.5
    assert alone.minutes > 0
    # The plan goes on from there, and is over where it is enough.
    assert found.plan is not None
    assert found.plan.measurements[0] == alone.measurements[0]
    assert (len(found.plan.measurements) == 1) == (alone.sure >= PLANS.settled)


def test_what_the_mesh_does_in_the_campaign_it_does_again(table):
    """Two explanations that are apart by what the mesh may do are not told apart by more of it."""
    fitter = fitter_of(measured({}, RAMPS), table)
    at = fitter.records[2].geometry
    planned = planned_record(fitter, at, "ramp:100@60,ramp:0@60", np.inf, 0.0)
    one = fitter.fit(Unknowns(()), TRUE)
    (curve,) = MappedModel([planned], one.unknowns, fitter.domes).predict(one.u)
    mesh = PlannedCurve.of(fitter, planned, one, [curve])
    shapes = mesh_columns(fitter.records)
    j = int(np.abs(shapes[len(fitter.records[0].curve) :]).max(axis=0).argmax())
    moved = np.split(shapes[:, j], np.cumsum([len(r.curve) for r in fitter.records])[:-1])
    off = [w + 3.0 * m for w, m in zip(one.deflections_mm, moved, strict=True)]
    found = mesh.mesh_expected_mm(replace(one, deflections_mm=off)) - mesh.mesh_expected_mm(one)
    # The same shape of the planned curve is at most as far off; most of that is known.
    share = float(found @ mesh.mesh_mm[:, j] / np.square(mesh.mesh_mm[:, j]).sum())
    assert -3.0 <= share < -1.5
    # Nothing that is known becomes less so.
    before, after = (np.square(x).sum(axis=1) for x in (mesh.mesh_mm, mesh.mesh_left_mm))
    assert (after <= before * (1 + 1e-9)).all()
    assert after[-10] < 0.7 * before[-10]


def test_corners_that_the_rig_does_not_make_are_not_planned_with(table):
    """What tells lags apart is corners: a pump that rounds them tells less."""
    campaign = measured({}, RAMPS)
    assert rig_lag_s(records_of(campaign)) == 0.0
    late = []
    for curve in campaign.curves:
        path = PressurePath.of_program(curve.setup.program)
        made = felt_path({"regulator_lag": {"tau_s": 0.24}}, path)
        late.append(replace(curve, pressure_mbar=made(curve.time_s)))
    records = records_of(replace(campaign, curves=tuple(late)))
    lag_s = rig_lag_s(records)
    assert lag_s == pytest.approx(0.24, rel=0.15)
    fitter = fitter_of(campaign, table).with_errors(records, errors_of(records))
    planned = planned_record(fitter, records[0].geometry, "ramp:100@60,ramp:0@60", np.inf, lag_s)
    assert 80 < planned.path.top_mbar < 95
    assert planned.pressure_mbar[3] < 0.5 * 60 * 0.15  # 0.15 s after it began


def test_no_suction_is_advised_at_which_a_skin_creases(table):
    """The table goes on beyond a crease; the skin of the person that it is advised for does not."""
    fitter = fitter_of(measured({}, [(6.0, "ramp:60@20", 1)]), table)
    soft = np.array([np.log(0.012), np.log(30.0), 0.2])
    unknowns = Unknowns(("deflection_offset",))
    one = fitter.fit(unknowns, np.append(TRUE, 1.0))
    far = [replace(one, u=np.append(soft, s)) for s in (0.0, 6.0)]
    errors = [PlannedErrors(white_um=1.0)]
    found = advise(fitter, far, [0.0, 0.0], errors, np.random.default_rng(0))
    assert found is not None
    assert [names for names, _ in found.plan.named] == 2 * [("deflection_offset",)]
    every = [*found.plan.measurements, *found.alone.measurements]
    for each in every:
        problem = SkinProblem(Geometry(each.aperture_mm, 1.1), unknowns.skin(far[0].u))
        creases = fitter.domes.creases_mbar(problem)
        assert parse_program(each.program).max_pressure_mbar <= 0.9 * creases


def test_a_plan_is_one_that_a_site_bears(table):
    """A driver refuses what brings a site above the dose of a visit: no plan may ask for it."""
    assert PLANS.most_dose_mbar_s < DEFAULT_DOSE_MBAR_S
    fitter = fitter_of(measured({}, [(6.0, "ramp:100@20", 1)]), table)
    one = fitter.fit(Unknowns(("baseline_drift",)), np.append(TRUE, 3.0))
    looks = _looks(fitter, [one, one], [PlannedErrors(white_um=3.0)])
    slow = [one for one in looks if one.kind == (2.0, "ramp:400@16,ramp:0@16")]
    # 25 s up and 25 down: 10,000 mbar·s each time.
    assert [one.planned.placements for one in slow] == [1, 2, 3, 4, 5]
    assert slow[-1].dose_mbar_s == pytest.approx(50_000.0, rel=0.03)
    assert max(one.dose_mbar_s for one in looks) <= PLANS.most_dose_mbar_s
    assert _bearable(slow[:2])
    assert not _bearable([slow[1], slow[-1]])


def test_a_breath_is_planned_with(table):
    """A drift goes for some seconds as a breath does: a plan that forgets it promises too much."""
    fitter = fitter_of(measured({}, [(6.0, "ramp:100@20", 1)]), table)
    one = fitter.fit(Unknowns(("baseline_drift",)), np.append(TRUE, 3.0))
    far = [replace(one, u=np.append(one.u[:3], s)) for s in (0.0, 0.5)]

    def each(*sines: tuple[float, float]) -> list[float]:
        looks = _looks(fitter, far, [PlannedErrors(white_um=3.0, sines=sines)])
        return [look.gram[0, 1, 1] for look in looks]  # of the two curves' difference

    quiet, breathing = np.array(each()), np.array(each((8.0, 0.05)))
    assert (breathing < quiet).all()
    assert (breathing / quiet).min() < 0.6  # of a curve that is over before the breath is


def test_placements_that_scatter_are_met_by_putting_the_probe_on_again(table):
    """A zero that differs by placement hides an offset; a mean of several shows more of it."""
    fitter = fitter_of(measured({}, [(6.0, "ramp:100@20", 1)]), table)
    unknowns = Unknowns(("deflection_offset",))
    one = fitter.fit(unknowns, np.append(TRUE, 1.0))
    far = [replace(one, u=np.append(one.u[:3], s)) for s in (0.0, 2.0)]

    def hoped(offset_um: float) -> float:
        errors = [PlannedErrors(white_um=3.0, offset_um=offset_um)]
        found = advise(fitter, far, [0.0, 0.0], errors, np.random.default_rng(0))
        return 0.0 if found is None else found.plan.settled

    assert hoped(0.0) > hoped(30.0)


def test_what_is_planned_has_the_errors_by_which_explanations_explain(table):
    """Repeats that hardly differ, and an explanation that needs places to differ by 10 %."""
    fitter = fitter_of(measured({}, 2 * RAMPS, seed=3), table)
    fit = fitter.fit(Unknowns(()), TRUE)
    linear = Linearised.of(fit, fitter.errors, fitter.measured)
    softer = TRUE - np.array([0.1, 0.0, 0.0])  # in all places alike: no repeat tells
    elsewhere = fitter.model(fit.unknowns).predict(softer)
    off = replace(linear, residual_mm=fitter.measured - np.concatenate(elsewhere))
    off = replace(off, slopes_mm=1e-6 * off.slopes_mm)  # the law cannot give way

    def scatter(one):
        errors = learned(fitter.records, one)
        weights = errors.weights([one])
        assert sum(w for _, w in weights) == pytest.approx(1.0)
        planned = PlannedErrors.settings(errors, [one])
        assert len(planned) == PLANS.settings
        return [p.stiffness for p in planned]

    assert min(scatter(off)) > 0.03 > max(scatter(linear))


def test_the_finite_elements_and_the_table_agree_on_the_plain_skin(table):
    geometry = Geometry(6.0, 1.1)
    problem = SkinProblem(geometry, SKIN)
    dome = TableDomes(table)([problem], [100.0])
    p = np.linspace(5.0, 100.0, 20)
    solved = solve_skin(problem, PressurePath((0.0, 1.0), (0.0, 100.0))).at(p / 100.0, p)
    np.testing.assert_allclose(dome(p[None])[0], solved, rtol=5e-4, atol=1e-4)
