"""The numbers that decide, each with its unit and where it is from; all in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ErrorRules:
    """How the errors of a campaign are learned."""

    smooth_degree: int = 3
    """Of the polynomials in time, of each phase of each condition, that any model may leave: what
    they take up is not counted as noise. A quartic fit leaves the noise of traction records."""
    smooth_more: int = 2
    """Degrees more of those in the suction."""
    smooth_repeated: int = 6
    """Degrees more of either where repeats tell of errors: what a lag leaves at a corner was called
    errors that last, of 7 µm, and with as many as these none."""
    placed_degree: int = 3
    """Of polynomials in the suction, of each repeat alone, where glitches are looked for,"""
    rough_rounds: int = 8
    """in what these leave by least squares, so often weighed again"""
    rough_tuning: float = 2.385
    """by deviations in units of so many usual ones: 95 % efficient where all are Gaussian."""
    glitch_longest: int = 4
    """Samples on end that may be glitches: where more would be, the polynomials are not enough."""
    smooth_sd_um: float = 100.0
    """Prior of their coefficients: larger than what any effect leaves after a refit (140 µm)."""
    common_sd: float = 1.0
    """Of the logarithms of stiffness and thickness that all repeats of a condition have in common,
    in what repeats tell: as good as free."""
    bend_um: float = 0.5
    """From which size on what placements do beyond straight lines is taken off: less is no more
    than two meshes differ. A stiffness off by 12 % and a thickness by 5 % do 5 to 10 µm."""
    thickness_scatter: tuple[float, float, float] = (0.02, 0.8, 0.45)
    """Median and logarithmic standard deviations, below and above it, before the data of the
    scatter of log thickness between placements: 1 to 5 % (ultrasound, site), which are two of
    either. 25 % is no scatter (as of zeros: docs/decisions/0042-advice-and-speed.md)."""
    placements_alike: float = 0.1
    """Share of the priors of stiffness, zero and thickness of placements with which these hardly
    differ, where a condition was measured at several placements: their repeats then tell."""
    wander_terms: int = 2
    """Of a zero that wanders as a random walk: they hold 90 % of its mean square. At least, or"""
    wander_each_s: float = 10.0
    """one for so much of a curve: of 50 s these two left swings of 1.3 µm, in all explanations."""
    wander_most: float = 1.0
    """µm per root second, up to which what looks like a sudden step may be such a walk."""
    coarse_hz: float = 25.0
    """Samples are averaged to about this rate: the shortest correlation time is 0.1 s."""
    jump_mbar_per_s: float = 100.0
    """From where on a suction jumps. Means of so long are off by 0.8 µm at most at 80 mbar/s, by 5
    at 190 (a soft skin at 8 mm)."""
    jump_mbar: float = 5.0
    """Less than that is no jump, however fast."""
    weight_kept: float = 0.99
    """Of the probability of settings of the errors, over which evidence is integrated: the rest is
    0.004 in log10 evidence, and a third of the time."""
    kind_kept: float = 0.1
    """Probability by pure error, from which on an explanation is judged with a kind of errors."""
    rough_nodes: int = 12
    """Settings of each look by which explanations are ranked while the search goes on."""
    judged_nodes: int = 12
    """Settings of the errors by which a residual is judged and robustness is looked at."""
    largest_um: Mapping[str, float] = field(
        default_factory=lambda: {"ou": 8.0, "breathing": 6.0, "pulse": 5.0}
    )
    """Root mean squares above which what lasts or repeats is no error, but something missing: twice
    what docs/intervals.md lists."""
    usual_um: Mapping[str, float] = field(
        default_factory=lambda: {"ou": 3.0, "breathing": 2.5, "pulse": 1.5}
    )
    """The same that are usual, the medians before the data: what a model needs no more of, and no
    repeats tell of, is no gap. Larger ones raise fewer alarms where nothing is hidden, and hide
    weak effects."""
    fewest: int = 20
    """Samples of a curve that can be looked at."""
    course_apart: tuple[float, float] = (2.0, 3.0)
    """Of `smooth_course`: less than for one curve, so that corners of fast programs at 10 Hz stay;
    more where a lag leaves none: noise in the path is what a play or a friction would take off."""
    corners: tuple[float, float] = (0.5, 0.1)
    """How far the path may cut corners of that: of the noise, and mbar at least."""
    as_asked: float = 1.25
    """A channel within so many times its noise of the program followed it;"""
    as_lagging: float = 1.5
    """within so many of the program by a lag, it followed that."""
    rounding_um: float = 0.3
    """Of a deflection's noise,"""
    rounding_mbar: float = 0.01
    """and of a step of the pressure: less is none."""
    glitch_window: int = 5
    """Samples whose median a glitch is held against,"""
    glitch: float = 6.0
    """in standard deviations from it, and"""
    glitch_part: int = 100
    """Samples of which these are estimated together,"""
    glitch_trimmed: float = 0.95
    """by this share of the smallest."""
    glitch_mm: float = 0.015
    """at least."""
    by_chance: float = 1e-3
    """Of a p value: repeats that share more of their glitches than that are no glitches'."""
    bins: int = 6
    """Of a phase of a curve, in which a residual is looked at,"""
    bin_fewest: int = 6
    """with so many samples at least."""
    neighbours: int = 3
    """Samples apart: beyond what chance does to one distance, within a heartbeat."""
    drawn: int = 200
    """Residuals by chance, of which the largest step is the measure, with"""
    step_side: int = 4
    """samples on either side of it."""
    neighbours_left: float = 0.02
    """Correlation of neighbours in what is left, which counts as none: in 20 curves rounding and
    tails that are nearly modelled left 0.04, 7 deviations, in all explanations alike. A smooth
    gap of a seventh of the noise leaves as much."""
    adequate: float = 1e-3
    """Of a p value: a fit whose residual is less likely than this leaves more than noise."""
    hardly: float = 1e-6
    """Of a p value: what is less likely is missing, or moves in each curve for itself, even where
    repeats do not have it in common; between the two they decide."""
    no_doubt: float = 0.05
    """Of a p value: what is likelier is not looked at with other errors."""
    no_larger: float = 1.25
    """Times the size that repeats tell of a kind of errors (and `rounding_um`): an explanation that
    needs no more is judged by its own."""
    wave_sure: float = 0.95
    """Probability of a pulse or a breath, from which on it is looked at;"""
    wave_rest: float = 0.5
    """of its mean square, that is there whichever curve is left out;"""
    wave_agree: float = 1.5
    """times a size, so much it may be in the other look."""


