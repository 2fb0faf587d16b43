"""The paper's results on small studies: what theory says of them, and the files they become."""

from __future__ import annotations

import csv
import errno
import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from skinlab.cli.main import run
from skinlab.errors import InputError
from skinlab.inference.problem import Options
from skinlab.reproduction import jobs, many_curves, output, page, tables
from skinlab.reproduction.cases import (
    BLIND_TRUTH,
    PRESSURE_MBAR,
    RECIPE,
    STAND_IN_TRUTH,
    Blind,
    Skin,
    StandIn,
    model_mm,
    smooth_misfit_mm,
)
from skinlab.reproduction.jobs import BestAtNu, Identify, NeoHookean, Plane, execute
from skinlab.reproduction.part import Comparison, Part, Table
from skinlab.reproduction.published_values import PAPER_BOX
from skinlab.reproduction.reproduce import ORDER, reproduce
from skinlab.reproduction.scatter import Scatter
from skinlab.reproduction.study import Study

SMALL = Study(
    samples=(50, 200),
    repeats=3,
    best=(2, 10, 20),
    sweep_repeats=2,
    sweep_samples=100,
    ratio_samples=(50, 100),
    curves=4,
    passes=3,
    noise_draws=2,
    X1_MPa=(0.05, 0.1),
    nu=(0.2, 0.48),
)


@pytest.fixture(scope="module")
def small():
    return reproduce(SMALL)


class TestCases:
    def test_the_stand_in_leaves_what_table_2_says_at_the_best_fit(self):
        found = [Identify(StandIn(), "sto", Options(samples=500), run=r)() for r in range(3)]
        assert [f.error_um for f in found] == pytest.approx([2.0] * 3, abs=0.1)
        near = np.mean([f.parameters for f in found], axis=0)
        np.testing.assert_allclose(near, STAND_IN_TRUTH, rtol=0.15)

    def test_no_change_of_the_parameters_explains_the_stand_ins_misfit(self):
        misfit = smooth_misfit_mm()
        for d, step in enumerate((1e-4, 1e-2, 1e-3)):
            shifted = np.array([STAND_IN_TRUTH, STAND_IN_TRUTH])
            shifted[:, d] += [-step, step]
            slope = np.diff(model_mm(shifted), axis=0)[0]
            assert abs(misfit @ slope) < 1e-2 * np.linalg.norm(misfit) * np.linalg.norm(slope)
        assert np.sqrt(np.mean(misfit**2)) == pytest.approx(14e-3)

    def test_the_recipe_names_its_numbers(self):
        for said in ("stand-in", "0.026", "3.1", "0.26", "14 µm", "3 µm", "default_rng(3)"):
            assert said in RECIPE

    def test_a_skin_is_fixed_by_its_seed_and_number(self):
        for a, b in zip(Skin(1, 5).measured(), Skin(1, 5).measured(), strict=True):
            np.testing.assert_array_equal(a, b)
        assert not np.array_equal(Skin(1, 5).measured()[1], Skin(1, 6).measured()[1])
        assert not np.array_equal(Skin(1, 5).measured()[1], Skin(2, 5).measured()[1])

    def test_skins_are_read_with_the_sensors_noise_and_steps(self):
        pressure = np.array([Skin(0, k).measured()[0] for k in range(20)])
        assert (pressure - PRESSURE_MBAR).std() == pytest.approx(0.2, rel=0.1)
        np.testing.assert_allclose(10 * pressure, np.round(10 * pressure), atol=1e-9)
        for number in range(20):
            x, thickness = Skin(0, number).truth()
            assert 0.8 <= thickness <= 1.6
            low, high = PAPER_BOX.bounds
            assert ((x >= low) & (x <= high)).all()


