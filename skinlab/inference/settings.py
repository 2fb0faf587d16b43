"""The numbers that decide an answer, each with its unit and where it is from; all in one place.

What is not said otherwise was set on skins of seeds 8, 77 and 78, of which no figure is reported,
and moves `held` and `flags` of `python benchmarks/identification.py coverage` (docs/intervals.md).
Sizes of the errors of meshes are no settings: they were measured, and stand where they are used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class StartRules:
    """Where `auto` looks for the optimum.

    More of each is safer and slower: `python benchmarks/identification.py optimum` has how often
    the optimum is found (1,000 of 1,000), `rivals` the time.
    """

    best: int = 8
    """Starts that are the best of all candidates,"""
    patches: tuple[int, int] = (6, 8)
    """and of each of these, along the last two unknowns."""
    first_steps: int = 10
    """Of all of them,"""
    kept: int = 8
    """of which so many are walked to the bottom,"""
    apart: float = 0.01
    """if they are no closer to one another, share of the unit cube."""
    alike: float = 1e-4
    """Share of the unit cube: minima closer than this are one."""
    most_fitted: int = 5000
    """Samples of a curve: more say next to nothing more, since errors last, and take their time."""
    growing_samples: int = 200
    """Candidates for a curve that still grows, where an answer is due several times a second,"""
    growing_firsts: int = 4
    """so many of the best of the patches, beside where the last answer was,"""
    growing_steps: int = 30
    """and steps from each."""


@dataclass(frozen=True)
class NoiseRules:
    """How sizes of errors are read from curves."""

    least_mm: float = 1e-5
    """Of a deflection's noise: what interpolation in the database leaves."""
    least_mbar: float = 0.02
    """Of a pressure's noise: less is rounding."""
    corner: float = 3.5
    """Robust standard deviations: more is a corner of the program, not noise."""
    side: int = 5
    """Samples on either side of a step."""
    jump: float = 6.0
    """Robust standard deviations: more is a step. Rows `jump` of the benchmark."""
    fewest: int = 12
    """Samples of a pressure channel whose noise can be told."""
    levels: int = 10
    """Different pressures: what is at fewer was held, and its samples do not tell dw/dp (a
    polynomial of degree 8 needs as many);"""
    level: float = 0.01
    """of the way to the highest one, on which curves bend evenly: what is nearer is the same."""
    fewest_common: int = 20
    """Samples that two repeats share, whose difference tells of the noise."""
    course_half_widths: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    """Samples on either side, over which a smooth pressure is looked for,"""
    course_apart: float = 2.5
    """and standard deviations by which a wider line has left a narrower one: it passes by a corner
    (docs/decisions/0090-the-smooth-course-of-the-pressure.md). Rows `pressure…`."""


@dataclass(frozen=True)
class OutlierRules:
    """Which samples do not belong to the curve. Rows `glitch`, `spikes`, and flags `outliers`."""

    fewest: int = 12
    """Samples: of fewer none is left out."""
    wide_mm: float = 0.05
    """Of a movement, or"""
    wide: float = 10.0
    """times the noise."""
    usual: tuple[float, float] = (0.1, 100.0)
    """Outliers of so many samples, before the data."""
    most: float = 0.1
    """Share of all samples; more are no outliers."""
    run: int = 4
    """Samples between two that are left out, or fewer: these may be of one glitch, which ends so"""
    run_off: float = 8.0
    """many standard deviations of its neighbours off them."""
    searches: int = 12
    """Times that the samples of one fit are looked through,"""
    fits: int = 4
    """and fits, each without what was found at the one before."""
    lasting_s: float = 0.3
    """Of what is correlated in the residuals."""
    least_mm: float = 5e-4
    """Of a noise beside which a sample can be off."""
    sizes: tuple[float, float, int] = (0.1, 1.6, 13)
    """Of white noise, times the roughness: least, most, how many."""
    shares: tuple[float, float, int] = (0.0025, 0.08, 16)
    """Of the deflection, likewise; none at all is tried too."""
    gain: float = 2.0
    """In log likelihood, that a share has to bring."""
    most_bends: int = 400
    """That are looked at for these."""
    freedom: float = 4.0
    """Degrees of the Student distribution of these."""


