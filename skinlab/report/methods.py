"""What was done and what was assumed, in plain words, for one way of identifying."""

from __future__ import annotations

from skinlab.identify.identifier import Identifier

_METHODS = {
    "auto": "many random candidates over all that is possible, the best ones of every part of it "
    "walked down to the bottom of their valley by least squares; the lowest is the answer",
    "sto": "the paper's stochastic algorithm: random candidates from a box, the best of which span "
    "the next, smaller box, until the error stands still",
    "hka": "the heuristic Kalman algorithm: random candidates from a Gaussian, which is drawn "
    "towards the best ones",
    "gn": "Gauss-Newton from the lowest values",
    "gn-linesearch": "Gauss-Newton with a line search, from the lowest values",
    "rls": "recursive least squares with forgetting, sample by sample, in repeated passes",
    "lm": "Levenberg-Marquardt from the best of random candidates",
}

_KAPPA = {
    "paper": "ν is the paper's: the bulk modulus κ follows its eq. (3) as printed. The ν of linear "
    "elasticity for the same κ is larger and stands beside it",
    "consistent": "ν is that of linear elasticity",
}


def how(identifier: Identifier) -> list[str]:
    """Return paragraphs that say how the numbers were found."""
    settings = identifier.options
    sensor = identifier.sensor
    phases = ", ".join(identifier.phases)
    fitted = (
        "the first loading only, because the elastic law describes nothing else"
        if identifier.phases == ("load",)
        else f"the phases {phases}"
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
        f"Fitted was {fitted}. Computed curves come from a database of finite-element solutions by "
        f"interpolation (law {identifier.database.law}, mesh {identifier.database.mesh_name}).",
        f"Method {identifier.method}: {_METHODS.get(identifier.method, identifier.method)}. "
        f"Candidates {settings.samples}, best {settings.best}, tolerance {settings.tolerance_um:g} "
        f"µm, seed {identifier.seed}: the same settings give the same numbers.",
        "Intervals, which only the method auto gives, hold the true value in nine of ten "
        "measurements of such skins, if the model is right: they are the shortest parts with 90 % "
        "of what data, noise and the range searched leave open. Noise: "
        + ", ".join(noise)
        + ". The thickness enters with its "
        "standard deviation, where one is stated. Compare two skins by their intervals, never by "
        "the values alone: where they overlap widely, nothing was shown.",
        "A correlation near +1 or −1 between two parameters means that an error of one goes with "
        "an error of the other.",
        "E is the paper's error, (1/u)·√Σd² over u samples; rms, the root mean square of the same "
        "residuals d, is √u times E. The band beside the residuals is twice the standard deviation "
        "of one sample's noise, the pressure's noise included: of a model that misses nothing, "
        "about 95 of 100 residuals lie inside.",
    ]


def assumptions(identifier: Identifier) -> list[str]:
    """Return what was assumed, a point each."""
    return [
        "The skin is one homogeneous, isotropic layer of the stated thickness, elastic and without "
        "history: W = X1 (J1 − 3) + X2 (J1 − 3)(J2 − 3) + κ/2 (J − 1)² (X1, X2: stiffness at small "
        "and at large stretch; κ: resistance to a change of volume; J1, J2, J: invariants of the "
        "deformation).",
        _KAPPA[identifier.kappa] + ".",
        "Nothing pulls or pushes from below; the skin is free of tension before the suction; the "
        "tape holds its surface outside of the opening without any slip.",
        "The deflection's zero is right: where it is off, it is an effect to be found, and nothing "
        "is shifted to hide it.",
        "All of these are known to be incomplete for skin in the body. A small residual does not "
        "prove them: natural tension, a wrong thickness, preload or slip can hide in the "
        "parameters without leaving a residual in a single curve.",
    ]
