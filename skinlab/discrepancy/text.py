"""The outcome in sentences, for a terminal and a report."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from skinlab.discrepancy.adequacy import Place
from skinlab.discrepancy.candidates import (
    Candidate,
    Partial,
    are_several,
    behind_best,
    outdone,
)
from skinlab.discrepancy.next_measurement import Plan
from skinlab.discrepancy.odds import chance_words, each_behind, odds_words, than_none_words
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.settings import ERRORS, NAMES, PLANS
from skinlab.inference.flags import CATALOGUE
from skinlab.mechanics.names import effect_words, is_effects, parameter_of, plain
from skinlab.text import counted, inert

_SHOWN = 5
_BY_CHANCE = 0.1  # from here on how often chance does as much says nothing
_ROWS = 6  # of a learned function
_TIED = 3  # explanations whose values are told
_MOST_TIMES = 6  # of glitches that repeats share, which are told
_NAME_WIDTH, _VALUE_WIDTH = 28, 32  # of columns of parameters, at least


def verdict_words(outcome: Outcome) -> str:
    """Return the verdict in a sentence or two, and of which own effects the sizes are others."""
    unlike = CATALOGUE["unlike_model"].meaning
    return " ".join([_verdict(outcome), *(unlike.format(e) for e in outcome.unlike_model)])


def _verdict(outcome: Outcome) -> str:
    own = set(outcome.found.base.effects)
    names = [explanation_words(c, own) for c in outcome.verdict.explanations]
    match outcome.verdict.name:
        case "none" if not (outcome.found.base.adequate or outcome.trials):
            chance = chance_words(outcome.found.base.left.p_value)
            return (
                "Nothing is missing, as far as these data tell: noise seldom leaves as much as "
                f"the model does ({chance}), but nothing explains it, and what was "
                "left out is predicted about as well as is expected."
            )
        case "none" if not outcome.found.base.adequate or _failed(outcome) == {"size"}:
            return (
                f"Nothing is missing that would change the curves by {NAMES.practical_um:g} µm, or "
                f"a parameter by {100.0 * NAMES.practical_share:.0f} %, though these data show "
                "more than noise."
            )
        case "none" if _failed(outcome):
            return (
                "Nothing has a name: the model explains the data to within the noise, and what is "
                "likelier did not stand the trials of a name."
            )
        case "none":
            return (
                "Nothing is missing, as far as these data tell: the model explains them to within "
                "the noise."
            )
        case "named":
            return f"Missing: {names[0]}."
        case "learned":
            assert outcome.learned is not None
            return f"Learned: {outcome.learned.sentence}."
        case "ambiguous":
            tied = f"Something is missing, and these explanations are tied: {'; '.join(names)}."
            return f"{tied}{in_all_words([c.effects for c in outcome.verdict.explanations], own)}"
        case "unknown":
            return f"Something is missing{_unknown_words(outcome)}.{_kinds_words(outcome)}"


def _unknown_words(outcome: Outcome) -> str:
    """Return why something is missing that has no name: the rest of a sentence."""
    found = outcome.found
    failed = [trial.sentence for trial in outcome.trials if not trial.passed]
    if failed:
        return f". What would explain it to within the noise is not to be believed: {failed[0]}"
    if not any(c.adequate for c in (found.base, *found.candidates)):
        return ", and nothing in the library explains it to within the noise"
    if found.implausible:
        return (
            ". What leaves no more than errors is not to be believed, since these are too large: "
            f"{found.implausible}"
        )
    if outdone(found.candidates):
        return (
            ". What would explain it to within the noise is not to be believed: something that "
            "leaves more is 20 times likelier"
        )
    return (
        ". What would explain it to within the noise is not to be believed: for a name it is "
        "too little likelier than the model as it is"
    )


def _kinds_words(outcome: Outcome) -> str:
    """Return between which kinds of functions the data cannot decide."""
    kinds = [kind.replace("_", " ") for kind in outcome.kinds]
    if not kinds:
        return ""
    return f" Smooth functions of several kinds explain it equally well: {', '.join(kinds)}."


def in_all_words(explanations: Sequence[Collection[str]], own: Collection[str] = ()) -> str:
    """Return which effects all of some explanations have: of these nothing is open."""
    common = [e for e in explanations[0] if e not in own and all(e in one for one in explanations)]
    return f" All of them have {' and '.join(common)}." if common else ""


def learned_words(outcome: Outcome) -> list[str]:
    """Return what else is to be said of a learned function; none where nothing was learned."""
    learned = outcome.learned
    if learned is None:
        return []
    share = f"{100 * learned.share_of_gap:.0f} %"
    lines = [
        f"Of what the model leaves it is {share}; it counts with the errors, and no curve tells "
        "how it goes in the next."
        if learned.family.own_of_each
        else f"{_library_words(outcome)}; a smooth function was learned, which takes {share} of it "
        "away."
    ]
    if learned.nearest:
        lines.append(
            f"Of the effects with a name, the nearest is {effect_words(learned.nearest[0])}."
        )
    return lines


def _library_words(outcome: Outcome) -> str:
    """Return what the library has to say where a function was learned: most often nothing."""
    best, own = outcome.best, set(outcome.found.base.effects)
    alike = [
        _name(c, own)
        for c in outcome.found.candidates
        if c.adequate and c.kind != best.kind
        and c.log10_evidence > best.log10_evidence - NAMES.tie
    ]  # fmt: skip
    if not alike:
        return "No effect of the library explains the gap as well"
    return f"These explain it as well, but did not stand the trials of a name: {'; '.join(alike)}"


def function_rows(outcome: Outcome) -> list[tuple[str, str, str]]:
    """Return rows (x, value, 90 % band) of the learned function, a few of them."""
    learned = outcome.learned
    if learned is None:
        return []
    n = len(learned.x)
    at = np.unique(np.linspace(0, n - 1, min(n, _ROWS)).round().astype(int))
    return [
        (
            f"{learned.x[i]:z.3g}",
            f"{learned.y[i]:z.3g}",
            f"{learned.low[i]:z.3g} to {learned.high[i]:z.3g}",
        )
        for i in at
    ]


def repeats_words(outcome: Outcome) -> list[str]:
    """Return how far repeats disagree, where that is more than noise."""
    found, noise = outcome.repeats_um, outcome.gap_before.noise_um
    if found is None or found <= NAMES.repeats_factor * noise:
        return []
    return [
        f"Your repeats differ by {found:.0f} µm ({found / noise:.1f} × noise); the model cannot be "
        "judged below that."
    ]


def stated_noise_words(outcome: Outcome) -> list[str]:
    """Return by how much more noise the readings have than was stated; none where they have not."""
    model, records = outcome.error_model, outcome.found.records
    found = None if model is None else model.parameters.get("white_um")
    if found is None or not all(record.noise_is_stated for record in records):
        return []
    stated = float(np.sqrt(np.mean([r.noise_um**2 * r.coarse for r in records])))
    if found <= NAMES.noise_factor * stated:
        return []
    return [
        f"Each reading is off by {found:.2g} µm, where a noise of {stated:.2g} µm is stated: all "
        "is judged by what the readings show. Check the statement; if it is right, look for "
        "movement and contact."
    ]


def left_out_words(outcome: Outcome) -> list[str]:
    """Return how many samples were left out, in a sentence; none where all count."""
    each = [f"{counted(n, 'sample')} of {inert(f)}" for f, n in outcome.found.left_out.items()]
    if not each:
        return []
    lines = [f"Left out, as glitches that belong to no curve: {', '.join(each)}."]
    for one in outcome.shared_glitches:
        times = ", ".join(f"{t:.4g}" for t in one.time_s[:_MOST_TIMES])
        more = ", …" if len(one.time_s) > _MOST_TIMES else ""
        which = "both" if len(one.files) == 2 else f"all {len(one.files)}"
        lines.append(
            f"Of these, {which} repeats of {inert(one.files[0])} have some at the same "
            f"moments ({times}{more} s): what repeats share is no glitch. Something is off there "
            "that no effect was asked about, such as a valve, a filter or a sensor that rings."
        )
    return lines


def shares_words(outcome: Outcome) -> list[str]:
    """Return what the disagreement consists of."""
    shares = outcome.shares
    if shares is None:
        return []
    parts = {
        "noise": shares.noise_um, "placement": shares.placement_um, "mesh": shares.mesh_um,
        "effect": shares.effect_um,
    }  # fmt: skip
    return [
        "Of the disagreement (root mean squares): "
        + ", ".join(f"{name} {size:.1f} µm" for name, size in parts.items())
        + "."
    ]


def doubt_words(outcome: Outcome) -> list[str]:
    """Return what speaks for and against the explanation, and what the fits ran into."""
    lines = []
    if outcome.trials:
        good = not _failed(outcome)
        tied = outcome.verdict.name == "ambiguous"
        own = set(outcome.found.base.effects)
        it = "them" if are_several(outcome.best, own) else "it"
        it = _name(outcome.best, own) if tied else it
        lines.append(f"What stands behind {it}:" if good else f"{_doubted(outcome)}, because:")
        lines += [f"  {t.sentence}" for t in outcome.trials if good or not t.passed]
    lines += _open_words(outcome)
    if outcome.found.implausible:
        lines.append(f"Too large for errors of a measurement: {outcome.found.implausible}.")
    left = (outcome.verdict.explanations or [outcome.found.base])[0].left
    moves = outcome.learned is not None and outcome.learned.family.own_of_each
    if not moves and left.by_errors < ERRORS.adequate <= left.p_value:
        lines.append(
            "What is left is not quite noise, but each repeat has it for itself: it is not the "
            "model's fault."
        )
    own = set(outcome.found.base.effects)
    shown = [outcome.found.base, *outcome.found.candidates[:_SHOWN]]
    for candidate in shown:
        if candidate.at_bound:
            lines.append(
                f"The fit of {_name(candidate, own) or 'the model as it is'} ended at a bound of "
                + ", ".join(plain(name)[0] for name in candidate.at_bound)
                + ": stronger values were not allowed."
            )
    return lines


def _failed(outcome: Outcome) -> set[str]:
    """Return the trials that the first explanation did not stand."""
    return {trial.name for trial in outcome.trials if not trial.passed}


def _doubted(outcome: Outcome) -> str:
    """Return who gets no name: the beginning of a sentence."""
    one = outcome.doubted
    if one is None:
        return "No name is given"
    own = set(outcome.found.base.effects)
    name, several = _name(one, own), are_several(one, own)
    if _failed(outcome) == {"size"}:
        return f"{name} {'are' if several else 'is'} too small for a name"
    return f"{name} seemed to be there and {'get' if several else 'gets'} no name"


def _open_words(outcome: Outcome) -> list[str]:
    """Return what the law's parameters would be with what is not ruled out; mostly none."""
    held, own = outcome.parameters(outcome.best), set(outcome.found.base.effects)
    lines = []
    for one in outcome.not_ruled_out:
        would = outcome.parameters(one)
        others = [
            f"{plain(name)[0]} {_value(would[name])}"
            for name, known in held.items()
            if not is_effects(name) and not known["low"] <= would[name]["value"] <= known["high"]
        ]
        if not others:
            continue
        it, them, are = ("they", "them", "are") if are_several(one, own) else ("it", "it", "is")
        who = f"If {it} {are} there all the same"
        if one is not outcome.doubted:
            odds = than_none_words(one.log10_evidence)
            who = f"{_name(one, own)} {are} not ruled out ({odds}). With {them}"
        lines.append(f"{who}, other values are right: {', '.join(others)}.")
    return lines