class TestBlindTest:
    @pytest.mark.long
    def test_gauss_newton_and_recursive_least_squares_reach_the_truth(self):
        """Table 1; a dozen passes are on the way, the 29 of the whole run at it."""
        gn = tables.gauss_newton(Blind())()
        np.testing.assert_allclose(gn.parameters, BLIND_TRUTH, atol=1e-5)
        rls = tables.recursive(Study(), Blind(), 0.9)()
        assert rls.converged
        np.testing.assert_allclose(rls.parameters, BLIND_TRUTH, atol=5e-4)
        assert rls.error_um < 1e-3
        assert len(rls.passes) == rls.iterations
        np.testing.assert_array_equal(rls.passes[-1], [*rls.parameters, rls.error_um])

    @pytest.mark.long
    def test_more_samples_scatter_less_about_the_truth(self):
        def scatter(samples):
            runs = tables.stochastic(Study(), Blind(), samples, 8)
            return Scatter.of([each() for each in runs])

        few, many = scatter(100), scatter(800)
        assert (many.sd[:2] < 0.7 * few.sd[:2]).all()  # of X1 and X2; ν follows later
        assert many.error_um.mean() < few.error_um.mean()
        # The mean of 8 is known to a third of a case's standard deviation.
        assert (np.abs(many.mean - BLIND_TRUTH) < 1.5 * many.sd + [0.0005, 0.05, 0.02]).all()

    @pytest.mark.long
    def test_fewer_iterations_with_a_larger_ratio(self):
        """A box has about N_b / N of the volume of the one before."""
        counts = [
            np.mean([Identify(Blind(), "sto", Options(samples=300, best=b), run=r)().iterations
                     for r in range(3)])
            for b in (60, 30, 15, 5)
        ]  # fmt: skip
        assert (np.diff(counts) < 0).all()


class TestStandIn:
    def test_gauss_newton_ends_at_a_bound_and_not_at_the_best_fit(self):
        found = tables.gauss_newton(StandIn())()
        assert found.at_bounds() == ("ν = 0.48",)
        assert found.error_um > 4.0

    def test_direct_finite_elements_reach_100_mbar_at_the_papers_end(self):
        """And are as far from the stand-in there as Table 2 says, 43 µm, but for rounding."""
        assert tables.papers_end_um() == pytest.approx(46.0, abs=0.2)

    @pytest.mark.long
    def test_no_statement_is_judged_that_the_stand_in_decides(self, small):
        parts, _ = small
        on_it = ("table_2", "figure_9", "figure_10", "figure_11", "figure_12")
        for part in parts:
            for said in part.comparisons:
                assert (said.agrees is None) >= (part.name in on_it), said.what
        assert sum(c.agrees is None for part in parts for c in part.comparisons) >= 15

    def test_the_valley_is_nearly_flat(self):
        """ν from 0.22 to 0.40 costs less than a tenth of a µm of E."""
        floor = [BestAtNu(StandIn(), nu)() for nu in (0.22, 0.26, 0.34, 0.40)]
        error = [f.error_um for f in floor]
        assert max(error) - min(error) < 0.1
        x2 = [f.parameters[1] for f in floor]
        assert (np.diff(x2) < 0).all()
        assert [f.parameters[2] for f in floor] == [0.22, 0.26, 0.34, 0.40]

    @pytest.mark.long
    def test_recursive_least_squares_comes_near_soon_and_leaves_again(self):
        found = tables.recursive(Study(passes=30), StandIn(), 0.9)()
        assert not found.converged
        assert found.passes[:5, 3].min() < 2.3 < found.passes[5:, 3].max()


def test_a_plane_is_the_box_with_one_parameter_fixed():
    plane = Plane(1, 1.0)
    assert plane.names == ("X1_MPa", "nu")
    corner = plane.from_unit(np.array([[0.0, 1.0]]))
    np.testing.assert_allclose(corner, [[0.01, 1.0, 0.48]])
    np.testing.assert_allclose(plane.to_unit(corner), [[0.0, 1.0]])
    low, high = plane.bounds
    np.testing.assert_allclose((low, high), [[0.01, 0.2], [0.1, 0.48]])


def test_without_x2_soft_skin_gives_no_number_beyond_its_crease():
    stiff, soft = NeoHookean(0.1, 0.48)(), NeoHookean(0.02, 0.2)()
    assert np.isfinite(stiff).all()
    assert (np.diff(stiff) > 0).all()
    assert np.isnan(soft[-1])
    assert np.isfinite(soft[:5]).all()


