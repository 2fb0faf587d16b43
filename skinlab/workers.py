"""Work in other processes: one that lives long (`Worker`), or many pieces (`Pool`, `on_...`).

Every worker is a new interpreter, `python -m skinlab.workers`, on every platform. A fork would copy
locks that the probe's threads hold at that moment, and `multiprocessing` can neither start a
process while Textual has `sys.stderr` nor in a script without a main guard. Both sides are the same
program, so pickles go between them; they are never read from a disk.

A worker uses one thread of linear algebra, does not hear the terminal's Ctrl-C, and ends with the
process that started it, however that ends. What a function raises is raised where it was asked
for. Functions are called as `function(state, *arguments)`; the state is sent once a process.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from types import TracebackType
from typing import IO, Any, Self, TypeVar

from skinlab.errors import InputError, SkinlabError
from skinlab.io.log import log_exception
from skinlab.text import needs

Tell = Callable[[Any], object]
T = TypeVar("T")
R = TypeVar("R")

COMMAND = (sys.executable, "-m", "skinlab.workers")
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_NOT_SENT = (pickle.PicklingError, TypeError, AttributeError)  # what pickle raises
_SIZE = struct.Struct("<Q")
_PROTOCOL = pickle.HIGHEST_PROTOCOL
_AHEAD = 2  # tasks a process that wait, so that none of them idles
_ANSWER_WITHIN_S = 10
_AT_ONCE = 512  # tasks that a cluster's scheduler is given at a time
_LOG = logging.getLogger("skinlab")


class WorkerDiedError(SkinlabError):
    """A worker ended before its work did."""


class Worker:
    """A process that does one call after the other; any thread may call.

    Where it is gone, or could not be started, the work is done in this process: nobody is left
    without an answer. With `here=False` that is a `WorkerDiedError` instead. `nice`: by so much it
    is less urgent than this process.
    """

    def __init__(
        self, state: Any, *, nice: int = 0, here: bool = True, command: Sequence[str] = COMMAND
    ) -> None:
        self.state = state
        self._here = here
        self._lock = threading.Lock()
        self._closed = False
        self._process: _Process | None = None
        try:
            self._process = _Process(pickle.dumps(state, _PROTOCOL), nice, command)
        except (OSError, *_NOT_SENT) as error:
            self._lose(error)

    @property
    def pid(self) -> int | None:
        """The number of the process; None: there is none (any more)."""
        process = self._process
        return None if process is None else process.pid

    def call(self, function: Callable[..., Any], *arguments: Any, tell: Tell | None = None) -> Any:
        """Return `function(state, *arguments)`; with `tell` the function gets one, too.

        What it tells is told here, while it goes on.

        Raises:
            WorkerDiedError: the process is gone, and the work is not to be done here.
            Exception: whatever the function raises.
        """
        with self._lock:
            process = self._process
            if process is not None:
                try:
                    return process.call(function, arguments, tell)
                except WorkerDiedError as error:
                    self._lose(error)
                except _Unsent as error:
                    self._lose(error.cause)
        if not self._here:
            raise WorkerDiedError("the worker process ended before its work did")
        more = {} if tell is None else {"tell": tell}
        return function(self.state, *arguments, **more)

    def kill(self) -> None:
        """End the process at once; whoever waits for its answer hears of it. From `tell`, too."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()

    def close(self) -> None:
        """End the process, and wait until it is gone; from any thread that waits for no answer."""
        self.kill()
        with self._lock:
            process, self._process = self._process, None
            if process is not None:
                process.end()

    def _lose(self, error: BaseException) -> None:
        if not self._closed:
            log_exception(error)
        process, self._process = self._process, None
        if process is not None:
            process.end()


