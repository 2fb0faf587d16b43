"""Rows computed on a dask cluster; dask.distributed is an extra and imported here alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import SOLVER_VERSION

_ANSWER_WITHIN_S = 10
_AT_ONCE = 4096  # tasks that the scheduler is given at a time


def computed_on_cluster(
    compute: Callable[[int], Any], entries: list[int], address: str, solver_version: str
) -> Iterator[Any]:
    """Yield what `compute` gives for each entry, as the cluster's workers finish.

    Raises:
        InputError: dask.distributed is not installed, the address does not answer, a worker has
            another solver, or the cluster is lost.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError(
            "--dask needs dask.distributed, which is not installed: pip install 'skinlab[dask]'"
        ) from None
    try:
        client = Client(address, timeout=_ANSWER_WITHIN_S)
    except (OSError, ValueError, TypeError) as error:  # OSError: timeouts as well
        said = str(error).splitlines()
        raise InputError(
            f"--dask {address}: no scheduler answers there ({said[0] if said else error!r}); "
            "expected an address such as tcp://10.0.0.1:8786"
        ) from None
    with client:
        task = partial(_with_solver, compute, solver_version)
        for begin in range(0, len(entries), _AT_ONCE):
            # pure=False: never an answer that the cluster has from another build.
            futures = client.map(task, entries[begin : begin + _AT_ONCE], pure=False)
            for future in as_completed(futures):
                yield _result(future, address)
                future.release()


def _result(future: Any, address: str) -> Any:
    try:
        return future.result()
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"--dask {address}: a row was lost ({type(error).__name__}: {error}); "
            "--resume goes on where it stopped"
        ) from error


def _with_solver(compute: Callable[[int], Any], solver_version: str, entry: int) -> Any:
    if solver_version != SOLVER_VERSION:
        raise InputError(
            f"a dask worker has solver version {SOLVER_VERSION}; expected {solver_version}"
        )
    return compute(entry)
