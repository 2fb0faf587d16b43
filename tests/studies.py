"""What the tests of studies share."""

from __future__ import annotations

import csv

from click.testing import CliRunner

from sim_device.cohort import CohortFile, Shifts, Size
from skinlab.cli.main import cli


def small(**size):
    """Return a cohort that is quick to measure, without errors of sensors."""
    return CohortFile(
        cohort=Size(**{"people": 4, "sites": ("forearm",), "visits": 2, "placements": 2, **size}),
        probe=Shifts(),
        placement=Shifts(stiffness=0.05),
    )


def study(*arguments):
    """Run the command in this process; return its exit status and output."""
    done = CliRunner().invoke(cli, ["study", *map(str, arguments)], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