class TestWhole:
    @pytest.mark.long
    def test_every_part_is_there_in_the_papers_order(self, small):
        parts, _ = small
        assert [part.name for part in parts] == list(ORDER)
        for part in parts:
            widths = {len(row) for row in part.table.rows}
            assert widths == {len(part.table.columns)}, part.name
            if part.name != "valley":
                assert part.comparisons, part.name

    @pytest.mark.long
    def test_workers_do_not_change_a_bit(self):
        wanted = [
            *tables.stochastic(SMALL, StandIn(), 50, 2),
            tables.gauss_newton(Blind()),
            *many_curves.jobs(SMALL),
        ]
        alone, together = execute(wanted, 1), execute(wanted, 2)
        for job in wanted:
            np.testing.assert_array_equal(alone[job].parameters, together[job].parameters)
            assert alone[job].error_um == together[job].error_um

    def test_progress_ends_at_one(self):
        shares: list[float] = []
        execute([tables.gauss_newton(Blind()), *many_curves.jobs(SMALL)], 1, shares.append)
        assert sum(shares) == pytest.approx(1.0)

    @pytest.mark.long
    def test_another_seed_is_another_study(self, small):
        runs = tables.stochastic(replace(SMALL, seed=1), Blind(), 50, 1)
        first = tables.stochastic(SMALL, Blind(), 50, 1)
        assert not np.array_equal(runs[0]().parameters, first[0]().parameters)

    def test_where_nothing_can_be_written_nothing_is_computed(self, tmp_path, monkeypatch):
        def refuse(**_):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))

        monkeypatch.setattr("tempfile.TemporaryFile", refuse)
        with pytest.raises(InputError, match=r"times\.csv: cannot be written"):
            output.Target(tmp_path / "out").check(ORDER)

    @pytest.mark.long
    def test_files(self, small, tmp_path):
        parts, times = small
        target = output.Target(tmp_path / "a")
        written = target.write(SMALL, parts, times)
        assert {p.name for p in (tmp_path / "a").iterdir()} == {
            "paper.md", "times.csv", output.MANIFEST,
            *(f"{name}.csv" for name in ORDER),
            *(f"{name}.png" for name in ORDER if not name.startswith("table")),
        }  # fmt: skip
        assert sorted(p.name for p in written) == sorted(
            p.name for p in (tmp_path / "a").iterdir() if p.name != output.MANIFEST
        )
        for part in parts:
            with (tmp_path / "a" / f"{part.name}.csv").open(encoding="utf-8") as file:
                header, *rows = csv.reader(file)
            assert tuple(header) == part.table.columns
            assert len(rows) == len(part.table.rows)
        text = (tmp_path / "a" / "paper.md").read_text(encoding="utf-8")
        for part in parts:
            assert f"## {part.title}" in text
            assert f"({part.name}.csv)" in text
        output.Target(tmp_path / "a").check(ORDER)  # what it wrote itself is not in its way


class TestTarget:
    PART = Part("figure_7", "Figure 7: x", Table(("a",), ((1.0,), (None,))))
    TIMES = Table(("a",), ())

    def test_a_foreign_file_is_never_overwritten(self, tmp_path):
        (tmp_path / "figure_7.csv").write_text("mine")
        with pytest.raises(InputError, match=r"figure_7\.csv: exists and is not"):
            output.Target(tmp_path).check(ORDER)

    @pytest.mark.long
    def test_the_same_parts_are_the_same_bits(self, small, tmp_path):
        (part,) = [p for p in small[0] if p.name == "figure_9"]
        once, twice = (
            [*output.Target(tmp_path / n).write(SMALL, [part], self.TIMES)] for n in "ab"
        )
        for a, b in zip(once, twice, strict=True):
            assert a.read_bytes() == b.read_bytes()

    def test_nor_is_one_that_was_changed_since(self, tmp_path):
        target = output.Target(tmp_path)
        target.write(Study(), [self.PART], self.TIMES)
        output.Target(tmp_path).check(ORDER)
        (tmp_path / "paper.md").write_text("my notes")
        with pytest.raises(InputError, match=r"paper\.md: exists and is not"):
            output.Target(tmp_path).check(ORDER)

    def test_the_page_can_lie_elsewhere_and_its_links_follow(self, tmp_path):
        target = output.Target(tmp_path / "docs" / "paper", tmp_path / "paper.md")
        target.write(Study(), [self.PART], self.TIMES)
        assert "(docs/paper/figure_7.csv)" in (tmp_path / "paper.md").read_text(encoding="utf-8")
        assert not (tmp_path / "docs" / "paper" / "paper.md").exists()
        output.Target(tmp_path / "docs" / "paper", tmp_path / "paper.md").check(ORDER)

    @pytest.mark.parametrize("text", ["", "[]", "{}", '{"files": 3}', "\x00"])
    def test_a_list_that_is_none_is_refused(self, tmp_path, text):
        (tmp_path / output.MANIFEST).write_text(text)
        with pytest.raises(InputError, match="not readable as the list"):
            output.Target(tmp_path)

    def test_no_folder(self, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match="is not a folder"):
            output.Target(tmp_path / "file")
        with pytest.raises(InputError, match="its folder does not exist"):
            output.Target(tmp_path, tmp_path / "absent" / "paper.md")


