"""A stretch of the day that `benchmarks/day.py` runs through: nothing is kept that need not be."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

DAY = Path(__file__).parents[2] / "benchmarks" / "day.py"


@pytest.mark.long
@pytest.mark.skipif(not DAY.exists(), reason="benchmarks/ is not in the sdist")
def test_minutes_of_a_day_at_100_hz_in_flat_memory():
    done = subprocess.run(
        [sys.executable, str(DAY), "--hours", "0.15"],
        capture_output=True, text=True, check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["curves"] == 9
    assert found["samples"] == 9 * 56 * 100
    assert found["vents_of_the_host"] == 0
    # The journal takes 2 MB of such a stretch; samples kept in memory would take 15 MB or more
    assert found["grown_mb_in_the_second_half"] < 5.0