@dataclass(frozen=True)
class KindRules:
    """Kinds of errors, before the data: docs/intervals.md lists them with their sources.

    Sizes that are published for one kind stand in its file of skinlab/inference/error_models.
    """

    unusual_odds: float = 0.2
    """Of a kind that is there in one curve of six: sines, heavy tails, shares of the deflection."""
    lasting_odds: float = 1.0
    """Of errors that last: as likely there as not (traction records all have them)."""
    wander: tuple[float, float, float] = (0.7, 0.6, 0.45)
    """Median and logarithmic standard deviations, below and above it, before the data of how a zero
    wanders during a curve, µm per root second: 0.5 to 1 are published (weight of the probe, creep
    of the tape)."""
    wander_odds: float = 1.0
    """Of that in a curve that is identified."""
    wander_terms: int = 2
    """Of such a walk in a curve that is identified, at least, or"""
    wander_each_s: float = 2.5
    """one for so much of it: of a walk of 1 µm per root second these leave 0.5 µm;"""
    wander_most: int = 20
    """but no more: of a longer curve errors that last take the rest. Rows `walk…`."""
    edge: float = 0.02
    """Of a logarithm: how soon what is beyond reach is impossible."""
    hardly: float = 50.0
    """Times below the median is what is hardly there,"""
    hardly_sd: float = 1.2
    """give or take so much, of the logarithm."""
    white_um: float = 3.0
    """Median of the sensor's noise, and"""
    white_sd: float = 1.5
    """standard deviation of its logarithm; the same where"""
    stated_sd: float = 0.06
    """it is stated: a statement is good to some per cent, or"""
    stated_wrong: float = 0.1
    """wrong altogether, one in ten. Rows `…_stated`."""
    pressure_sd: float = 0.2
    """Of the logarithm of the pressure channel's own estimate."""
    fewest_lasting: int = 12
    """Samples that tell errors that last from the skin."""
    fewest_shapes: int = 20
    """Samples that tell tails, and shares of the deflection."""
    tails: tuple[float, ...] = (3.0, 6.0)
    """Degrees of freedom that are tried, where"""
    tails_suspect: float = 2.0
    """standard deviations of the mean fourth power of Gaussian errors are exceeded."""
    sine_sd: float = 0.7
    """Of the logarithm of a sine's size."""
    sine_apart: float = 0.2
    """Of a period over the record: frequencies that a good record tells apart."""
    sine_periods: float = 1.0
    """That a record has to last,"""
    sine_samples: float = 6.0
    """with so many samples a period, at least."""
    sine_finest: float = 0.15
    """Of a period over the whole record: the grid of frequencies,"""
    sine_most: int = 60
    """of so many at most: from the best one it is looked for more closely;"""
    sine_most_of_each: int = 400
    """of each curve of several, whose frequency stays there."""
    sine_between: int = 9
    """From the best of these so many, as far as the next on either side."""
    sine_sweeps: int = 4
    """Of the curves, each looked at beside the others' sines, at most."""
    sine_stands_out: float = 3.0
    """Times what white noise gives to one frequency;"""
    sines_stand_out: float = 2.0
    """the same for each curve of several, less what choosing its frequency costs."""
    step_um: float = 0.2
    """A smaller step of the readings is no error beside any sensor's noise. Rows `steps…`."""
    step_waves: int = 3
    """Harmonics of the rounding's wave,"""
    step_least_wave: float = 0.02
    """of step/√12 at least: smaller ones are left to what is independent."""
    step_off: float = 0.02
    """Of a step: how far from its lattice a reading may be."""
    step_levels: int = 8
    """Different readings: fewer are a lattice only with"""
    step_again: int = 4
    """samples a reading."""


@dataclass(frozen=True)
class ChoiceRules:
    """How combinations of errors are found and integrated over.

    Larger numbers of nodes and models are surer and slower: an error choice is a quarter of a
    curve's time (docs/decisions/0060-less-work-a-curve.md).
    """

    hopeless: float = 7.0
    """In log evidence: a combination so much worse is not integrated over."""
    smooth: float = 3.0
    """Times its roughness: a residual so large is looked at as one that lasts, too."""
    wider: float = 1.2
    """Times the curvature's width, of the Student distribution that is drawn from,"""
    freedom: float = 6.0
    """with so many degrees of freedom (skinlab/data/sobol.npz is made with it)."""
    nodes: Mapping[int, int] = field(default_factory=lambda: {0: 1, 1: 10, 2: 24, 3: 40})
    """By the number of parameters;"""
    most_nodes: int = 64
    """of more parameters, and in the second round."""
    few: int = 2
    """Parameters: the nodes of the first round will do."""
    weighty: float = 3.0
    """In log evidence below the best: those have a second round."""
    as_mode: float = 6.0
    """Nodes that the curvature at the mode counts as there, beside them."""
    from_prior: float = 0.2
    """Share of the nodes."""
    most_models: int = 4
    """Beside those that are always there."""
    negligible: float = 1e-3
    """Share of all weight: nodes that carry less are dropped."""
    mixture_rounds: int = 6
    """For sizes and weights of heavy tails, by turns."""
    newton_steps: int = 6
    """To the mode, at most;"""
    settled: float = 0.05
    """of the log density: a step that promises less is the last;"""
    least_curvature: float = 0.4
    """of it by a logarithm: what is wider than 1.6 is left to the prior."""
    basis_kept: float = 0.01
    """Of the least noise: components that move no curve by more are left out of the likelihood."""


