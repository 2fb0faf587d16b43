"""Campaigns whose truth is hidden: another mesh and other elements, skins and errors drawn afresh.

Parts: `none` hides nothing, `single` each of the library's effects in turn, `double` two of them,
`outside` something that the library does not have, `ramp` an effect (or, each fourth time, nothing)
in one ramp of the 6 mm opening: white noise, one placement an opening, 20 Hz. Parts that begin with
`life` are with errors as they are measured, every kind alone and all together (`Life`), one to four
placements an opening, one to three openings, 10 to 200 Hz; `life_plans` with other programs
(`PLANS`), and in a third of them each placement at its own rate. `life_time` hides what
depends on time alone (`IN_TIME`): what swings after every change, a zero that settles or sets in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_device.skin import MESH
from skinlab.curves.campaign import Campaign
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.errors import InputError
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.effects.model import Skin, felt_path, response
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]
Distortion = Callable[[Array, Array, Array, np.random.Generator], Array]

_FINE_S = 0.002  # at which an oscillator is followed

PARTS = (
    "none", "single", "double", "outside", "ramp",
    "life_none", "life_single", "life_double", "life_outside", "life_crossed",
    "life_plans_none", "life_plans", "life_time",
)  # fmt: skip

FULL = (
    (6.0, "ramp:100@20,ramp:0@20", 1, 1),
    (6.0, "ramp:100@20,ramp:0@20", 1, 2),
    (6.0, "ramp:100@80,ramp:0@80", 1, 1),
    (6.0, "ramp:100@80,hold:8,ramp:0@80,hold:4", 1, 1),
    (2.0, "ramp:300@60,ramp:0@60", 1, 1),
    (8.0, "ramp:100@20,ramp:0@20", 1, 1),
)
# Errors as in life: one placement an opening, times one to four.
LIFE = (
    (6.0, "ramp:100@80,hold:8,ramp:0@80,hold:4", 1),
    (2.0, "ramp:300@60,ramp:0@60", 1),
    (8.0, "ramp:100@20,ramp:0@20", 1),
)
# Of those effects alone that such campaigns can show at all: no later cycle is among them, and a
# stiffness, a zero or a drift of every curve is what placements and tape do as well.
LIFE_EFFECTS = (
    "viscoelasticity", "natural_tension", "hypodermis", "contact_preload", "thickness_error",
    "strain_stiffening", "tape_slip", "surface_layer", "deflection_gain", "power_law_creep",
    "friction_loop", "regulator_lag",
)  # fmt: skip
# What others do: openings and programs, placements, and loadings in each of them.
PLANS = (
    (((6.0, "ramp:100@20"), (2.0, "ramp:300@60")), 2, 3),
    (((6.0, "ramp:100@20"), (2.0, "ramp:300@60")), 3, 1),
    (((4.0, "ramp:200@40,hold:10,ramp:0@40"), (8.0, "ramp:60@10,ramp:0@10")), 2, 1),
    (((6.0, "ramp:100@20,ramp:0@20"), (2.0, "ramp:300@60,ramp:0@60")), 6, 1),
    (
        (
            (6.0, "ramp:60@3,hold:20,ramp:0@3,hold:10"), (6.0, "ramp:60@30,ramp:0@30"),
            (2.0, "ramp:200@20,ramp:0@20"),
        ),
        2, 1,
    ),
)  # fmt: skip
SECOND_CYCLE = (6.0, "ramp:100@20,ramp:0@20", 2, 1)
RAMP = ((6.0, "ramp:100@20", 1, 1),)

# Sizes to hide, from weak to strong: lowest and highest of each parameter, drawn log-uniformly in
# its distance from no effect; "±": either sign.
SIZES: dict[str, dict[str, tuple[float, float, float, str]]] = {
    "viscoelasticity": {"g": (0.0, 0.02, 0.45, "+"), "tau_s": (0.0, 0.1, 9.0, "+")},
    "natural_tension": {"stretch": (1.0, 0.003, 0.06, "+")},
    "hypodermis": {"thickness_mm": (0.0, 1.5, 8.0, "+"), "X1_kPa": (0.0, 0.05, 4.0, "+")},
    "contact_preload": {"p0_mbar": (0.0, 0.5, 15.0, "+")},
    "tape_slip": {"slip_mm": (0.0, 0.02, 0.4, "+")},
    "thickness_error": {"ratio": (1.0, 0.02, 0.35, "±")},
    "surface_layer": {"thickness_um": (0.0, 8.0, 40.0, "+"), "X1_MPa": (0.0, 0.2, 4.0, "+")},
    "strain_stiffening": {"X3_MPa": (0.0, 5.0, 300.0, "+")},
    "preconditioning": {"softening": (0.0, 0.01, 0.3, "+")},
    "pressure_lag": {"lag_s": (0.0, 0.005, 0.2, "±")},
    "deflection_offset": {"offset_um": (0.0, 1.0, 60.0, "±")},
    "deflection_gain": {"gain": (1.0, 0.01, 0.15, "±")},
    "baseline_drift": {"drift_um_per_s": (0.0, 0.1, 5.0, "±")},
}
LIFE_SIZES: dict[str, dict[str, tuple[float, float, float, str]]] = {
    "power_law_creep": {"amplitude": (0.0, 0.05, 0.6, "+"), "exponent": (0.0, 0.1, 0.4, "+")},
    "friction_loop": {"share": (0.0, 0.01, 0.12, "+")},
    "regulator_lag": {"tau_s": (0.0, 0.03, 0.4, "+")},
}


BREATHING_HZ, PULSE_HZ = (0.2, 0.4), (1.0, 1.5)  # the bands that frequencies are drawn from


@dataclass(frozen=True)
class Truth:
    """What a campaign was made from."""

    skin: Skin
    effects: Effects
    distortion: str  # the name of something outside the library, or ""
    distortion_size: float
    thickness_mm: float
    noise_um: float
    pressure_noise_mbar: float
    stated: bool
    life: Life | None = None  # None: white noise


@dataclass(frozen=True)
class Life:
    """Errors as in life: sizes of what is drawn anew for each curve or placement."""

    kind: str = "white"
    rate_hz: float = 20.0
    ou_um: float = 0.0
    ou_s: float = 0.3
    step_um: float = 1.0
    heavy: bool = False  # Student's t with 3 degrees in place of the Gaussian
    spikes: float = 0.0  # share of samples that are off by 30 to 100 µm
    glitch_um: float = 0.0  # one sample of a curve
    breathing_um: float = 0.0
    pulse_um: float = 0.0
    walk_um: float = 0.0  # per root second
    proportional: float = 0.0  # of the deflection, each sample
    pressure_step_mbar: float = 0.1
    lag_s: float = 0.0  # by which the suction follows the command, measured truly
    jitter_s: float = 0.0
    lost: float = 0.0  # share of samples
    stiffness: float = 0.0  # standard deviations, of each placement
    thickness: float = 0.0
    offset_um: float = 0.0
    rates_hz: tuple[float, ...] = ()  # of each placement, where they differ

    @classmethod
    def drawn(cls, rng: np.random.Generator, number: int) -> Life:
        """Return one kind alone, in turn, or (each third time) all of them."""
        whole = cls(
            "all", float(rng.choice([10.0, 20.0, 50.0, 100.0, 200.0])),
            float(rng.uniform(2.0, 3.0)), float(rng.choice([0.1, 0.3, 1.0])),
            float(rng.choice([1.0, 10.0])), bool(rng.random() < 0.5), 0.01, 300.0,
            float(rng.uniform(2.0, 5.0)), float(rng.uniform(1.0, 3.0)),
            float(rng.uniform(0.5, 1.0)), float(rng.uniform(0.005, 0.02)),
            float(rng.choice([0.1, 0.3, 1.0])), float(rng.uniform(0.1, 0.3)), 0.008, 0.05,
            float(rng.choice([0.01, 0.03, 0.06, 0.12])), float(rng.choice([0.01, 0.03, 0.05])),
            float(rng.uniform(3.0, 10.0)),
        )  # fmt: skip
        of = {
            "white": (), "ou": ("ou_um", "ou_s"), "step": ("step_um",), "heavy": ("heavy",),
            "spikes": ("spikes",), "glitch": ("glitch_um",),
            "periodic": ("breathing_um", "pulse_um"), "walk": ("walk_um",),
            "proportional": ("proportional",), "pressure": ("pressure_step_mbar",),
            "regulator": ("lag_s",), "clock": ("jitter_s", "lost"),
            "stiffness": ("stiffness",), "thickness": ("thickness",), "offset": ("offset_um",),
        }  # fmt: skip
        if number % 3 == 2:
            return whole
        kind = list(of)[(number - number // 3) % len(of)]
        return cls(kind, whole.rate_hz, **{name: getattr(whole, name) for name in of[kind]})

    def times_s(self, duration_s: float, rng: np.random.Generator) -> Array:
        """Return when a program is sampled (n,)."""
        t = np.arange(int(duration_s * self.rate_hz + 1e-9) + 1) / self.rate_hz
        if self.lost or self.jitter_s:
            t = t[rng.random(len(t)) >= self.lost]
            t = np.unique(np.maximum(t + rng.normal(0.0, self.jitter_s, len(t)), 0.0).round(4))
        return t

    def errors_um(self, t: Array, white_um: float, rng: np.random.Generator) -> Array:
        """Return what one curve's deflections are off by (n,), placement apart, µm."""
        n = len(t)
        noise = rng.standard_t(3, n) / np.sqrt(3.0) if self.heavy else rng.normal(size=n)
        slow = [rng.normal()]
        for d in np.exp(-np.diff(t) / self.ou_s):
            slow.append(d * slow[-1] + np.sqrt(1.0 - d**2) * rng.normal())
        steps = rng.normal(size=n) * np.sqrt(np.diff(t, prepend=t[0]))
        found = white_um * noise + self.ou_um * np.array(slow) + self.walk_um * np.cumsum(steps)
        for size, band in ((self.breathing_um, BREATHING_HZ), (self.pulse_um, PULSE_HZ)):
            angle = 2.0 * np.pi * (rng.uniform(*band) * t + rng.uniform())
            found = found + size * np.sin(angle)
        hit = rng.random(n) < self.spikes
        found = found + hit * rng.uniform(30.0, 100.0, n) * rng.choice([-1, 1], n)
        found[rng.integers(n)] += self.glitch_um * rng.choice([-1, 1])
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Made:
    """A campaign; what its skin and effects alone do, and the true pressures there.

    Without the noise, and without what each placement's own stiffness, thickness and zero did:
    those are errors, also for a perfect knower.
    """

    campaign: Campaign
    clean_mm: list[Array]
    true_mbar: list[Array]