def test_the_page_counts_what_holds_and_says_what_does_not():
    said = (
        Comparison("it rains", "wet", "wet", True),
        Comparison("it snows", "white", "green", False, "it is May"),
        Comparison("it will snow", "soon", "who knows", None, "not yet"),
    )
    part = Part("figure_7", "Figure 7: weather", Table(("a",), ()), said)
    text = page.page(Study(seed=4), [part], lambda name: f"there/{name}")
    assert "`skinlab paper --seed 4`" in text
    assert "Of 3 statements compared, 1 hold here, 1 do not, and 1 cannot be tested here" in text
    assert "- Figure 7: it will snow" not in text
    assert "| it will snow | soon | who knows | cannot be tested here | not yet |" in text
    assert "- Figure 7: it snows. Here: green." in text
    assert "| it snows | white | green | **no** | it is May |" in text
    assert "[figure_7.csv](there/figure_7.csv)" in text


def test_a_table_as_csv_and_as_markdown():
    table = Table(("name", "x_mm"), (("a", 1 / 3), ("b", None), ("c", float("nan"))))
    assert table.csv() == "name,x_mm\na,0.333333333\nb,\nc,\n"
    assert table.markdown().splitlines()[2:] == ["| a | 0.3333 |", "| b | – |", "| c | – |"]


class TestCommand:
    def call(self, capsys, *arguments):
        status = run(["paper", *map(str, arguments)])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    @pytest.mark.long
    def test_prints_the_paths_that_it_wrote(self, small, capsys, tmp_path, monkeypatch):
        parts, times = small
        made = lambda study, workers, progress: (parts[:2], times)  # noqa: E731
        monkeypatch.setattr("skinlab.reproduction.reproduce.reproduce", made)
        status, out, err = self.call(capsys, "--out", tmp_path / "p", "--workers", 1)
        assert (status, err) == (0, "")
        paths = out.splitlines()
        assert paths[0].endswith("paper.md")
        listed = json.loads((tmp_path / "p" / output.MANIFEST).read_text())["files"]
        assert len(listed) == len(paths)

    @pytest.mark.parametrize(
        ("arguments", "status", "says"),
        [
            (["--seed", "-1"], 3, "seed -1"),
            (["--workers", "0"], 3, "workers 0: expected 1–1024"),
            (["--out", "/dev/null/x"], 3, "/dev/null/x"),
            (["--seed", "x"], 2, "not a valid integer"),
        ],
    )
    def test_bad_input(self, capsys, tmp_path, monkeypatch, arguments, status, says):
        monkeypatch.chdir(tmp_path)
        got, out, err = self.call(capsys, *arguments)
        assert (got, out) == (status, "")
        assert says in err

    def test_foreign_files_are_refused_before_anything_is_computed(
        self, capsys, tmp_path, monkeypatch
    ):
        monkeypatch.setattr(jobs, "execute", lambda *_: pytest.fail("computed"))
        (tmp_path / "paper.md").write_text("mine")
        status, _, err = self.call(capsys, "--out", tmp_path)
        assert status == 3
        assert "paper.md: exists and is not" in err

    def test_a_missing_matplotlib_is_one_sentence(self, capsys, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        status, _, err = self.call(capsys, "--out", tmp_path / "p")
        assert status == 3
        assert "the pictures need matplotlib, which is not installed" in err
        assert not (tmp_path / "p").exists()

    def test_help_imports_nothing_heavy(self):
        code = (
            "import sys\nfrom skinlab.cli.main import run\nrun(['paper', '--help'])\n"
            "heavy = {'numpy', 'matplotlib', 'scipy'} & set(sys.modules)\n"
            "sys.exit(f'imported: {heavy}' if heavy else 0)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
