from __future__ import annotations

import os

import pytest
from studies import small, study

from sim_device.cohort import write_cohort


@pytest.fixture(scope="session")
def cohort(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cohort") / "curves"
    write_cohort(small(), folder, seed=5, broken=6)
    return folder


@pytest.fixture(scope="module", autouse=True)
def no_pictures():
    """Pictures are drawn, and not written: half of a study's time. A page is, in tests/unit/api."""
    with pytest.MonkeyPatch.context() as patch:
        svg = b'<svg xmlns="http://www.w3.org/2000/svg"/>'
        patch.setattr("skinlab.report.pictures.to_bytes", lambda figure, kind: svg)
        yield


@pytest.fixture(scope="module")
def made(cohort, no_pictures, tmp_path_factory):
    """A study of the cohort: its folder, and what the command said."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    out = tmp_path_factory.mktemp("study") / "study"
    done = study(cohort, "--out", out, "--workers", 1, "--json")
    return out, done