class Pool:
    """So many processes that share the pieces of a map; with one, all is done in this process.

    Work whose process dies is done again, once, in a new one. Answers do not depend on `workers`.
    """

    def __init__(self, workers: int, state: Any = None) -> None:
        self._state = state
        self._idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()
        self._all: list[_Process] = []
        self._closed = False
        self._threads: ThreadPoolExecutor | None = None
        if workers <= 1:
            return
        try:
            self._pickled = pickle.dumps(state, _PROTOCOL)
            for _ in range(workers):
                self._idle.put(self._new())
        except (OSError, *_NOT_SENT) as error:
            log_exception(error)
            self.close()
            return
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="worker")
        for process in self._all:  # they load what they need while this process goes on
            self._threads.submit(process.begin)

    def map(self, function: Callable[..., Any], tasks: Iterable[Any]) -> Iterator[Any]:
        """Yield `function(state, task)` for each task, in their order, as soon as it is there.

        Raises:
            WorkerDiedError: the process of a task died twice.
            Exception: whatever the function raises.
        """
        if self._threads is None:
            return (function(self._state, task) for task in tasks)
        return _in_order([self._threads.submit(self._do, function, task) for task in tasks])

    def close(self) -> None:
        """End all processes at once, and give up what is left."""
        self._closed = True
        for process in self._all:
            process.kill()
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)
        for process in self._all:
            process.end()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _new(self) -> _Process:
        process = _Process(self._pickled, 0, COMMAND)
        self._all.append(process)
        if self._closed:
            process.kill()
        return process

    def _do(self, function: Callable[..., Any], task: Any) -> Any:
        process = self._idle.get()
        try:
            try:
                return process.call(function, (task,), None)
            except WorkerDiedError:
                process.end()
                if self._closed:
                    raise
                _LOG.warning("skinlab: a worker process died; its work is done again")
                process = self._new()
                return process.call(function, (task,), None)
        except WorkerDiedError:
            raise WorkerDiedError(
                "a worker process died twice over the same work; one worker does without processes"
            ) from None
        except _Unsent as error:
            raise error.cause from None
        finally:
            self._idle.put(process)


def _in_order(futures: list[Future[Any]]) -> Iterator[Any]:
    for future in futures:
        yield future.result()


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