@dataclass(frozen=True)
class FitRules:
    """When a fit ends, and how far it may go from where the finite elements were asked.

    Chosen on the white-noise campaigns of 0.1.0 (docs/decisions/0010-fits-anchor-the-database.md);
    more anchors, or a closer end, move `cpu_seconds` of benchmarks/missing_effect.py up and no
    verdict; fewer move `life_named_of_one_hidden` down.
    """

    least_gain: float = 1e-8
    """Of the cost: a step between two anchors that promises less is the last. With 1e-3 a fit that
    began at ν = 0 ended near there, 119 above its optimum;"""
    least_gain_share: float = 1e-5
    """or such a share of the χ² that is more than noise: the next anchor goes on from there. What
    explains nothing took half of its steps for the last digits;"""
    steps: int = 100
    """so many at most."""
    anchors: int = 8
    """Solutions of the finite elements in one walk, at most."""
    seen_anchors: int = 2
    """After so many, a fit that expects to stay above its limit ends."""
    idle_anchors: int = 2
    """After so many in a row that gain less than `gain`, it ends: the valley is flat."""
    hair: float = 3.0
    """Of the cost: a promise of less that comes to nothing gains nothing either;"""
    enough_anchors: int = 3
    """After so many, one that explains nothing goes on only while it gains `worth`, and a second
    try only while it expects to come below the first."""
    worth: float = 0.1
    """Share of what is left of χ²."""
    walks: int = 4
    """Times that a walk is begun anew where it has not settled."""
    leaps_mbar: tuple[float, ...] = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0)
    """Tried where a crease at the tape's edge snaps shut, and ends the path;"""
    rough_steps: float = 1e-3
    """Of the opening's radius: what a step on the coarse mesh may be off its extrapolation, which
    is ten times that of the mesh of record, and of interpolation far less;"""
    hopeless: float = 1.5
    """χ² a sample that no exact optimum will turn into an explanation."""
    gain: float = 0.3
    """Of the cost (natural logarithms, twice): less is not worth another walk."""
    close: float = 0.3
    """Of χ²: an anchor that changes the curves by no more is the last."""
    close_share: float = 0.01
    """Or so much of the χ² that is more than noise: such a fit decides nothing."""
    effect_radius: float = 1.0
    """How far from an anchor an effect is trusted, in typical sizes."""
    near: float = 0.1
    """Typical sizes, or reaches of the law: a start that has led so near a fit leads to it."""
    at_bound: float = 1e-4
    """Of the range: an unknown so near its end is at it."""
    near_end: float = 0.1
    """Of the range of a law's parameter that is no logarithm (Poisson's ratio): a fit that ends so
    near its end is begun from the middle as well. A lag whose partner was missing had led to 0.497;
    from there the pair of the truth ended at 0.496, 10^79 times less likely than at 0.36."""
    near_end_curved: float = 0.2
    """The same beside what bends, as layers do: there the valley is long. One was 4.5 lower at
    ν 0.36 than where its fit had ended, at 0.09."""
    ways: tuple[float, ...] = (1.0, 0.5, 0.25)
    """Of the way from where a fit ended to another start of it: the first that has a model."""
    least_held: float = 0.7
    """Of the suction that is needed: a skin that creases before has no answer;"""
    least_reach: float = 1 / 3
    """of the suction that is asked for: it has no dome in the table. What has relaxed is asked for
    as well, and a skin may crease on the table's mesh at 0.45 of that and on no other."""
    refit_radius: float = 1.0
    """How far a refit without some data may go from the whole fit: logarithms, typical sizes;"""
    refit_reaches: float = 1.5
    """the same of a law's parameter that is no logarithm, in its reaches."""
    refit_anchors: int = 3
    """Times that it is anchored, where what it was fitted without is predicted badly."""
    shares: tuple[float, ...] = (0.7, 0.2, 1.5)
    """Of the size that is expected, from which an effect is fitted,"""
    small: float = 0.5
    """In typical sizes: where less is expected of an effect with a shape, it is begun from its
    usual size too."""
    little: float = 0.1
    """Of a typical size, from which an effect is begun off a wall where nothing was left of it."""
    again: float = 0.9
    """Of the cost from the first one, what a second one has to come to for a third to be tried,
    where something explains already."""
    far_off: float = 0.5
    """Of what another effect takes off the cost: where two starts leave more, no third is tried,"""
    far_off_times: float = 3.0
    """if that is so many times the noise as well;"""
    agree: float = 0.03
    """Of the cost: starts that come so near one another, and explain nothing, came to the same;"""
    alike: int = 2
    """so many of them end the search elsewhere."""
    levels: tuple[float, ...] = (1.0, 2.5, 6.0)
    """In typical sizes, from usual to strong, from which it is begun, and"""
    elsewhere: tuple[tuple[float, float], ...] = ((0.2, 0.0), (0.7, 1.0), (0.2, 1.0))
    """elsewhere: share of the expected size; more log ratios."""