def lead_words(outcome: Outcome) -> list[str]:
    """Return by how much the name leads, in a sentence; none where nothing is named."""
    if outcome.verdict.name != "named":
        return []
    best = outcome.best
    other = [c for c in outcome.found.candidates if c is not best and c.log10_evidence > 0]
    second = max(other, key=lambda c: c.log10_evidence, default=None)
    odds = odds_words(best.log10_evidence - (second.log10_evidence if second else 0.0))
    own = set(outcome.found.base.effects)
    rival = explanation_words(second, own) if second else "none at all"
    it_is = "They are" if are_several(best, own) else "It is"
    return [
        f"{it_is} {odds} likelier than {'the next, ' if second else ''}{rival}, "
        "if the truth is in the library."
    ]


def places_words(outcome: Outcome) -> str:
    """Return what the places are: a heading."""
    if not outcome.where or outcome.where[0].p_value < NAMES.significant:
        return "Where the model as it is disagrees"
    return "Where the model as it is leaves most, though no place stands out by itself"


def where_words(place: Place) -> str:
    """Return one place in a line."""
    low, high = (round(p) for p in place.pressure_mbar)  # whole: there is no -0
    begin, end = place.time_s
    chance = f"; {chance_words(place.p_value)}" if place.p_value < _BY_CHANCE else ""
    return (
        f"{inert(place.file)}, {place.phase}, {low}–{high} mbar, {begin:z.1f}–{end:z.1f} s: "
        f"{place.mean_um:+z.1f} µm on average (noise {place.noise_um:.1f} µm a sample{chance})"
    )


