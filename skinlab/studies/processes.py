"""Any number of tasks on processes of this machine: a few at a time, in the order they end."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import Any, TypeVar

from skinlab.workers import Worker, WorkerDiedError

T = TypeVar("T")
R = TypeVar("R")

_AHEAD = 2  # tasks a process that wait, so that none of them idles


def on_processes(
    function: Callable[[Any, T], R], shared: object, tasks: Iterator[T], workers: int
) -> Iterator[tuple[T, R | None]]:
    """Yield each task with function(shared, task), as they finish; None where its process died.

    `shared` is sent once a process. No more tasks are taken than keep the processes busy.
    """
    first = list(islice(tasks, workers * (1 + _AHEAD)))
    if not first:
        return
    every: list[Worker] = []
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()

    def new() -> Worker:
        every.append(Worker(shared, here=False))
        return every[-1]

    def do(task: T) -> R | None:
        worker = idle.get()
        try:
            found: R = worker.call(function, task)
        except WorkerDiedError:
            worker.close()
            every.remove(worker)
            worker = new()
            return None
        finally:
            idle.put(worker)
        return found

    threads = ThreadPoolExecutor(workers, thread_name_prefix="study")
    try:
        for _ in range(min(workers, len(first))):
            idle.put(new())
        running: dict[Future[R | None], T] = {threads.submit(do, task): task for task in first}
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
                for task in islice(tasks, 1):
                    running[threads.submit(do, task)] = task
    finally:
        threads.shutdown(wait=False, cancel_futures=True)
        for worker in list(every):
            worker.kill()  # whoever waits for its answer goes on
        threads.shutdown()
        for worker in every:
            worker.close()