@dataclass(frozen=True)
class JudgementRules:
    """What the errors of a curve mean for its flags (docs/intervals.md)."""

    told: float = 0.5
    """Of the likeliest combination's weight: a simpler one that has as much is told of."""
    sure: float = 0.95
    """Probability from which on errors last: `correlated_noise`."""
    shows: float = 0.3
    """Of the white noise: errors that last and are smaller are not worth a word."""
    contradicted: float = 1.3
    """Times the stated noise, either way: `stated_noise_contradicted`, where"""
    doubt: float = 0.01
    """the stated noise is that improbable."""
    pressure_contradicted: float = 3.0
    """Times the stated noise of the pressure, either way: `stated_pressure_noise_contradicted`;"""
    pressure_least_mbar: float = 0.1
    """no statement is too small by less than so many times this, and"""
    pressure_fewest: int = 20
    """none is judged by fewer samples of a curve."""
    most_um: float = 8.0
    """Of errors that last: more is no tremor, but something missing: `misfit_above_noise`. Tremor,
    breathing and creep that were published stay below it."""
    most_each_um: float = 30.0
    """Of what each sample has alone, shares of the deflection apart: more is likewise. Steps of
    10 µm are 3 µm; of more glitches than are left out it may be 120 µm."""
    most_zero_um: float = 10.0
    """Of placements' zeros, of which 4 µm are expected, 8 µm in one of twenty: more is likewise."""
    at_bound: float = 1e-5
    """Share of a parameter's range: `at_bound`."""


@dataclass(frozen=True)
class PosteriorRules:
    """How a fit becomes a distribution (docs/decisions/0005-intervals-follow-the-valley.md).

    Fewer draws cost less and move the last digits of every interval; `sampler` of
    benchmarks/identification.py compares with a Markov chain.
    """

    modes: int = 6
    """Minima that valleys are followed from."""
    elsewhere: float = 4.0
    """Of χ² by errors as learned in one valley, by which another has to be better to begin there:
    e² in likelihood. What is nearer is followed as one of the modes,"""
    hopeless: float = 25.0
    """unless it is so much worse."""
    draws: int = 4096
    """A round;"""
    enough: float = 500.0
    """effective draws: quantiles of 5 % to within 1 %; more rounds until then,"""
    most_rounds: int = 3
    """but no more; or so many"""
    more_rounds: int = 8
    """where there are fewer than so many"""
    least: float = 20.0
    """effective draws: weights are evened out until they are worth these."""
    offsets: tuple[float, ...] = (0.0, 0.5, 1.0, 1.5, 2.0, 2.6, 3.5, 5.0, 7.5, 11.0, 16.0)
    """Standard deviations from the optimum at which the valley is looked for, on both sides."""
    lost_chi2: float = 30.0
    """Of χ²: valley points so much worse than the best carry nothing."""
    freedom: int = 5
    """Degrees of the Student distributions that are drawn from,"""
    wider: float = 1.15
    """times as wide as the curvature says."""
    centres: int = 64
    """Of the mixture of further rounds,"""
    stride: float = 0.3
    """of the posterior's width: how far one of these speaks."""
    between: int = 6
    """Points from one of the valley to the next, which intervals ask for,"""
    no_weight: float = 1e-12
    """and what they weigh."""
    no_distance: float = 1e-9
    """Of the unit cube: points of the valley that are nearer to each other are one."""
    small: float = 0.07
    """Of the noise: columns of errors of so little length change nothing."""
    beyond: float = 2.0
    """Times the squares: what a fit gains outside of the range is no small matter
    (docs/decisions/0016-errors-are-found-and-integrated.md)."""
    common_thickness: float = 0.5
    """Of the stated thickness' variance, where there are several placements; the rest is each
    placement's own. Assumed, not measured."""
    thickness_within: float = 1.645
    """Standard deviations of the thickness: where the database ends nearer, more than 5 % of what
    is possible is cut off, which is told."""
    alike: float = 2.5
    """Standard deviations: curves whose noises are closer have the same."""


@dataclass(frozen=True)
class IntervalRules:
    """What of the posterior is inside of an interval. Rows `ends_…` move most.

    Chosen on skins of which the table itself was the truth, by the mean weight inside, so that
    intervals hold in 90 % over the prior, and by how often they held of skins as people's, of which
    the prior has few (docs/decisions/0143-what-is-likely-is-inside.md).
    """

    level: float = 0.9
    """Of intervals, as it is told: of true values over the prior."""
    weight: float = 0.88
    """Of the posterior, that is inside at least,"""
    likely_fall: float = 1.4
    """and values to which twice the log likelihood falls by no more: 76 % of χ² of one degree,"""
    end_fall: float = 2.0
    """and ends of ranges, by no more than this: there half of all falls are none, the other half χ²
    of one degree (Self and Liang 1987); 92 % of both."""
    middle: float = 0.2
    """Of the weight, about the median, which is inside whatever is shortest."""
    as_short: float = 0.01
    """Of the width: intervals that differ by less are as short."""
    at_end: float = 0.002
    """Of the range: an unknown so near is at its end."""
    most_of_the_range: float = 0.5
    """Of the prior's own interval, in the prior's scale: wider is `not_identifiable`;"""
    prior_draws: int = 1000
    """from so many."""


