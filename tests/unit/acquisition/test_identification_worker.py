from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from skinlab.acquisition.analysis import default_identifier
from skinlab.acquisition.identification_worker import IdentifierApart
from skinlab.curves.curve import Curve, Setup
from skinlab.curves.program import parse_program
from skinlab.mechanics.fem.suction import Geometry

PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def identifier():
    return default_identifier()


@pytest.fixture(scope="module")
def curve(identifier):
    time_s = np.arange(101) / 20
    pressure = 20.0 * time_s
    setup = Setup(6.0, 1.0, parse_program("ramp:100@20"))
    model = identifier.database.model(Geometry(6.0, 1.0), pressure, "paper")
    clean = model.deflection_mm(np.array([[0.03, 1.0, 0.32]]))[0]
    noise = np.random.default_rng(3).normal(0.0, 0.003, len(time_s))
    return Curve("ramp", setup, time_s, pressure, clean + noise)


@pytest.fixture
def process(identifier):
    found = IdentifierApart(identifier)
    found.warm()  # changes no answer
    yield found
    found.close()


def same(one, other):
    """Whether two answers are the same, bit by bit; the time that they took may differ."""
    return pickle.dumps(replace(one, seconds=0.0).parameters) == pickle.dumps(
        replace(other, seconds=0.0).parameters
    )


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


def test_the_answers_are_those_of_the_identifier(process, identifier, curve):
    assert same(process(curve), identifier(curve))
    first = process.growing(curve)
    assert same(first, identifier.growing(curve))
    assert same(process.growing(curve, first), identifier.growing(curve, first))
    assert process.phases == identifier.phases
    number = process.pid
    assert number != os.getpid()
    with pytest.raises(AttributeError):  # here, and the process goes on
        process("no curve")
    assert process.pid == number
    process.close()
    assert is_gone(number)


def test_where_the_process_is_killed_this_one_answers(process, identifier, curve):
    assert same(process(curve), identifier(curve))
    os.kill(process.pid, signal.SIGKILL)
    assert same(process(curve), identifier(curve))
    assert process.pid is None


def test_the_process_ends_with_the_one_that_asked():
    program = (
        "import time\n"
        "from skinlab.acquisition.analysis import default_identifier\n"
        "from skinlab.acquisition.identification_worker import IdentifierApart\n"
        "process = IdentifierApart(default_identifier())\n"
        "print(process.pid, flush=True)\n"
        "time.sleep(600)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    number = int(parent.stdout.readline())
    assert not is_gone(number)
    parent.kill()
    parent.communicate()
    until(lambda: is_gone(number))
