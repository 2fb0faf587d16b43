"""Tasks on processes: each one once, whatever happens to its process."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from studies import tenfold

from skinlab.workers import on_processes


@pytest.mark.long
def test_a_process_that_dies_takes_one_task_with_it():
    found = dict(on_processes(tenfold, 10, iter(range(10, 20)), 2))
    assert found == {n: None if n == 13 else 10 * n for n in range(10, 20)}


def test_where_nothing_is_to_do_no_process_starts(monkeypatch):
    monkeypatch.setattr("skinlab.workers.Worker", None)
    assert list(on_processes(tenfold, 10, iter(()), 2)) == []


@pytest.mark.long
def test_tasks_are_taken_as_they_are_needed():
    taken = []

    def tasks():
        for n in range(100, 200):
            taken.append(n)
            yield n

    results = on_processes(tenfold, 10, tasks(), 2)
    assert next(results)[1] is not None
    assert len(taken) <= 8
    results.close()


@pytest.mark.long
def test_a_study_killed_as_it_begins_leaves_no_traceback(cohort, tmp_path):
    out = tmp_path / "study"
    command = [sys.executable, "-m", "skinlab", "study", str(cohort), "--out", str(out)]
    with subprocess.Popen(
        [*command, "--workers", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        while not (out / "study.sqlite").exists():  # the workers start next
            assert process.poll() is None
            time.sleep(0.005)
        process.kill()
        assert process.stderr is not None
        assert process.stderr.read() == ""  # to its end: the workers are gone, too
