"""What a name is worth: adopt it, then measure the same skin anew under new placements.

    python benchmarks/adopted.py [--campaigns 24] [--first 0] [--seed 1] [--workers 2]

Campaigns are those of the part `life_single` (`challenge/campaigns.py`): one effect hidden, errors
as in life, three placements an opening. Where the workflow names or learns something, the model
with it is adopted, and a second campaign of the same skin is made: the same programs, with errors
and placements drawn afresh. The adopted model explains it if the verdict is `none` and its gap is
within 1.2 times what the errors leave. The model without the effect is asked too. Every campaign is
one line of `results/missing_effect_adopted.jsonl`, so that a run goes on where the last one ended.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from challenge.campaigns import LIFE, PARTS, curve_of, make
from challenge.score import share
from missing_effect import RESULTS, read, version_of

from skinlab.discrepancy.adopt import adopted
from skinlab.discrepancy.outcome import Outcome
from skinlab.discrepancy.workflow import explain
from skinlab.mechanics.effects.model import forget
from skinlab.mechanics.model_file import BASE
from skinlab.tables.store import shipped_table

PART = "life_single"
LINES = RESULTS / "missing_effect_adopted.jsonl"
PLACEMENTS = 3
CLOSED = 1.2  # of what the errors leave


def judge(seed: int, version: str, number: int) -> dict[str, Any]:
    """Return the line of one campaign."""
    forget()
    truth, made = make(PART, seed, number)
    forget()
    table = shipped_table()
    first = explain(made.campaign, table)
    line: dict[str, Any] = {
        "part": PART, "seed": seed, "number": number, "version": version,
        "hidden": sorted(truth.effects), "values": truth.effects,
        "life": None if truth.life is None else vars(truth.life), "verdict": first.verdict.name,
        "effects": [sorted(c.effects) for c in first.verdict.explanations],
    }  # fmt: skip
    if not first.verdict.explains:
        return line
    model = adopted(
        BASE, first, data={}, database_hash=table.content_hash, now=datetime(2026, 1, 1, tzinfo=UTC)
    )
    rng = np.random.default_rng([seed, PARTS.index(PART), number, 3])
    forget()
    drawn = [
        curve_of(truth, (*entry, 1 + i), rng) for i in range(PLACEMENTS) for entry in LIFE
    ]  # fmt: skip
    forget()
    curves = tuple(one[0] for one in drawn if one is not None)
    again = replace(made.campaign, curves=curves)
    line["curves"] = len(curves)
    line["with"] = _said(explain(again, table, model=model))
    line["without"] = _said(explain(again, table))
    return line


def _said(outcome: Outcome) -> dict[str, Any]:
    gap = outcome.gap_before
    return {
        "verdict": outcome.verdict.name,
        "effects": [sorted(c.effects) for c in outcome.verdict.explanations],
        "gap_um": gap.rms_um,
        "noise_um": gap.noise_um,
        "expected_um": gap.expected_um,
    }


def figures(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return counts with 90 % intervals (Clopper and Pearson)."""
    taken = [line for line in lines if "with" in line]
    closed = [x["with"]["gap_um"] <= CLOSED * x["with"]["expected_um"] for x in taken]
    open_before = [x["without"]["gap_um"] > CLOSED * x["without"]["expected_um"] for x in taken]
    return {
        "campaigns": len(lines),
        "adopted": len(taken),
        "right": share(x["hidden"] in x["effects"] for x in taken),
        "gap_closed": share(closed),
        "gap_open_without": share(open_before),
        "no_second_name": share(x["with"]["verdict"] not in ("named", "learned") for x in taken),
        "none_left": share(x["with"]["verdict"] == "none" for x in taken),
    }


def main() -> None:
    """Run, append, summarise."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--lines", type=Path, default=LINES)
    arguments = parser.parse_args()
    version = version_of()
    done = {(x["seed"], x["number"]) for x in read(arguments.lines, version)}
    numbers = range(arguments.first, arguments.first + arguments.campaigns)
    numbers_left = [n for n in numbers if (arguments.seed, n) not in done]
    with ProcessPoolExecutor(arguments.workers) as pool, arguments.lines.open("a") as out:
        work = [pool.submit(partial(judge, arguments.seed, version), n) for n in numbers_left]
        for job in as_completed(work):
            line = job.result()
            out.write(json.dumps(line, ensure_ascii=False) + "\n")
            out.flush()
            then = {k: line[k]["verdict"] for k in ("with", "without") if k in line}
            print(line["number"], line["hidden"], line["verdict"], line["effects"], then)
    lines = [x for x in read(arguments.lines, version) if x["seed"] == arguments.seed]
    print(json.dumps(figures(lines), indent=1))


if __name__ == "__main__":
    main()