def parameter_table(outcome: Outcome) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return heads, and rows (name, before, after) with 90 % intervals.

    Where nothing is explained, nothing comes after: (name, value). Explanations that are tied have
    values of their own; those of the first few are told.
    """
    columns = {"value": outcome.parameters(outcome.found.base)}
    if outcome.verdict.explanations:
        columns = {"before": columns["value"]} | {
            after: outcome.parameters(one) for after, one in explained_by(outcome)
        }
    rows = []
    names = dict.fromkeys(name for column in columns.values() for name in column)
    for name in sorted(names, key=is_effects):  # the law's first
        label, unit = plain(name)
        values = (_value(column.get(name)) for column in columns.values())
        rows.append((f"{label} ({unit})" if unit else label, *values))
    return ["parameter", *columns], rows


def explained_by(outcome: Outcome) -> list[tuple[str, Candidate]]:
    """Return what comes after: the explanation; where some are tied, the first few, by name."""
    explanations = outcome.verdict.explanations
    if outcome.verdict.name != "ambiguous":
        return [("after", outcome.best)] if explanations else []
    own = set(outcome.found.base.effects)
    return [(f"with {_name(one, own)}", one) for one in explanations[:_TIED]]


def values_words(outcome: Outcome) -> str:
    """Return what the columns of parameters are of."""
    if not outcome.verdict.explanations:
        return "Values with 90 % intervals, by the model as it is."
    if outcome.verdict.name != "ambiguous":
        return "Values with 90 % intervals. The change is the bias that the missing effect caused."
    count = len(outcome.verdict.explanations)
    which = (
        "the tied explanations" if count <= _TIED else f"the first {_TIED} of {count} that are tied"
    )
    return (
        f"Values with 90 % intervals, by the model as it is and by {which}. Which of these is true "
        "is open, and so are the values."
    )


def _parameter_lines(outcome: Outcome) -> list[str]:
    """Return the same in columns as wide as their longest cells."""
    (_, *heads), rows = parameter_table(outcome)
    lines = [("", *(f"{head:>12}" for head in heads)), *rows]
    least = (_NAME_WIDTH, *(_VALUE_WIDTH for _ in heads))
    widths = [
        max(width, 2 + max(len(cell) for cell in cells))
        for width, cells in zip(least, zip(*lines, strict=True), strict=True)
    ]
    padded = ([f"{c:<{w}}" for c, w in zip(line, widths, strict=True)] for line in lines)
    return [f"  {''.join(line)}".rstrip() for line in padded]


def gap_words(outcome: Outcome) -> str:
    """Return the gap before and after in a sentence."""
    before, after = outcome.gap_before, outcome.gap_after
    what = (
        "on conditions held out of the fit"
        if before.files
        else "of the fit itself (one condition only: nothing could be held out)"
    )
    weighed = f"{before.rms_um:.1f} µm ({before.rms_um / before.noise_um:.1f} × noise)"
    text = f"Gap {what}: {before.plain_um:.1f} µm"
    if outcome.verdict.explanations:
        name = explained_by(outcome)[0][0]  # "after", or of which one
        text += f" before, {after.plain_um:.1f} µm {name}"
        weighed += (
            f" before, {after.rms_um:.1f} µm ({after.rms_um / after.noise_um:.1f} × noise) {name}"
        )
    slow = "errors that last" if outcome.placement is None else "placements and errors that last"
    return f"{text}. Less what {slow} may have done: {weighed}."


def next_words(outcome: Outcome) -> list[str]:
    """Return what to measure next in a sentence, none where nothing is to be told apart."""
    following = outcome.next_measurement
    if following is None:
        return []
    own = set(outcome.found.base.effects)
    lines = [
        f"To tell them apart, measure {following.program} with the {following.aperture_mm:g} mm "
        f"opening{_times(following.placements)}: it is expected to make one of them "
        f"{odds_words(following.expected_log10_evidence)} likelier."
    ]
    if following.alone is not None:
        lines.append("That " + _prospect(following.alone, own))
    plan = following.plan
    if plan is not None and (
        following.alone is None or plan.measurements != following.alone.measurements
    ):
        steps = ", then ".join(
            f"{m.program} with the {m.aperture_mm:g} mm opening{_times(m.placements)}"
            for m in plan.measurements
        )
        enough = plan.sure >= PLANS.settled
        said = "The shortest plan that would settle it" if enough else "No plan is sure; the best"
        lines.append(f"{said}: {steps}. It {_prospect(plan, own)}")
    return lines


def alike_words(outcome: Outcome) -> list[str]:
    """Return which effects these data cannot tell apart, in a sentence; none where they can."""
    pairs = "; ".join(f"{a} and {b}" for a, b in outcome.alike)
    return [f"With these measurements nobody could tell apart: {pairs}."] if pairs else []


def _times(placements: int) -> str:
    return "" if placements == 1 else f", putting the probe on {placements} times"


def _prospect(plan: Plan, own: set[str]) -> str:
    """Return what a plan costs and is expected to lead to."""
    each = ", ".join(
        f"{' and '.join(e for e in names if e not in own)} {100 * p:.0f} %"
        for names, p in plan.named
    )
    return (
        f"takes {plan.minutes:.0f} min; chances of a name: {each}; of a wrong one "
        f"{100 * plan.wrong:.0f} %, of no decision {100 * plan.tied:.0f} %."
    )


def _size_words(name: str, size: float) -> str:
    """Return a size with its unit: 0.004 s."""
    declared = parameter_of(name)
    unit = "" if declared is None else declared.unit
    return f"{size:.3g}{unit and ' '}{unit}"


def limits_words(
    outcome: Outcome, size_words: Callable[[str, float], str] = _size_words
) -> list[str]:
    """Return which effects these data could have shown, and which not: the whole library.

    `size_words` says the size of a parameter, by its name.
    """

    def shown(name: str, size: float) -> str:
        effect, said = name.partition(".")[0], plain(name)[0]
        return f"{effect_words(effect)}: {said.removeprefix(effect + ' ')} {size_words(name, size)}"

    lines = []
    beyond = outcome.cannot_show, outcome.not_screened
    unseen, unsought = ([f"{effect_words(n)}: {why}" for n, why in said.items()] for said in beyond)
    for heading, entries in (
        (
            "Smallest sizes that these data could have shown, of a skin as fitted:",
            [shown(name, size) for name, size in outcome.detectable.items()],
        ),
        (
            "These data cannot show:",
            unseen,
        ),
        ("Not looked for:", unsought),
    ):
        if entries:
            lines += [heading, *(f"  {entry}" for entry in entries)]
    lines.append(
        "The intervals assume that none of the effects that could not be shown or looked for is "
        "there: each can have changed the parameters without a trace in these curves."
    )
    if outcome.learned_from_these:
        lines.append(CATALOGUE["learned_from_these"].meaning)
    return lines


def describe(outcome: Outcome) -> str:
    """Return the whole text."""
    own = set(outcome.found.base.effects)
    lines = [*repeats_words(outcome), verdict_words(outcome), gap_words(outcome)]
    lines += stated_noise_words(outcome) + left_out_words(outcome)
    lines += lead_words(outcome) + learned_words(outcome)
    lines += shares_words(outcome) + doubt_words(outcome)
    if outcome.learned is not None:
        one = outcome.learned.family
        lines.append(f"The function ({one.y_name} by {one.x_name}), with its 90 % band:")
        lines += [f"  {x:>8}  {y:>9}  ({band})" for x, y, band in function_rows(outcome)]
    if outcome.where:
        lines.append(f"{places_words(outcome)}:")
        lines += [f"  {where_words(p)}" for p in outcome.where[:_SHOWN]]
    if outcome.verdict.name != "none" and outcome.found.candidates:
        lines.append("Explanations:")
        behind = each_behind(behind_best(outcome.found.candidates, own))
        for c, odds in zip(outcome.found.candidates[:_SHOWN], behind, strict=False):
            fits = "explains the data" if c.adequate else "does not explain the data"
            lines.append(f"  {explanation_words(c, own)}")
            lines.append(f"      {odds}; {fits}")
    if outcome.verdict.name == "ambiguous":
        lines.append(values_words(outcome))
    lines += _parameter_lines(outcome)
    lines += limits_words(outcome)
    lines += alike_words(outcome) + next_words(outcome)
    return "\n".join(lines)


def partial_words(partial: Partial) -> str:
    """Return what was known when somebody interrupted."""
    if partial.base is None:
        return "Interrupted before the model as it is was fitted."
    lines = ["Interrupted; known so far:"]
    left = partial.base.left
    places = [p for p in left.places[:_SHOWN] if p.p_value < NAMES.significant]
    size = "more than noise"
    if left.p_value >= ERRORS.adequate:
        size = (
            "no more than the errors, as they are known so far, could make" if places else "noise"
        )
    lines.append(f"The model as it is leaves {size} ({chance_words(left.p_value)}).")
    if places and left.p_value >= ERRORS.adequate:
        lines.append("Places that stand out all the same:")
    lines += [f"  {where_words(p)}" for p in places]
    for c in sorted(partial.candidates, key=lambda c: -c.log10_evidence):
        lines.append(
            f"  {_name(c, set(partial.base.effects)):<40} {than_none_words(c.log10_evidence)}"
        )
    return "\n".join(lines)


def explanation_words(candidate: Candidate, own: set[str]) -> str:
    """Return the effects beyond the model's own, each with what it means."""
    return " and ".join(effect_words(e) for e in candidate.effects if e not in own)


def _name(candidate: Candidate, own: set[str]) -> str:
    return " and ".join(e for e in candidate.effects if e not in own)


def _value(v: dict[str, float] | None) -> str:
    return "" if v is None else f"{v['value']:z.4g}  ({v['low']:z.4g} to {v['high']:z.4g})"
