"""Batches of files on a dask cluster, whose workers see the folders under the same paths.

dask.distributed is an extra. A task costs the scheduler about a millisecond and a round trip, so
that files go in batches; no more of them than keep the workers busy are given at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any, TypeVar

from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.studies.compute import Computed, Task, compute

T = TypeVar("T")
R = TypeVar("R")

_ANSWER_WITHIN_S = 10
_AT_ONCE = 512  # tasks that the scheduler is given at a time


def computed_on_cluster(
    identifier: Identifier, batches: Iterator[list[Task]], address: str
) -> Iterator[list[Computed]]:
    """Yield what the cluster's workers compute, as they finish.

    Raises:
        InputError: as `on_cluster`.
    """
    yield from on_cluster(compute, identifier, batches, address)


def on_cluster(
    function: Callable[[Any, T], R], shared: object, tasks: Iterator[T], address: str
) -> Iterator[R]:
    """Yield function(shared, task) of each task, as they finish; `shared` is sent once a worker.

    Raises:
        InputError: dask.distributed is not installed, the address does not answer, or the cluster
            is lost.
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
        sent = client.scatter(shared, broadcast=True, hash=False)
        # pure=False: never an answer that the cluster has from another study.
        first = [client.submit(function, sent, t, pure=False) for t in islice(tasks, _AT_ONCE)]
        running = as_completed(first)
        for future in running:
            try:
                yield future.result()
            except Exception as error:
                raise InputError(
                    f"--dask {address}: a batch was lost ({type(error).__name__}: {error}); "
                    "--resume goes on where it stopped"
                ) from error
            future.release()
            for task in islice(tasks, 1):
                running.add(client.submit(function, sent, task, pure=False))