def on_cluster(
    function: Callable[[Any, T], R], shared: object, tasks: Iterator[T], address: str
) -> Iterator[R]:
    """Yield function(shared, task) of each task on a dask cluster, as they finish.

    `shared` is sent once a worker. The workers see the folders under the same paths.

    Raises:
        InputError: dask.distributed is not installed, the address does not answer, or the cluster
            is lost; or what the function raises.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError(needs("--dask needs", "dask.distributed", "dask")) from None
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
        # pure=False: never an answer that the cluster has from another build or study.
        first = [client.submit(function, sent, t, pure=False) for t in islice(tasks, _AT_ONCE)]
        running = as_completed(first)
        for future in running:
            try:
                yield future.result()
            except InputError:
                raise
            except Exception as error:
                raise InputError(
                    f"--dask {address}: work was lost ({type(error).__name__}: {error}); "
                    "--resume goes on where it stopped"
                ) from error
            future.release()
            for task in islice(tasks, 1):
                running.add(client.submit(function, sent, task, pure=False))


class _Unsent(Exception):  # noqa: N818 -- never leaves this file
    """The state or the call cannot go to another process."""

    def __init__(self, cause: BaseException) -> None:
        super().__init__(str(cause))
        self.cause = cause


class _Process:
    """A process and the pipes to it. One thread at a time calls; `kill` and `end` any."""

    def __init__(self, state: bytes, nice: int, command: Sequence[str]) -> None:
        self._state: bytes | None = state
        self._nice = nice
        self._lock = threading.Lock()
        self._asked = False  # and not answered
        self._popen = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**dict.fromkeys(_ONE_THREAD, "1"), **os.environ},
            start_new_session=True,  # Ctrl-C in the terminal is not meant for it
        )

    @property
    def pid(self) -> int:
        return self._popen.pid

    def begin(self) -> None:
        """Let it load its state; a failure is told by the first call."""
        with self._lock:
            state, self._state = self._state, None
            if state is not None:
                with contextlib.suppress(WorkerDiedError):
                    self._send(pickle.dumps((sys.path, self._nice), _PROTOCOL))
                    self._send(state)

    def call(self, function: Callable[..., Any], arguments: Any, tell: Tell | None) -> Any:
        self.begin()
        try:
            asked = pickle.dumps((function, arguments, tell is not None), _PROTOCOL)
        except _NOT_SENT as error:
            raise _Unsent(error) from None
        if self._asked:
            raise WorkerDiedError("a worker process was left in the midst of an answer")
        self._asked = True
        self._send(asked)
        while True:
            kind, content = self._receive()
            if kind == "told" and tell is not None:
                tell(content)
                continue
            self._asked = False
            if kind == "unsent":
                raise _Unsent(content)
            if kind == "error":
                raise content
            return content

    def kill(self) -> None:
        self._popen.kill()

    def end(self) -> None:
        """Kill it and let go of it; nobody may be waiting for its answer."""
        self._popen.kill()
        self._popen.wait()
        for pipe in (self._popen.stdin, self._popen.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def _send(self, data: bytes) -> None:
        assert self._popen.stdin is not None
        try:
            _write(self._popen.stdin, data)
        except (OSError, ValueError) as error:
            raise WorkerDiedError(f"a worker process is gone ({error})") from None

    def _receive(self) -> tuple[str, Any]:
        assert self._popen.stdout is not None
        try:
            data = _read(self._popen.stdout)
        except (EOFError, OSError, ValueError) as error:
            raise WorkerDiedError(f"a worker process is gone ({error})") from None
        kind, content = pickle.loads(data)
        return kind, content


def _write(pipe: IO[bytes], data: bytes) -> None:
    pipe.write(_SIZE.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def _read(pipe: IO[bytes]) -> bytes:
    head = pipe.read(_SIZE.size)
    if len(head) < _SIZE.size:
        raise EOFError("its pipe is closed")
    (size,) = _SIZE.unpack(head)
    data = pipe.read(size)
    if len(data) < size:
        raise EOFError("its pipe is closed")
    return data


# ---- the other process ------------------------------------------------------------------------


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer what is asked until nobody asks any more."""
    frames: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    # Beside the work: where the other side is gone, the work must not go on
    threading.Thread(target=_listen, args=(requests, frames), daemon=True).start()
    path, nice = pickle.loads(frames.get())
    sys.path[:] = path
    if nice and hasattr(os, "nice"):
        os.nice(nice)
    state, unusable = None, None
    try:
        state = pickle.loads(frames.get())
    except Exception as error:  # noqa: BLE001 -- said in answer to each call
        unusable = error

    def tell(content: Any) -> None:
        _write(answers, pickle.dumps(("told", content), _PROTOCOL))

    while True:
        frame = frames.get()
        if unusable is not None:
            reply: tuple[str, Any] = ("unsent", _portable(unusable))
        else:
            reply = _answer(state, frame, tell)
        try:
            data = pickle.dumps(reply, _PROTOCOL)
        except Exception as error:  # noqa: BLE001 -- raised where it was asked for
            data = pickle.dumps(("error", _portable(error)), _PROTOCOL)
        _write(answers, data)


def _answer(state: Any, frame: bytes, tell: Tell) -> tuple[str, Any]:
    try:
        function, arguments, tells = pickle.loads(frame)
    except Exception as error:  # noqa: BLE001 -- it is not known here
        return "unsent", _portable(error)
    try:
        more = {"tell": tell} if tells else {}
        return "result", function(state, *arguments, **more)
    except Exception as error:  # noqa: BLE001 -- raised where it was asked for
        return "error", _portable(error)


def _portable(error: Exception) -> Exception:
    """Return the error, with where it came from as a note, or one in its place that can be sent."""
    error.add_note(f"in a worker process:\n{''.join(traceback.format_exception(error))}")
    try:
        pickle.loads(pickle.dumps(error, _PROTOCOL))
    except Exception:  # noqa: BLE001 -- whatever its class does
        return RuntimeError(repr(error))
    return error


def _listen(requests: IO[bytes], frames: queue.SimpleQueue[bytes]) -> None:
    try:
        while True:
            frames.put(_read(requests))
    finally:
        os._exit(0)


def main() -> None:
    """Serve the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What anything prints must not come between the answers
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
