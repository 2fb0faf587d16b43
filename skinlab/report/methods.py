"""What was done and what was assumed, in plain words, for one way of identifying."""

from __future__ import annotations

from skinlab.inference.identify import Identifier
from skinlab.inference.methods import get_method
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.model_file import Model, model_of_law

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
    "They are the shortest parts with 90 % of what data, noise, thickness (with its standard "
    "deviation, where one is stated) and the range searched leave open."
)
_GAUSSIAN = "They are Gaussian about the optimum, and cut off at the ends of what was searched."


def how(identifier: Identifier, phases: tuple[str, ...]) -> list[str]:
    """Return paragraphs that say how the numbers were found, from samples in these phases."""
    settings = identifier.options
    sensor = identifier.sensor
    law, mesh = identifier.database.law, identifier.database.mesh_name
    if identifier.model.effects:
        method, intervals = _WITH_EFFECTS, _GAUSSIAN
    else:
        method = (
            f"Method {identifier.method}: {get_method(identifier.method).meaning}. "
            f"Candidates {settings.samples}, best {settings.best}, tolerance "
            f"{settings.tolerance_um:g} µm, seed {identifier.seed}. Computed curves come from a "
            "database of finite-element solutions by interpolation."
        )
        intervals = _SHORTEST
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
        "nearest to the measured one in the sum of squared differences of the deflection.",
        f"The fit used {fitted}. Law {law}, mesh {mesh}.",
        *_model(identifier.model),
        f"{method} The same settings give the same numbers.",
        "Intervals, which only the method auto gives, contain the true value in nine of ten "
        f"measurements of such skins, if the model is right. {intervals} "
        f"Noise: {', '.join(noise)}. Compare two skins by their intervals, never by the "
        "values alone: where they overlap widely, no difference was shown.",
        "A correlation near +1 or −1 between two parameters means that an error of one goes with "
        "an error of the other.",
        "E is the paper's error, (1/u)·√Σd² over u samples; rms, the root mean square of the same "
        "residuals d, is √u times E. The band beside the residuals is twice the standard deviation "
        "of one sample's noise, the pressure's noise included: of a model that misses nothing, "
        "about 95 of 100 residuals lie inside.",
    ]


def _model(model: Model) -> list[str]:
    if model.hash == model_of_law(model.model.law).hash:
        return []
    own = " It sets bounds or priors of its own." if model.parameters else ""
    return [f"Model “{model.model.name}”, from a file.{own}"]


def assumptions(identifier: Identifier) -> list[str]:
    """Return what was assumed, a point each."""
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
        "The deflection's zero is right: where it is off, it is an effect to be found, and nothing "
        "is shifted to hide it.",
        "All of these are known to be incomplete for skin in the body. A small residual does not "
        "prove them: natural tension, a wrong thickness, preload or slip can hide in the "
        "parameters without leaving a residual in a single curve.",
    ]