@dataclass(frozen=True)
class SearchRules:
    """Which explanations are fitted, and how likely each is before the data.

    Chosen on the white-noise campaigns of 0.1.0, seeds that no figure is reported of. What is left
    out can not be named: larger numbers move `cpu_seconds` of benchmarks/missing_effect.py up,
    smaller ones `life_named_of_one_hidden` and `life_two_hidden_named_rightly` down.
    """

    astray_um: float = 50.0
    """What the first fit of the model as it is may leave, root mean square, before one by"""
    equal_um: float = 20.0
    """equal errors of all samples is asked, which is taken where it leaves less than"""
    astray_share: float = 0.5
    """this share of that."""
    rounds: int = 2
    """Times that errors are learned about a better fit of the model as it is."""
    agreeing: int = 4
    """Starts of the law alone that have to lead to the same fit."""
    as_a_pair: int = 3
    """Unknowns of an effect that is no simpler than two others: beside it pairs are looked for."""
    pairs_odds: float = 0.2
    """Odds before the data of two effects together, against one of the library."""
    seen: float = 8.0
    """Gain of χ² by which an effect is worth a fit."""
    seen_curved: float = 4.0
    """The same of one that is curved: layers of which the screen saw 4.8 were worth 30."""
    behind: float = 10.0
    """The same for a second one beside what explains: chance does as much in one of thirty screens.
    A pair needs 18 (20 : 1, its odds, and what a prior costs), but the screen saw 17 of what was
    worth 50, and 14 of what was worth 67."""
    beside: int = 2
    """Effects that explain, less than `not_enough` behind the best, beside which a second one is
    looked for, at most."""
    halves: int = 1
    """And so many that leave more than noise, and are as near: one half of the truth may be."""
    partly: float = 3.0
    """Or so much by errors that its leader alone needs: then it is weighed by those of both."""
    held: float = 0.25
    """Of what it costs to hold the model off an end of a range, taken up by what may have led it
    there."""
    seen_share: float = 0.04
    """Or such a share of the largest gain, where the misfit is large."""
    not_enough: float = 4.0
    """log10 evidence by which a pair leads a single effect that explains, from which on all pairs
    are looked for: a flexible effect may hide two others."""
    rival: float = 0.2
    """Share of the largest gain below which an effect is fitted only if the likelier fail, or if it
    is curved."""
    far: float = 20.0
    """Of the cost: an explanation so much worse than one that serves is out of the race,"""
    far_share: float = 0.03
    """with such a share of what that one gained on top,"""
    far_later: float = 60.0
    """and later without it: ten decades and more, of which other errors may give back eight."""
    most_singles: int = 8
    """Single effects that are fitted,"""
    abreast: int = 2
    """so many at a time, by any number of workers: what one explains ends the next ones early."""
    leaders: int = 4
    """Of these, so many get partners,"""
    partners: int = 5
    """so many each,"""
    most_pairs: int = 8
    """and so many pairs are fitted in all."""
    again: int = 2
    """Effects that explain nothing, but most: fitted from elsewhere too; of pairs, gone on with."""
    half: float = 0.5
    """Of what the better half of the best pair takes off the cost: the other half gets further
    partners too. Of a preload and a stiffening it took 0.66; where 0.37, none of eight served."""
    members: int = 4
    """Of pairs that explain: tried alone."""
    rivals: int = 3
    """Other single effects, whose partners are tried as well where a pair leads,"""
    rival_pairs: int = 4
    """and so many of these pairs are fitted."""
    looks: int = 2
    """Explanations beside the best whose errors are learned as well,"""
    doubt: float = 8.0
    """where they are less than so much log10 evidence behind: what an integral over errors that are
    not theirs took from an explanation was 4, what a fit by wider errors took from one 8."""
    sharpened: int = 6
    """So many of these are fitted again by the errors of the best."""
    range_decades: float = 1.5
    """log10 evidence that an integral along a range may change: 1.3 was the most,"""
    along: int = 7
    """and of how many it is taken, the model as it is among them."""
    screened: tuple[float, ...] = (0.3, 0.1, 0.03)
    """Of a typical size, at which effects are screened: about linear; the first that skins bear."""
    invisible: float = 1e-2
    """Standard deviations: a signature so small cannot be seen at all."""
    prior_sizes: float = 3.0
    """A prior's standard deviation, in sizes that are seen in practice;"""
    prior_decades: float = 0.8
    """the same for a parameter that has no zero, in decades."""
    families: int = 8
    """Families of learned functions that promise most: fitted, with"""
    scales: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)
    """priors of the function, in that of its declaration; equally likely."""
    nodes_per_look: int = 4
    """Settings of the errors from each look, for evidence of parts of the data."""


