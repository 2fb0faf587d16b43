"""What was done and what was assumed, in plain words, for one way of identifying."""

from __future__ import annotations

from skinlab.inference.identify import Identifier
from skinlab.inference.methods import get_method
from skinlab.inference.result import Identification
from skinlab.inference.settings import INTERVALS
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.model_file import Model, model_of_law
from skinlab.report.text import errors_in_words, placements_in_words

_KAPPA = {
    "paper": "ν is the paper's: the bulk modulus κ follows its eq. (3) as printed. The ν of linear "
    "elasticity for the same κ is larger and stands beside it",
    "consistent": "ν is that of linear elasticity",
}


_WITH_EFFECTS = (
    "Method auto, with effects: the parameters of the law and of the effects together, by least "
    "squares in units of each sample's error, from several starts; finite elements compute the "
    "curves, with the database as their guide."
)
_SHORTEST = (
    f"Each is the shortest one that holds {100 * INTERVALS.weight:.0f} % of what data, errors of "
    "the samples, thickness (with its standard deviation, where one is stated) and the range "
    "searched leave open, and all that is likely, the best fit among it."
)
_TOGETHER = (
    "Curves that were fitted together have one skin, and the best fit is what is likeliest for "
    "all of them by the errors of their samples"
)


def how(
    identifier: Identifier,
    phases: tuple[str, ...],
    together: Identification | None = None,
    *,
    each: bool = True,
) -> list[str]:
    """Return paragraphs that say how the numbers were found, from samples in these phases.

    `together` is an answer of the whole session, if there is one; `each` says whether curves have
    answers of their own.
    """
    settings = identifier.options
    sensor = identifier.sensor
    law, mesh = identifier.database.law, identifier.database.mesh_name
    if identifier.model.effects:
        method = _WITH_EFFECTS
    else:
        method = (
            f"Method {identifier.method}: {get_method(identifier.method).meaning}. "
            f"Candidates {settings.samples}, best {settings.best}, tolerance "
            f"{settings.tolerance_um:g} µm, seed {identifier.seed}. Computed curves come from a "
            "database of finite-element solutions by interpolation."
        )
    fitted = (
        "the first loading only, because the elastic law describes nothing else"
        if phases == ("load",)
        else f"the phases {', '.join(phases)}"
    )
    noise = [
        f"{name} {value:g} {unit} (stated)" if value is not None else f"{name} estimated"
        for name, value, unit in (
            ("of the deflection", sensor.noise_um, "µm"),
            ("of the pressure", sensor.pressure_noise_mbar, "mbar"),
        )
    ]
    return [
        "A probe with a round opening pulls the skin into a dome; deflection is the height of its "
        "apex, pressure the suction. The parameters of the skin are those whose computed curve is "
        "like the measured one.",
        *_best_fit(identifier, together, each=each),
        f"The fit used {fitted}. Law {law}, mesh {mesh}.",
        *_model(identifier.model),
        f"{method} The same settings give the same numbers.",
        "Intervals, which only the method auto gives, contain the true value in nine of ten "
        f"measurements of such skins, if the model is right. {_SHORTEST} "
        f"Noise: {', '.join(noise)}. Compare two skins by their intervals, never by the "
        "values alone: where they overlap widely, no difference was shown.",
        "A correlation near +1 or −1 between two parameters means that an error of one goes with "
        "an error of the other.",
        "E is the paper's error, (1/u)·√Σd² over u samples; rms, the root mean square of the same "
        "residuals d, is √u times E. The band beside the residuals is twice the standard deviation "
        "of one sample's noise, the pressure's noise included: of a model that misses nothing, "
        "about 95 of 100 residuals lie inside.",
    ]


def _best_fit(identifier: Identifier, together: Identification | None, *, each: bool) -> list[str]:
    """Return what the best fit is, and what errors an answer of the whole session has."""
    several = together is not None and together.files is not None
    said = []
    if each or not several or together is None or together.error_model is None:
        nearest = "the sum of squared differences of the deflection"
        if identifier.model.effects:
            nearest += ", each by its sample's error"
        said.append(
            f"The best fit of a curve is the computed one that is nearest to it in {nearest}."
        )
    if together is None or together.error_model is None:
        return said
    if several:
        own = "" if together.placement is None else "; each placement has a stiffness and a zero"
        said.append(f"{_TOGETHER}{own}.")
    if several or not each:
        whose = "of the curves together" if several else "of the curve"
        said.append(f"Errors of the samples, {whose}: {errors_in_words(together.error_model)}.")
    if together.placement is not None:
        said.append(f"Placements: {placements_in_words(together.placement)}.")
    return said


def _model(model: Model) -> list[str]:
    if model.hash == model_of_law(model.model.law).hash:
        return []
    own = " It sets bounds or priors of its own." if model.parameters else ""
    return [f"Model “{model.model.name}”, from a file.{own}"]


def assumptions(identifier: Identifier, together: Identification | None = None) -> list[str]:
    """Return what was assumed, a point each; `together` as of `how`."""
    effects = [get_effect(name) for name in sorted(identifier.model.effects)]
    added = [
        f"Added to the base law by the model, in place of what is said below of the same thing: "
        f"{effect.name}: {effect.meaning}; {effect.formula}."
        for effect in effects
    ]
    law = get_law(identifier.database.law)
    return [
        *added,
        "The skin is one homogeneous, isotropic layer of the stated thickness, elastic and without "
        f"history: {law.formula} ({law.meaning}; κ: resistance to a change of volume; J1, J2, J: "
        "invariants of the deformation).",
        _KAPPA[identifier.kappa] + ".",
        "Nothing pulls or pushes from below; the skin is free of tension before the suction; the "
        "tape holds its surface outside of the opening without any slip.",
        *_zero(identifier, together),
        "All of these are known to be incomplete for skin in the body. A small residual does not "
        "prove them: natural tension, a wrong thickness, preload or slip can hide in the "
        "parameters without leaving a residual in a single curve.",
    ]


def _zero(identifier: Identifier, together: Identification | None) -> list[str]:
    """Return what was assumed of the deflection's zero."""
    few = "may be off by a few µm: that is one of the errors, and the interval counts it"
    if identifier.model.effects:
        return [f"The deflection's zero {few}. A larger offset is an effect to be found."]
    said = [
        "The zero of a curve that is fitted alone is right when the curve begins: where it is off, "
        "it is an effect to be found, and nothing is shifted to hide it."
    ]
    if together is None or together.placement is None:
        return said
    return [*said, f"Of curves that are fitted together the zero of each placement {few}."]