@dataclass(frozen=True)
class CalibrationRules:
    """What phantoms tell of a probe (docs/calibration.md).

    Chosen on kits and probes of seeds 100 to 125; benchmarks/results/calibration.json, of others,
    has how many of 100 are held. Tuples are in the order of `probe_file.PARAMETERS`, mm for µm.
    """

    before: tuple[float, ...] = (0.2, 0.2, 0.2, 3.0, 0.2)
    """Standard deviations of what a probe can be before anything is measured."""
    open: float = 0.5
    """Of that: what is wider was not determined."""
    floor: tuple[float, ...] = (2e-4, 1.5e-4, 2e-4, 0.015, 0.0)
    """No calibration is better than this, one standard deviation: readings are rounded, and"""
    floor_lag: float = 0.02
    """a lag is read between samples: its part of their interval."""
    meshes: float = 1.5
    """Times the usual errors of the finite elements' dome: silicone is softer in bulk."""
    far: float = 3.0
    """Standard deviations of a sheet: a phantom further off is another one."""
    rounds: int = 3
    """For the samples' weights."""
    spare: float = 1.3
    """Times the highest reading, to which domes are solved: a gain may be wrong."""
    grid_mbar: float = 10.0
    """To which that is rounded up: one solution serves curves whose noise differs."""
    least_um: float = 0.3
    """Of a step of the readings, or of their noise."""
    settled_s: float = 0.5
    """After a valve has opened: ten of its time constants."""
    corner_s: float = 0.15
    """Left out behind a corner of the program: pumps follow late, and a lag shows it later."""
    smooth: int = 5
    """Readings of the pressure over which it is smoothed: it moves straight between corners. More
    where its noise is above"""
    smooth_mbar: float = 0.2
    """for a dome is bent, and the mean dome of noisy pressures is not that of the mean: it looked
    like lag and gain;"""
    smooth_s: float = 0.25
    """over so long at most."""
    check_points: int = 15
    """Pressures at which a check compares."""
    check_offset_mm: float = 3e-3
    """What a probe may be off at a check, one standard deviation: warmth, and how it lies;"""
    check_gain: float = 0.005
    """likewise."""
    check_sure: float = 0.99
    """Probability up to which it agrees."""


@dataclass(frozen=True)
class PopulationRules:
    """When a population is a prior, and how two answers are held against each other.

    `python benchmarks/study.py prior` has what intervals with a prior hold, and how often
    `unlike_cohort` is right.
    """

    rare: float = 0.99
    """Of the population is nearer than a skin that is unlike it,"""
    nearest: float = 0.05
    """if even so much of a curve's draws is that far."""
    enough: float = 200.0
    """Effective draws under the prior; more rounds until then,"""
    most_rounds: int = 6
    """but no more."""
    sure: float = 0.975
    """Probability that a parameter is higher: it is. Two-sided 95 %, as publications have it."""
    likely: float = 0.9
    """The same: it probably is."""
    random: float = 0.01
    """Probability of so large a difference by chance, below which two curves are of two skins:
    `compare` moves, no benchmark."""
    bins: int = 60
    """Of the histograms whose overlap is told."""
    starts: int = 16
    """Draws of either answer, from which one skin for both is looked for."""


@dataclass(frozen=True)
class AdviceRules:
    """The menu of next measurements, and how closely it is looked at: `--advise`, no benchmark."""

    pressures_mbar: tuple[float, ...] = (100.0, 200.0, 300.0, 450.0)
    """Tops of ramps, through every opening,"""
    rates_mbar_per_s: tuple[float, ...] = (10.0, 20.0, 50.0)
    """at these rates,"""
    sampling_hz: float = 20.0
    """with so many samples a second."""
    draws: int = 24
    """Of the posterior, whose median counts."""
    points: int = 40
    """Of a curve, standing for all of its samples."""
    least_noise_um: float = 0.1
    """No sensor is better."""


STARTS = StartRules()
NOISE = NoiseRules()
OUTLIERS = OutlierRules()
KINDS = KindRules()
CHOICE = ChoiceRules()
JUDGEMENT = JudgementRules()
POSTERIOR = PosteriorRules()
INTERVALS = IntervalRules()
CALIBRATION = CalibrationRules()
POPULATION = PopulationRules()
ADVICE = AdviceRules()