@dataclass(frozen=True)
class NameRules:
    """What a name needs. docs/missing-effect.md tells them in words."""

    tie: float = 1.3
    """log10 evidence by which the best has to lead: 20 to 1."""
    lone_tie: float = 4.0
    """The same where one condition only was measured: no other one bears an explanation out."""
    second: float = 3.0
    """log10 evidence by which a pair has to lead one of its members that explains alone: errors
    that no model of them has were worth 2.3 (one hidden), second effects 3.2 and more."""
    cancelling: float = 0.25
    """Share of what one effect of a pair does alone, below which both cancel: a sensor that rings,
    told as two lags, 0.18; 82 true pairs 0.64 and more."""
    held_out_ratio: float = 1.2
    """Of the gap on what was left out to what is expected there."""
    learned_out_ratio: float = 1.3
    """The same of a learned function: what it leaves at the end of its form counts in each part."""
    held_out_chance: float = 1.3
    """log10 of the ratio of predictive densities of what was left out: 20 to 1 against chance."""
    practical_um: float = 1.0
    """Root mean square that an effect has to change the curves by after the law's parameters have
    been fitted again: a tenth of the coarsest sensor's step, below every sensor's noise."""
    practical_share: float = 0.05
    """Or a parameter of the law, out of its interval: half of what placements scatter by."""
    practical_change: float = 0.02
    """The same of a parameter that has no logarithm, ν."""
    smooth_sizes_um: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0)
    """Sizes, equally likely, of a smooth error of the model, which competes for every gap: tight,
    or it explains everything (Brynjarsdottir and O'Hagan 2014). Two meshes: 0.3 to 2 µm."""
    smooth_degree: int = 4
    """Of the smooth error, a polynomial in p/p_max, loading and unloading apart."""
    steps: float = 4.0
    """Standard deviations of chance by which an explanation may leave steps beyond 1 µm."""
    small_steps: float = 3.0
    """The same of all of each step, of what adds to the reading by time alone: three tapes that let
    go by 3 to 12 µm, called a drift, the zero's wander among their errors, left 2 to 7;"""
    no_fewer: float = -1.0
    """where those beyond 1 µm are no fewer than by chance: of 20 right names -2 and less."""
    steps_left: float = 0.03
    """Or, of a learned function, such a share of those that the model as it is leaves: a loop whose
    turn it follows nearly left 1 to 2 %, functions learned of tape that jumps 50 to 95 %."""
    near: float = 0.5
    """Cosine between what a learned function and a named effect do to the curves, above which the
    name is told as the nearest."""
    learned_left: float = 0.1
    """Of the noise's mean square: what a learned function may leave though it is no noise. A few
    shapes follow an unknown form to a third of the noise, not to its end."""
    learned_share: float = 0.2
    """The same of what the model as it is leaves beyond noise."""
    smooth_motion: float = 0.75
    """Of `largest_um`, all together: from here on what moves in each curve in its own way is no
    error, where it is smoother than errors are."""
    wave_um: Mapping[str, float] = field(default_factory=lambda: {"pulse": 2.6, "breathing": 4.4})
    """Root mean squares from which on a pulse or a breath that repeats bear out is told of: a
    quarter more than those of life at most (amplitudes of 3 and 5 µm)."""
    alike_by_chance: float = 1e-4
    """Of curves' phases, below which a motion as fast as a breath or a pulse is in step: of ten
    frequencies, which a record of 10 s tells apart there, one is mistaken once in a thousand."""
    phase_known: float = 5.0
    """Standard deviations from which on a curve's motion tells its phase as well as any."""
    same_motion: float = 2.0
    """Times the size that a model says of a motion, up to which what is found is the same one."""
    unasked: float = 6.0
    """log10 evidence of a learned function where what the model as it is leaves may be errors: with
    nothing hidden functions promised 2.7 at most (12 campaigns), a bent sensor 14."""
    learned_tail: float = 0.03
    """Or so much of what the model as it is leaves beyond noise, where that is large,"""
    learned_rest: float = 0.4
    """and up to so much of the noise: the gap stays below 1.2 times the noise."""
    repeats_factor: float = 2.0
    """Repeats that differ by more than so many times the noise are told of first."""
    noise_factor: float = 2.0
    """Of noise that is more than so many times the stated one it is told."""
    astray: float = 2.0
    """An optimum by straight lines that leaves so many times what the fit leaves is none."""
    contradicted: float = 9.0
    """By so much less is χ² without a model's own priors of effects where the data contradict them:
    of the right ones once in 370."""
    known: float = 0.3
    """Of its prior's standard deviation: an unknown that is known no better is not told."""
    tried_rivals: int = 3
    """Explanations that a name has to beat again without some of the data,"""
    most_tied: int = 4
    """and that a next measurement is looked for."""
    significant: float = 0.01
    """Of a p value: places of a residual that are told of."""
    most_decades: float = 4.0
    """Of odds: beyond, the figure says more than any library of explanations can know."""


