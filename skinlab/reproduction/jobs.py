"""What has to be computed, as small jobs that any process can do in any order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.methods import get_method, recursive_least_squares, stochastic
from skinlab.inference.problem import Estimate, Options, Problem
from skinlab.mechanics.fem.suction import solve
from skinlab.mechanics.materials.compressibility import kappa_ratio
from skinlab.reproduction.cases import BLIND_TRUTH, PRESSURE_MBAR, SKIN, Blind, Case, problem
from skinlab.reproduction.published_values import PAPER_BOX
from skinlab.workers import Pool

Array = NDArray[np.float64]


class Job(Protocol):
    """A computation that its fields fix, to the bit."""

    @property
    def cost(self) -> float:
        """About how long it takes, in any unit."""
        ...

    def __call__(self) -> Any:
        """Return its result."""
        ...


Results = Mapping[Job, Any]


@dataclass(frozen=True, eq=False)
class Found:
    """What a method found, and what it took."""

    parameters: Array  # (3,)
    error_um: float
    iterations: int
    evaluations: int
    converged: bool
    cpu_s: float  # the only number that another run does not repeat
    passes: Array = field(default_factory=lambda: np.empty((0, 4)))  # rls: X1, X2, ν, E after each
    lost: bool = False  # sto on the blind test: the truth is outside of the last box

    def at_bounds(self) -> tuple[str, ...]:
        """Return the parameters that are at a bound of the paper's box, in words."""
        unit = PAPER_BOX.to_unit(self.parameters)
        names = ("X1", "X2", "ν")
        low, high = PAPER_BOX.bounds
        return tuple(
            f"{name} = {(low if at <= 1e-5 else high)[d]:g}"
            for d, (name, at) in enumerate(zip(names, unit, strict=True))
            if min(at, 1.0 - at) <= 1e-5
        )


@dataclass(frozen=True)
class Identify:
    """One curve by one method; `run` numbers the random cases of a seed."""

    case: Case
    method: str
    options: Options
    seed: int = 0
    run: int = 0

    @property
    def cost(self) -> float:
        """In evaluations, roughly; recursive least squares takes each sample by itself."""
        if self.method == "rls":
            return 12_000.0 * recursive_least_squares.PASSES.of(self.options)
        return 20.0 * self.options.samples if self.method == "sto" else 2_000.0

    def __call__(self) -> Found:
        """Run the method."""
        rng = np.random.default_rng([self.seed, self.run])
        asked = problem(self.case)
        passes: list[Array] = []
        started = time.process_time()
        last: stochastic.Draw | None = None
        if self.method == "rls":

            def keep(parameters: Array, error_um: float) -> None:
                passes.append(np.append(parameters, error_um))

            found = recursive_least_squares.identify(asked, self.options, rng, watch=keep)
        elif self.method == "sto":

            def see(draw: stochastic.Draw) -> None:
                nonlocal last
                last = draw

            found = stochastic.identify(asked, self.options, rng, watch=see)
        else:
            found = get_method(self.method)(asked, self.options, rng)
        spent = time.process_time() - started
        lost = False
        if last is not None and isinstance(self.case, Blind):
            truth = PAPER_BOX.to_unit(np.array(BLIND_TRUTH))
            lost = bool(((truth < last.low) | (truth > last.high)).any())
        return _found(found, spent, passes, lost)


@dataclass(frozen=True)
class BestAtNu:
    """The least E that X1 and X2 can reach at one ν: the floor of the valley."""

    case: Case
    nu: float
    seed: int = 0

    @property
    def cost(self) -> float:
        """In evaluations, roughly."""
        return 20_000.0

    def __call__(self) -> Found:
        """Search X1 and X2."""
        whole = problem(self.case)
        plane = Problem(Plane(2, self.nu), whole.misfit, whole.points)
        started = time.process_time()
        options = Options(samples=1000, best=50, tolerance_um=1e-6)
        found = stochastic.identify(plane, options, np.random.default_rng([self.seed, 0]))
        return _found(found, time.process_time() - started, [])


@dataclass(frozen=True)
class NeoHookean:
    """A curve of the law without X2, by the finite elements: Figure 4a's."""

    X1_MPa: float
    nu: float

    @property
    def cost(self) -> float:
        """In evaluations, roughly."""
        return 20_000.0

    def __call__(self) -> Array:
        """Return deflections (51,), mm; NaN from where the skin creases."""
        kappa = self.X1_MPa * float(kappa_ratio(self.nu, "paper"))
        parameters = {"X1_MPa": self.X1_MPa, "X2_MPa": 0.0, "kappa_MPa": kappa}
        return solve(SKIN, parameters, float(PRESSURE_MBAR[-1]))(PRESSURE_MBAR)


@dataclass(frozen=True)
class Plane:
    """The paper's box with one of its three parameters fixed: a space of the other two.

    Its parameters are still all three, (..., 3).
    """

    fixed: int
    value: float

    def _free(self) -> list[int]:
        return [d for d in range(3) if d != self.fixed]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the two that are free."""
        return tuple(PAPER_BOX.names[d] for d in self._free())

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (2,)."""
        low, high = PAPER_BOX.bounds
        return low[self._free()], high[self._free()]

    def from_unit(self, unit: Array) -> Array:
        """Return the parameters (..., 3)."""
        low, high = self.bounds
        parameters = np.full((*unit.shape[:-1], 3), self.value)
        parameters[..., self._free()] = low + (high - low) * unit
        return parameters

    def to_unit(self, parameters: Array) -> Array:
        """Return the points of the square (..., 2)."""
        low, high = self.bounds
        return np.asarray((parameters[..., self._free()] - low) / (high - low))

    def by_unit(self, parameters: Array) -> Array:
        """Return derivatives (..., 3, 2) of parameters (..., 3) by the square's coordinates."""
        low, high = self.bounds
        return np.broadcast_to(np.eye(3)[:, self._free()] * (high - low), (*parameters.shape, 2))


def execute(
    jobs: Iterable[Job], workers: int = 1, progress: Callable[[float], None] = lambda _: None
) -> dict[Job, Any]:
    """Return the results; they do not depend on `workers`.

    `progress` is told of each job's share of the work, as it is done.

    Raises:
        WorkerDiedError: a worker process died twice over the same job.
    """
    # The dearest first, so that no core is left with one of them at the end.
    todo = sorted(dict.fromkeys(jobs), key=lambda job: -job.cost)
    whole = sum(job.cost for job in todo)
    results: dict[Job, Any] = {}
    with Pool(workers) as pool:
        for job, result in zip(todo, pool.map(_do, todo), strict=True):
            results[job] = result
            progress(job.cost / whole)
    return results


def _do(_: None, job: Job) -> Any:
    return job()


def _found(estimate: Estimate, cpu_s: float, passes: list[Array], lost: bool = False) -> Found:
    return Found(
        estimate.parameters,
        estimate.error_um,
        estimate.iterations,
        estimate.evaluations,
        estimate.converged,
        cpu_s,
        np.array(passes).reshape(-1, 4),
        lost,
    )
