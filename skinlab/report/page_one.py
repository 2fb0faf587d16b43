"""Page one of a session's report: what goes on file, in words. Methods stand behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from skinlab.errors import SkinlabError
from skinlab.inference.identify import Identifier
from skinlab.inference.result import Identification
from skinlab.mechanics.names import heading, label, parameter_of
from skinlab.recording.audit import entries
from skinlab.recording.session import Session
from skinlab.recording.session_fit import comparable, excluded_of, fit_curves
from skinlab.report.measured import Measured, scolded
from skinlab.report.page import Illustration, Section, Table
from skinlab.report.rounding import Interval, best_words, interval_words
from skinlab.report.text import explain
from skinlab.report.verdict import Step, Use, Verdict, judge, step_words


@dataclass(frozen=True, eq=False)
class Together:
    """The joint answer of a session, or a sentence why there is none; `used` are curve names."""

    answer: Identification | str
    used: tuple[str, ...]


def fit_together(session: Session, identifier: Identifier | str) -> Together:
    """Return what the comparable curves of a session say together; takes about a second."""
    curves = comparable(session.curves, excluded_of(session))
    used = tuple(curve.name for curve in curves)
    if isinstance(identifier, str):
        return Together(f"there is none, because {identifier}", used)
    if identifier.model.effects and len(curves) > 1:
        return Together("a joint fit with effects takes minutes: skinlab identify --joint", used)
    try:
        return Together(fit_curves(identifier, "the session", curves), used)
    except SkinlabError as error:
        return Together(str(error), used)


def page_one(
    session: Session,
    curves: Sequence[Measured],
    together: Together,
    figures: Sequence[Illustration] = (),
    more: Sequence[Section] = (),
) -> Section:
    """Return the section: verdict, values, what was left out, notes, next step."""
    if not curves:
        return Section("Result", ("The session holds no curves.",))
    verdicts = {m.curve.name: verdict_of(m) for m in curves}
    reasons = why_left_out(session, curves, together.used)
    answer = together.answer
    paragraphs = [_in_one_sentence(curves, verdicts, reasons)]
    if not any_stored(curves) and has_values(answer):
        paragraphs.append("The session stores no values; these were computed for this page.")
    tables = []
    if isinstance(answer, str):
        paragraphs.append(f"No values of all curves together: {answer}.")
    elif answer.error is not None:
        paragraphs.append(f"No values: {answer.error}.")
    else:
        how = "of one curve" if len(together.used) == 1 else f"of {len(together.used)} curves"
        tables.append(_values(answer, f"Values {how} with 90 % intervals"))
        paragraphs += explain(answer)
    points = [f"{name} is left out: {why}." for name, why in reasons.items()]
    points += [f"Note: {note}" for note in notes_of(session)]
    paragraphs.append(f"Next step: {next_step(verdicts, answer)}")
    sections = [Section("Left out, and notes", points=points)] if points else []
    if figures:
        sections.append(Section("The curves", figures=figures))
    return Section("Result", paragraphs, tables, sections=[*sections, *more])


def any_stored(curves: Sequence[Measured]) -> bool:
    """Return whether the session has an answer of any curve: an imported one has none."""
    return any(m.result is not None for m in curves)


def has_values(answer: Identification | str) -> bool:
    """Return whether there is a joint answer."""
    return isinstance(answer, Identification) and answer.error is None


def verdict_of(measured: Measured) -> Verdict | None:
    """Return whether a curve can be used."""
    return judge(
        measured.result,
        scolded(measured),
        measured.judged.cut,
        partial=measured.curve.partial,
        for_effect=measured.for_effect,
    )


def why_left_out(
    session: Session, curves: Sequence[Measured], used: Sequence[str]
) -> dict[str, str]:
    """Return why a curve does not count in the joint answer, by its name."""
    reasons = excluded_of(session)
    found = {}
    for measured in curves:
        name = measured.curve.name
        if name in used:
            continue
        if name in reasons:
            found[name] = f"by the operator ({reasons[name]})" if reasons[name] else "by hand"
        elif measured.curve.partial:
            cut = measured.judged.cut
            found[name] = f"it was cut short{f' ({cut})' if cut else ''}"
        else:
            cycle = measured.curve.setup.cycle
            found[name] = f"it is loading {cycle} of the site, and softer than a first one"
    return found


def notes_of(session: Session) -> list[str]:
    """Return the operator's notes."""
    return [str(e.detail.get("text", "")) for e in entries(session.records) if e.what == "note"]


def _in_one_sentence(
    curves: Sequence[Measured],
    verdicts: Mapping[str, Verdict | None],
    reasons: Mapping[str, str],
) -> str:
    good = [n for n, v in verdicts.items() if v is not None and v.use is Use.GOOD]
    bad = {n: v for n, v in verdicts.items() if v is not None and v.use is not Use.GOOD}
    count = "One curve" if len(curves) == 1 else f"{len(curves)} curves"
    if len(good) == len(curves):
        words = "it is good" if len(curves) == 1 else "all are good"
    elif good:
        words = f"{len(good)} good"
    elif not any_stored(curves):
        words = "not identified one by one" if len(curves) > 1 else "not identified before"
    else:
        words = "none is good"
    counted = [n for n in bad if n not in reasons]
    doubt = f" Read with care: {'; '.join(f'{n}: {bad[n].why}' for n in counted)}." * bool(counted)
    return f"{count}; {words}.{doubt}"


def _values(answer: Identification, caption: str) -> Table:
    rows = []
    for name, value in (answer.parameters or {}).items():
        declared = parameter_of(name)
        fixed = f"not_identifiable:{name}" not in answer.flags
        rows.append(
            (
                heading(name),
                "" if declared is None else declared.meaning,
                _interval(value),
                best_words(value) if fixed else "not fixed by these curves",
            )
        )
    return Table(("quantity", "what it is", "between", "best value"), rows, caption)


def _interval(value: Interval) -> str:
    if value.low is None or value.high is None:
        return "no interval"
    return interval_words(value).replace("–", " to ")


def next_step(verdicts: Mapping[str, Verdict | None], answer: Identification | str) -> str:
    """Return the one thing to do next, as a sentence."""
    known = [v for v in verdicts.values() if v is not None]
    good = sum(v.use is Use.GOOD for v in known)
    if not known and has_values(answer):  # of an imported session: nothing speaks against it
        good = len(verdicts)
    if good == 0:
        return step_words(known[-1]) if known else "Measure again."
    if isinstance(answer, Identification) and answer.error is None:
        loose = [
            label(f.partition(":")[2]) for f in answer.flags if f.startswith("not_identifiable:")
        ]
        if loose:
            joined = " and ".join(loose)
            opening = "Measure the rested site with another opening too, and fit all together"
            return f"{opening}: these curves do not fix {joined}."
        if "misfit_above_noise" in answer.flags:
            return step_words(Verdict(Use.REPEAT, "", Step.LOOK_FOR_EFFECT))
    return "Repeat it to see how much it scatters." if good == 1 else "Nothing has to be done."
