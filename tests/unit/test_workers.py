"""Work in other processes: the same answers, whatever happens to the process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from skinlab.errors import InputError
from skinlab.workers import Pool, Worker, WorkerDiedError

PATIENCE_S = 60.0


def add(state, number):
    return state + number


def where(state, _):
    return os.getpid()


def threads_of_algebra(state):
    return os.environ["OPENBLAS_NUM_THREADS"]


def refuse(state, text):
    raise InputError(text)


class Odd(Exception):  # noqa: N818
    """Goes into a pickle, and does not come out."""

    def __init__(self, one, two):
        super().__init__(one)


def raise_odd(state):
    raise Odd(1, 2)


def kill_me(state):
    os.kill(os.getpid(), signal.SIGKILL)


def kill_me_once(folder, number):
    mark = Path(folder) / str(number)
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def kill_me_always(state, number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def say(state, words, tell):
    for word in words:
        tell(word)
    return len(words)


def speak(state):
    print("this is no answer")  # noqa: T201 -- as a library might
    return 7


def sleep(state, seconds):
    time.sleep(seconds)


def send_pid_and_sleep(state, tell):
    tell(os.getpid())
    time.sleep(600)


def is_gone(number):
    try:
        with open(f"/proc/{number}/stat") as file:
            return file.read().split()[2] == "Z"
    except FileNotFoundError:
        return True


def until(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def worker():
    worker = Worker(40)
    yield worker
    worker.close()


class TestWorker:
    def test_it_answers_in_a_process_of_its_own(self, worker):
        assert worker.call(add, 2) == 42
        assert worker.call(where, 0) == worker.pid != os.getpid()
        assert worker.call(threads_of_algebra) == "1"

    def test_errors_come_back_as_they_are_and_say_where_they_come_from(self, worker):
        with pytest.raises(InputError) as caught:
            worker.call(refuse, "no such thing")
        assert str(caught.value) == "no such thing"
        assert "in refuse" in caught.value.__notes__[0]
        assert worker.call(add, 2) == 42

    def test_an_error_that_cannot_be_sent_is_told_all_the_same(self, worker):
        with pytest.raises(RuntimeError, match="Odd"):
            worker.call(raise_odd)

    def test_what_is_told_comes_at_once_and_in_order(self, worker):
        told = []
        assert worker.call(say, ("one", "two"), tell=told.append) == 2
        assert told == ["one", "two"]

    def test_what_is_printed_there_is_no_answer(self, worker):
        assert worker.call(speak) == 7

    def test_where_it_is_killed_this_process_answers(self, worker):
        os.kill(worker.pid, signal.SIGKILL)
        assert worker.call(add, 2) == 42
        assert worker.pid is None
        assert worker.call(where, 0) == os.getpid()

    def test_where_it_is_killed_and_nothing_is_to_be_done_here(self):
        worker = Worker(0, here=False)
        with pytest.raises(WorkerDiedError):
            worker.call(kill_me)

    def test_where_it_cannot_be_started_this_process_answers(self):
        worker = Worker(40, command=["/no/such/program"])
        assert worker.call(add, 2) == 42

    def test_a_state_that_cannot_be_sent_stays_here(self):
        worker = Worker(threading.Lock())
        assert worker.pid is None
        assert worker.call(where, 0) == os.getpid()

    def test_who_is_told_may_end_it(self):
        worker = Worker(0, here=False)
        with pytest.raises(WorkerDiedError):
            worker.call(send_pid_and_sleep, tell=lambda _: worker.kill())
        worker.close()
        assert worker.pid is None

    def test_closing_ends_it_in_the_midst_of_its_work(self):
        worker = Worker(0, here=False)
        number = worker.pid
        ended = []

        def ask():
            with pytest.raises(WorkerDiedError):
                worker.call(sleep, 600)
            ended.append(True)

        thread = threading.Thread(target=ask)
        thread.start()
        worker.close()
        thread.join(PATIENCE_S)
        assert ended
        assert is_gone(number)


class TestPool:
    def test_answers_are_in_order_and_the_same_for_any_number_of_workers(self):
        tasks = list(range(20))
        for workers in (1, 3):
            with Pool(workers, 1) as pool:
                assert list(pool.map(add, tasks)) == [n + 1 for n in tasks]
                assert list(pool.map(add, [])) == []

    def test_one_worker_is_this_process(self):
        with Pool(1) as pool:
            assert list(pool.map(where, [0])) == [os.getpid()]

    def test_errors_come_back_as_they_are(self):
        with Pool(2) as pool, pytest.raises(InputError) as caught:
            list(pool.map(refuse, ["what"]))
        assert str(caught.value) == "what"

    def test_a_dead_worker_is_told_and_its_work_done_again(self, tmp_path, caplog):
        with Pool(2, str(tmp_path)) as pool:
            assert list(pool.map(kill_me_once, range(6))) == [0, 1, 4, 9, 16, 25]
        assert "a worker process died; its work is done again" in caplog.text

    def test_work_that_kills_every_process_is_given_up(self):
        with Pool(2) as pool, pytest.raises(WorkerDiedError, match="died twice"):
            list(pool.map(kill_me_always, range(6)))

    def test_a_state_that_cannot_be_sent_stays_here(self):
        with Pool(2, threading.Lock()) as pool:
            assert list(pool.map(where, [0, 0])) == [os.getpid()] * 2

    def test_closing_gives_up_what_is_left(self):
        pool = Pool(2)
        results = pool.map(sleep, [600] * 5)
        pool.close()
        with pytest.raises(BaseException):  # noqa: B017, PT011 -- died, or never begun
            next(results)


IN_THE_MIDST = """
import sys
sys.path[:0] = [{folder!r}]
from test_workers import send_pid_and_sleep
from skinlab.workers import Worker
Worker(0).call(send_pid_and_sleep, tell=lambda pid: print(pid, flush=True))
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_it_ends_with_the_process_that_asked(how):
    """Also in the midst of its work; from a script without a main guard."""
    code = IN_THE_MIDST.format(folder=str(Path(__file__).parent))
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    number = int(parent.stdout.readline())
    assert not is_gone(number)
    parent.send_signal(how)
    parent.communicate(timeout=PATIENCE_S)
    until(lambda: is_gone(number))
