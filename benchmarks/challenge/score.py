"""Score any program on the challenge.

    python benchmarks/challenge/score.py TRUTH ANSWERS [--save FILE.json]

ANSWERS holds a document for each campaign that the program looked at, NAME.json, with `verdict`
("none", "named", "ambiguous", "unknown" or "learned"), `effects` (a list of explanations, each a
list of effects), for "learned" `learned.family`, and, if it was measured, `cpu_seconds`: what
`skinlab discrepancy --json` prints. Campaigns without an answer are counted as such and not scored;
a file that cannot be read, or is not such a document, is no answer, and is named. So are answers
that belong to no campaign.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

VERDICTS = ("none", "named", "ambiguous", "unknown", "learned")
Document = Mapping[str, Any]


def share(hits: Iterable[bool]) -> dict[str, Any]:
    """Return a share with its 90 % interval (Clopper and Pearson)."""
    found = list(hits)
    k, n = sum(found), len(found)
    low = float(beta.ppf(0.05, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.95, k + 1, n - k)) if k < n else 1.0
    return {"share": k / n if n else None, "of": n, "low": low, "high": high}


def check(name: str, answer: Document) -> None:
    """Refuse what is no answer.

    Raises:
        ValueError: says of which campaign, and what was expected.
    """
    if answer.get("verdict") not in VERDICTS:
        raise ValueError(f"{name}: verdict {answer.get('verdict')!r}: expected one of {VERDICTS}")
    effects = answer.get("effects")
    if not isinstance(effects, list) or not all(map(_are_names, effects)):
        raise ValueError(f"{name}: effects: expected a list of explanations, each a list of names")
    if answer["verdict"] == "named" and len(effects) != 1:
        raise ValueError(f"{name}: named: expected one explanation, got {len(effects)}")
    if answer["verdict"] == "ambiguous" and len(effects) < 2:
        raise ValueError(f"{name}: ambiguous: expected two explanations, got {len(effects)}")
    if answer["verdict"] in ("named", "ambiguous") and not all(effects):
        raise ValueError(f"{name}: an explanation without a name; expected one effect or more")
    learned = answer.get("learned") or {}
    if not isinstance(learned, dict) or not isinstance(learned.get("family", ""), str | None):
        raise ValueError(f"{name}: learned {learned!r}: expected an object with a family's name")
    seconds = answer.get("cpu_seconds")
    if seconds is not None and (
        isinstance(seconds, bool)
        or not isinstance(seconds, int | float)
        or not 0.0 <= seconds < math.inf
    ):
        raise ValueError(f"{name}: cpu_seconds {seconds!r}: expected a number of seconds")


def _are_names(explanation: object) -> bool:
    return isinstance(explanation, list) and all(isinstance(e, str) for e in explanation)


def _named(answer: Document) -> bool:
    return answer["verdict"] == "named"


def _right(truth: Document, answer: Document) -> bool:
    return _named(answer) and sorted(answer["effects"][0]) == truth["effects"]


def _family_right(truth: Document, answer: Document) -> bool:
    learned = answer.get("learned") or {}
    return answer["verdict"] == "learned" and learned.get("family") in truth["families"]


def scores(truths: Mapping[str, Document], answers: Mapping[str, Document]) -> dict[str, Any]:
    """Return the figures of one program."""
    both = [(truths[name], answers[name]) for name in truths if name in answers]

    def part(*names: str) -> list[tuple[Document, Document]]:
        return [(t, a) for t, a in both if t["part"] in names]

    none, single = part("life_none"), part("life_single")
    double, outside = part("life_double"), part("life_outside")
    tied = [(t, a) for t, a in single if a["verdict"] == "ambiguous"]
    seconds = [a["cpu_seconds"] for _, a in both if a.get("cpu_seconds") is not None]
    return {
        "answered": len(both),
        "of": len(truths),
        "nothing hidden: something named": share(_named(a) for _, a in none),
        "nothing hidden: anything but none": share(a["verdict"] != "none" for _, a in none),
        "one hidden: names that are right": share(_right(t, a) for t, a in single if _named(a)),
        "one hidden: named rightly": share(_right(t, a) for t, a in single),
        "one hidden: ties with the truth": share(
            t["effects"] in [sorted(e) for e in a["effects"]] for t, a in tied
        ),
        "one hidden: explanations in a tie, mean": (
            float(np.mean([len(a["effects"]) for _, a in tied])) if tied else None
        ),
        "two hidden: named rightly": share(_right(t, a) for t, a in double),
        "two hidden: named wrongly": share(
            _named(a) and not set(a["effects"][0]) <= set(t["effects"]) for t, a in double
        ),
        "outside the library: a library name": share(_named(a) for _, a in outside),
        "outside the library: seen": share(a["verdict"] != "none" for _, a in outside),
        "outside the library: its family": share(
            _family_right(t, a) for t, a in outside if t["families"]
        ),
        "cpu_seconds_median": float(np.median(seconds)) if seconds else None,
    }


def read_truths(folder: Path) -> dict[str, Document]:
    """Return the truths of a folder by their names.

    Raises:
        ValueError: says of which file, and what was expected.
    """
    found = {}
    for file in sorted(folder.glob("*.json")):
        expected = f"{file}: expected the truth that generate.py wrote"
        try:
            truth = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise ValueError(f"{expected}: {error}") from error
        if not isinstance(truth, dict) or not {"part", "effects", "families"} <= truth.keys():
            raise ValueError(expected)
        found[file.stem] = truth
    if not found:
        raise ValueError(f"{folder}: expected the truth that generate.py wrote")
    return found


def read_answers(folder: Path) -> tuple[dict[str, Document], list[str]]:
    """Return the documents of a folder by their names, and of each that is no answer why."""
    found, lost = {}, []
    for file in sorted(folder.glob("*.json")):
        try:
            answer = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            lost.append(f"{file.name} cannot be read, and counts as no answer: {error}")
            continue
        if not isinstance(answer, dict):
            lost.append(f"{file.name} holds no JSON object, and counts as no answer")
            continue
        try:
            check(file.stem, answer)
        except ValueError as error:
            lost.append(f"{error}; it counts as no answer")
        else:
            found[file.stem] = answer
    return found, lost


def show(found: Mapping[str, Any]) -> None:
    """Print the figures."""
    for name, value in found.items():
        if not isinstance(value, dict):
            print(f"{name:45s} {value}")
        elif value["of"]:
            print(
                f"{name:45s} {100 * value['share']:5.1f} % of {value['of']:3d} "
                f"({100 * value['low']:.1f}–{100 * value['high']:.1f} %)"
            )


def main() -> None:
    """Score, print, and save if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("truth", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--save", type=Path)
    arguments = parser.parse_args()
    for folder in (arguments.truth, arguments.answers):
        if not folder.is_dir():
            parser.error(f"{folder}: no such folder")
    try:
        truths = read_truths(arguments.truth)
    except ValueError as error:
        parser.error(str(error))
    answers, said = read_answers(arguments.answers)
    if others := [name for name in answers if name not in truths]:
        said.append(f"answers without a truth, not scored: {', '.join(others)}")
    for sentence in said:
        print(f"{parser.prog}: {sentence}", file=sys.stderr)
    found = scores(truths, answers)
    show(found)
    if arguments.save is not None:
        try:
            arguments.save.write_text(json.dumps(found, indent=1) + "\n")
        except OSError as error:
            parser.error(f"--save {arguments.save}: {error.strerror}")


if __name__ == "__main__":
    main()