@dataclass(frozen=True)
class PlanRules:
    """What further measurements cost, and when a plan is worth telling.

    Times are those of a visit as docs/bedside.md describes it, not measured in a clinic. All of it
    moves "advice settles" of benchmarks/missing_effect.py.
    """

    tie: float = NameRules.tie
    """log10 evidence by which an explanation has to lead."""
    lone_tie: float = NameRules.lone_tie
    """The same where no other condition is measured."""
    settled: float = 0.9
    """Probability of the right name, whichever is true, from which on a plan settles it: four of
    five shall, some ties nothing settles, and errors in life are less regular than planned."""
    least_gain: float = 0.05
    """Gain of that probability below which a measurement is not worth its time."""
    useless: float = 0.3
    """Expected log10 evidence, below which it tells nothing either: 2 to 1."""
    placement_min: float = 1.5
    """Minutes to put the probe on and off, and for the skin to recover."""
    opening_min: float = 2.0
    """Minutes to change the opening."""
    as_sure: float = 0.03
    """Of that probability: of measurements that are as good but for this the quickest is taken."""
    most_placements: int = 8
    """Of one measurement: a quarter of an hour."""
    most_measurements: int = 4
    """Of a plan."""
    most_minutes: float = 30.0
    """Of a plan: a visit."""
    most_dose_mbar_s: float = 50_000.0
    """The same: one site may have 60,000 (docs/safety.md), and what is late counts as well."""
    tops_mbar: Mapping[float, int] = field(
        default_factory=lambda: {2.0: 400, 4.0: 200, 6.0: 100, 8.0: 100}
    )
    """By the opening in mm: suctions at which skins dome about alike. Beyond, they crease, and two
    meshes differ by more than is counted with."""
    of_crease: float = 0.9
    """Suctions go up to this share of that at which the skin creases: a placement may be softer."""
    least_top_mbar: int = 30
    """An opening whose skin does not bear as much is left out."""
    slow_s: int = 25
    """Up, and again down: suction without a pause may last 60 s, and samples tell."""
    slow_behind_s: int = 20
    """The same behind a jump that is held."""
    settings: int = 3
    """Of the errors, for which outcomes are drawn."""
    outcomes: int = 256
    """Drawn of each explanation, for each of these."""
    behind: float = 3.0
    """log10 evidence up to which an explanation behind the tied ones may come back."""
    most: int = 6
    """Explanations that are weighed."""
    beam: int = 6
    """Plans that are gone on with."""


ERRORS = ErrorRules()
FITS = FitRules()
SEARCH = SearchRules()
NAMES = NameRules()
PLANS = PlanRules()