# ---- what the library does not have: (time, pressure, deflection, rng) -> deflection, at size 1


def heartbeat(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Add 20 µm at about one a second."""
    return w + 0.020 * np.sin(2 * np.pi * 1.2 * t + rng.uniform(0, 2 * np.pi))


def tape_jumps(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the skin jump by up to 60 µm at two moments of a curve, for good."""
    for when in rng.uniform(0.15, 0.85, 2):
        w = w + rng.uniform(0.02, 0.06) * (t > when * t[-1])
    return w


def rate_independent_loop(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Bulge the way back by 15 % of the dome, at any rate the same."""
    x = p / max(float(p.max()), 1e-9)
    back = t > t[int(np.argmax(p))]
    return w + np.where(back, 0.15 * float(w.max()) * 4 * x * (1 - x), 0.0)


def saturation(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Clip a dome at 70 % of its height."""
    return np.minimum(w, 0.7 * float(w.max()))


def wander(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the zero wander by 25 µm over some seconds."""
    period = rng.uniform(4.0, 9.0)
    phase = rng.uniform(0, 2 * np.pi)
    return w + 0.025 * (np.sin(2 * np.pi * t / period + phase) - np.sin(phase))


def play(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the dome follow the suction with a play of 12 mbar."""
    effective, at = np.empty_like(p), 0.0
    for i, asked in enumerate(p):
        at = min(max(at, asked - 6.0), asked + 6.0)
        effective[i] = at
    rising = np.arange(len(p)) <= int(np.argmax(p))
    known_p, known_w = p[rising], w[rising]
    return np.asarray(np.interp(effective, known_p, known_w))


def ringing(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let a filter of 0.7 s ring in the deflection channel, without delaying its mean."""
    bend = np.gradient(np.gradient(w, t), t)
    return w + 0.25 * bend / max(1.0, float(np.abs(bend).max()) / 0.25)


def bent_sensor(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the deflection sensor be off by a wave of 20 µm along its range."""
    return w + 0.020 * np.sin(2.0 * np.pi * w / rng.uniform(0.6, 1.0))


def _swings(t: Array, values: Array, rng: np.random.Generator) -> Array:
    """Return values (n,) behind an oscillator of 0.5 to 3 Hz, damped by 0.1 to 0.4 of critical."""
    from scipy.signal import cont2discrete, lfilter  # slow to import

    turn, damping = 2 * np.pi * float(np.exp(rng.uniform(np.log(0.5), np.log(3.0)))), 0.1
    damping += rng.uniform(0.0, 0.3)
    oscillator = ([turn**2], [1.0, 2.0 * damping * turn, turn**2])
    b, a, _ = cont2discrete(oscillator, _FINE_S, method="zoh")
    fine = np.arange(t[0], t[-1] + _FINE_S, _FINE_S)
    found = lfilter(b.ravel(), a, np.interp(fine, t, values) - values[0])
    return np.asarray(np.interp(t, fine, values[0] + found))


def channel_rings(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the deflection channel swing after every change."""
    return _swings(t, w, rng)


def regulator_rings(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the suction that is felt swing after every change, unseen; beyond its top in a line."""
    felt, rising = _swings(t, p, rng), np.arange(len(p)) <= int(np.argmax(p))
    known_p, known_w = p[rising], w[rising]
    upper = known_p > 0.7 * known_p[-1]
    slope = np.polyfit(known_p[upper], known_w[upper], 1)[0]
    beyond = known_w[-1] + slope * (felt - known_p[-1])
    return np.where(felt > known_p[-1], beyond, np.interp(felt, known_p, known_w))


def _zero_s(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(0.0, np.log(5.0))))


def zero_settles(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the zero settle by 60 µm, within 1 to 5 s."""
    return w + 0.060 * (1.0 - np.exp(-(t - t[0]) / _zero_s(rng)))


def zero_sets_in(t: Array, p: Array, w: Array, rng: np.random.Generator) -> Array:
    """Let the zero rest for 1 to 5 s, and rise by 60 µm within the next three."""
    since = np.clip((t - t[0] - _zero_s(rng)) / 3.0, 0.0, 1.0)
    return w + 0.060 * since**2 * (3.0 - 2.0 * since)


OUTSIDE: dict[str, Distortion] = {
    f.__name__: f
    for f in (
        heartbeat, tape_jumps, rate_independent_loop, saturation, wander, play, ringing,
        bent_sensor,
    )
}  # fmt: skip

IN_TIME: dict[str, Distortion] = {
    f.__name__: f for f in (channel_rings, regulator_rings, zero_settles, zero_sets_in)
}


# What kind of thing each one is, for programs that tell a family and not a name; those without
# are nothing that a smooth function of a few variables can be.
FAMILIES: dict[str, tuple[str, ...]] = {
    "heartbeat": ("periodic",),
    "rate_independent_loop": ("history", "pressure_curve"),
    "saturation": ("sensor_curve",),
    "wander": ("periodic", "time"),
    "play": ("history", "pressure_curve"),
    "ringing": ("time",),
    "channel_rings": ("time",),
    "regulator_rings": ("time",),
    "zero_settles": ("time",),
    "zero_sets_in": ("time",),
    "bent_sensor": ("sensor_curve",),
}


# ---- making a campaign ---------------------------------------------------------------------------


def draw(part: str, seed: int, number: int, attempt: int) -> tuple[Truth, Any]:
    """Return the truth and the plan of curves of campaign `number`."""
    rng = np.random.default_rng([seed, PARTS.index(part), number, attempt])
    names = tuple(SIZES)
    hidden: list[str] = []
    distortion = ""
    if part == "single":
        hidden = [names[number % len(names)]]
    elif part == "life_single":
        hidden = [LIFE_EFFECTS[number % len(LIFE_EFFECTS)]]
    elif part in ("life_crossed", "life_plans"):
        # Twelve effects, and all errors at each third number: in step, four of the effects have
        # all errors always, and eight never. So each round of twelve is moved by one.
        hidden = [LIFE_EFFECTS[(number + number // len(LIFE_EFFECTS)) % len(LIFE_EFFECTS)]]
    elif part == "life_double":
        hidden = sorted(rng.choice(LIFE_EFFECTS, 2, replace=False).tolist())
    elif part == "double":
        hidden = sorted(rng.choice(names, 2, replace=False).tolist())
    elif part == "ramp" and number % 4:
        hidden = [str(rng.choice([n for n in names if n != "preconditioning"]))]
    elif part in ("outside", "life_outside"):
        distortion = list(OUTSIDE)[number % len(OUTSIDE)]
    elif part == "life_time":
        distortion = list(IN_TIME)[number % len(IN_TIME)]
    sizes = SIZES | LIFE_SIZES
    effects = {name: {k: drawn_size(rng, *v) for k, v in sizes[name].items()} for name in hidden}
    x1 = float(np.exp(rng.uniform(np.log(0.015), np.log(0.07))))
    x2 = float(np.exp(rng.uniform(np.log(0.5), np.log(4.0))))
    skin = Skin((x1, x2, float(rng.uniform(0.22, 0.42))))
    plan = list(RAMP if part == "ramp" else FULL)
    second = rng.random() < 0.3 or "preconditioning" in hidden
    life = None
    if part.startswith("life"):
        times, openings = 3, len(LIFE)
        if part == "life_none":
            times, openings = int(rng.integers(1, 5)), int(rng.choice([3, 3, 2, 1]))
        plan = [(*entry, 1 + i) for i in range(times) for entry in LIFE[:openings]]
        life, second = Life.drawn(rng, number), False
    if life is not None and part.startswith("life_plans"):
        openings, placements, cycles = PLANS[int(rng.integers(len(PLANS)))]
        plan = [
            (*one, 1 + cycle, 1 + i)
            for i in range(placements)
            for one in openings
            for cycle in range(cycles)
        ]
        if rng.random() < 1 / 3:
            rates = rng.choice([10.0, 20.0, 50.0, 100.0, 200.0], placements)
            life = replace(life, rates_hz=tuple(rates.tolist()))
    if second and part != "ramp":
        plan.append(SECOND_CYCLE)
    truth = Truth(
        skin,
        effects,
        distortion,
        float(np.exp(rng.uniform(np.log(0.15), 0.0))) if distortion else 0.0,
        round(float(rng.uniform(0.9, 1.5)), 2),
        round(float(rng.uniform(2.0, 5.0)), 1),
        round(float(rng.uniform(0.1, 0.3)), 2),
        bool(rng.random() < 0.5),
        life,
    )
    return truth, plan


def drawn_size(rng: np.random.Generator, zero: float, low: float, high: float, sign: str) -> float:
    """Return a value beside its zero: by a distance that is drawn log-uniformly, to this side."""
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return zero + size * (float(rng.choice([-1.0, 1.0])) if sign == "±" else 1.0)


def curve_of(
    truth: Truth,
    entry: tuple[float, str, int, int],
    rng: np.random.Generator,
    placed: np.random.Generator | None = None,
) -> tuple[Curve, Array, Array] | None:
    """Return the measured curve, and `clean_mm` and `true_mbar` of it; None where no skin holds.

    How the probe sits is drawn from `placed`, where several curves are of one placement.
    """
    aperture, text, cycle, repeat = entry
    program = parse_program(text)
    life = truth.life or Life()
    if life.rates_hz:
        life = replace(life, rate_hz=life.rates_hz[(repeat - 1) % len(life.rates_hz)])
    t = life.times_s(program.duration_s, rng)
    path = PressurePath.of_program(program)
    if life.lag_s:
        path = felt_path({"regulator_lag": {"tau_s": life.lag_s}}, path)
    thickness, skin = truth.thickness_mm, truth.skin
    sits = rng if placed is None else placed  # else a placement of its own
    thickness *= float(np.exp(life.thickness * sits.normal()))
    stiffer = float(np.exp(life.stiffness * sits.normal()))
    x1, x2, nu = skin.values
    skin = Skin((x1 * stiffer, x2 * stiffer, nu))
    offset_mm = 1e-3 * life.offset_um * sits.normal()

    def dome(one: Skin, thickness_mm: float) -> Array:
        geometry = Geometry(aperture, thickness_mm)
        return response(
            one, truth.effects, geometry, path, t, cycle=cycle, discretisation=MESH
        ).deflection_mm

    w = dome(skin, thickness)
    if not np.isfinite(w).all():
        return None
    common = dome(truth.skin, truth.thickness_mm) if life.stiffness or life.thickness else w
    common = np.where(np.isfinite(common), common, w)
    if truth.distortion:
        # Of what is in time alone every curve has the same.
        of_all = np.random.default_rng(round(1e9 * truth.distortion_size))
        drawn = of_all if truth.distortion in IN_TIME else rng
        changed = (OUTSIDE | IN_TIME)[truth.distortion](t, path(t), w, drawn)
        outside = truth.distortion_size * (changed - w)
        w, common = w + outside, common + outside
    read_p, read_w = readings(truth, life, t, path(t), w, offset_mm, rng)
    name = f"d{aperture:g}_{text.replace(':', '').replace(',', '_')}_c{cycle}_{repeat}.csv"
    setup = Setup(aperture, truth.thickness_mm, program, cycle, repeat)
    return Curve(name, setup, t, read_p, read_w), common, path(t)


def readings(
    truth: Truth,
    life: Life,
    t: Array,
    pressure_mbar: Array,
    deflection_mm: Array,
    offset_mm: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Return what is read of a curve (n,): pressures, mbar, and deflections, mm."""
    w = deflection_mm
    read_w = w + offset_mm + 1e-3 * life.errors_um(t, truth.noise_um, rng)
    read_w = read_w + life.proportional * w * rng.normal(size=len(t))
    step_mm, step_mbar = 1e-3 * life.step_um, life.pressure_step_mbar
    read_w = step_mm * np.round(read_w / step_mm)
    read_p = pressure_mbar + rng.normal(0.0, truth.pressure_noise_mbar, len(t))
    return step_mbar * np.round(read_p / step_mbar), read_w


def make(part: str, seed: int, number: int) -> tuple[Truth, Made]:
    """Return campaign `number`; what no skin can be, or creases on the way, is drawn again."""
    for attempt in range(100):
        truth, plan = draw(part, seed, number, attempt)
        rng = np.random.default_rng([seed, PARTS.index(part), number, attempt, 1])
        found = []
        for entry in plan:
            placed = None
            if part.startswith("life_plans"):
                name = [seed, PARTS.index(part), number, attempt, 2, round(10 * entry[0]), entry[3]]
                placed = np.random.default_rng(name)
            try:
                one = curve_of(truth, entry, rng, placed)
            except InputError:  # two creeps that would relax more than all stress
                one = None
            if one is None:
                break
            found.append(one)
        if len(found) == len(plan):
            return truth, _made(truth, found)
    raise RuntimeError("no skin holds")


def _made(truth: Truth, found: Sequence[tuple[Curve, Array, Array]]) -> Made:
    campaign = Campaign(
        "hidden",
        truth.noise_um if truth.stated else None,
        truth.pressure_noise_mbar if truth.stated else None,
        tuple(curve for curve, _, _ in found),
    )
    return Made(campaign, [clean for _, clean, _ in found], [true for _, _, true in found])
