"""The page that sets our numbers beside the paper's."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skinlab.reproduction.part import Comparison, Part
from skinlab.reproduction.study import Study

_HEAD = """\
# The paper again

“A new stochastic inverse identification of the mechanical properties of human skin”: its tables
and figures, computed again with the finite elements, the grid and the methods in this package.
Written by `skinlab paper{seed}`; the same command writes the same page, and on the same machine the
same numbers: RLS and Gauss-Newton hang on the last digits, which processors round differently.

The paper's grid (1,360 curves, 6 mm opening, 1 mm of skin), its box (X1 0.01–0.1 MPa, X2 0.1–4.9
MPa, ν 0.2–0.48) and cubic Lagrange interpolation are used throughout. Only the paper's text and
tables were at hand, not the points of its figures: figures are compared with what the text says of
them.

Formulas, where the print does not work:

- E of eq. (11), which is missing in the text, is (1/u)·√Σd², u the number of samples. With it the
  distance between the curves of Table 2's Gauss-Newton row and of its stochastic rows is what the
  table says.
- Eq. (13) uses F = ∂Ω/∂x; with ∂D/∂x as printed the step climbs.
- Eqs. (14) to (16): H = ∂Ω(p_t)/∂x is a row, A = P Hᵀ (H P Hᵀ + λ)⁻¹, P ← (P − A H P) / λ, and λ
  starts at λ0.
- Eq. (10) with ρ = 0.99 and e = 0.01 asks for N ≥ 459: N = 100 breaks it. It speaks of one draw;
  for 38 boxes in a row the same confidence is 0.99³⁸ = 0.68.
- κ follows eq. (3) as printed, so that ν is the paper's ν: its 0.26 is 0.313 in linear elasticity.

Times are in `times.csv`, the only file whose content differs from run to run (and with it its hash
in `skinlab-paper.json`); evaluations of the model stand here in their place.
"""


def page(study: Study, parts: Sequence[Part], link: Callable[[str], str]) -> str:
    """Return the page as Markdown; `link` turns a file's name into where it is, seen from there."""
    seed = f" --seed {study.seed}" if study.seed else ""
    said = [(part.title.split(":")[0], c) for part in parts for c in part.comparisons]
    yes, no, open_ = ([one for one in said if one[1].agrees is v] for v in (True, False, None))
    blocks = [_HEAD.format(seed=seed)]
    blocks.append(
        f"## In short\n\nOf {len(said)} statements compared, {len(yes)} hold here, {len(no)} do "
        f"not, and {len(open_)} cannot be tested here: they are about real curves that nobody here "
        "has, and what a stand-in does in their place was decided when it was made. What does not "
        "hold:\n\n" + "\n".join(f"- {title}: {c.what}. Here: {c.ours}." for title, c in no) + "\n"
    )
    blocks += [_section(part, link) for part in parts]
    return "\n".join(blocks)


def _section(part: Part, link: Callable[[str], str]) -> str:
    lines = [f"## {part.title}", ""]
    if part.text:
        lines += [part.text, ""]
    if part.draw is not None:
        lines += [f"![{part.title}]({link(part.name + '.png')})", ""]
    if part.shown is not None:
        lines += [part.shown.markdown(), ""]
    if part.comparisons:
        lines += ["| the paper says | paper | here | agrees | why |", "|---|---|---|---|---|"]
        lines += [_row(c) for c in part.comparisons]
        lines.append("")
    lines += [f"Numbers: [{part.name}.csv]({link(part.name + '.csv')})", ""]
    return "\n".join(lines)


def _row(c: Comparison) -> str:
    verdict = f"**{c.verdict}**" if c.agrees is False else c.verdict
    cells = (c.what, c.paper, c.ours, verdict, c.why)
    return "| " + " | ".join(cells) + " |"
