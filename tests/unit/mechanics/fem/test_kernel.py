"""The compiled inner loops compute what numpy computes, and nobody needs them."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.model import problem_of
from skinlab.mechanics.fem import kernel
from skinlab.mechanics.fem.assembly import Assembly
from skinlab.mechanics.fem.element import QUAD8_FULL, QUAD8_REDUCED, QUAD9_FULL
from skinlab.mechanics.fem.mesh import Grading, suction_mesh
from skinlab.mechanics.fem.skin import Skin, prepare
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SCREENING_MESH, Geometry, trace
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.materials.extended_neo_hookean import ExtendedNeoHookean

ROOT = Path(__file__).resolve().parents[4]
SKIN = {"X1_MPa": 0.03, "X2_MPa": 1.0, "kappa_MPa": 0.18}
BESIDE = {"C10_MPa": 0.02, "C01_MPa": 0.01}
needs_kernel = pytest.mark.skipif(
    kernel.library() is None, reason="there is no compiled kernel in this installation"
)


def problems(element, law="extended_neo_hookean", mesh=None, held=False):
    """The same suction problem with the compiled loops and without."""
    if mesh is None:
        mesh = suction_mesh(3.0, 1.0, 9.0, Grading(0.4, 2.0, 1.0, 2.0, 0.5), element.nodes)
    fixed = np.unique(
        np.concatenate([2 * mesh.axis, 2 * mesh.tape, 2 * mesh.tape + 1, 2 * mesh.outer])
    )
    both = [Assembly(mesh, element, get_law(law), fixed, compiled=c) for c in (True, False)]
    return both, int(both[0].equation[2 * mesh.apex + 1])


def assert_same(compiled, plain):
    scale = np.abs(plain.tangent).max()
    np.testing.assert_allclose(compiled.tangent, plain.tangent, atol=1e-13 * scale, rtol=0)
    np.testing.assert_allclose(compiled.residual, plain.residual, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(compiled.load, plain.load, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(compiled.deformation, plain.deformation, atol=1e-14)
    for name in ("energy", "volume", "j_min", "j_max"):
        assert getattr(compiled, name) == pytest.approx(getattr(plain, name), rel=1e-12)
    assert compiled.least_acoustic() == pytest.approx(plain.least_acoustic(), rel=1e-12)


@needs_kernel
@pytest.mark.parametrize("law", ["extended_neo_hookean", "mooney_rivlin"])
@pytest.mark.parametrize("element", [QUAD8_FULL, QUAD8_REDUCED, QUAD9_FULL], ids=lambda e: e.name)
def test_the_compiled_loops_compute_what_numpy_does(element, law):
    (compiled, plain), _ = problems(element, law)
    rng = np.random.default_rng(5)
    u = 0.01 * rng.normal(size=plain.n)
    parameters = SKIN | BESIDE
    assert_same(*(x.evaluate(u, 0.01, parameters) for x in (compiled, plain)))
    m, q = plain.volumes.shape
    stress = 1e-3 * rng.normal(size=(4, m, q))
    assert_same(*(x.evaluate(u, 0.01, parameters, stress) for x in (compiled, plain)))
    stretches = 1 + 0.1 * rng.random((2, m))
    factor = 1 + rng.random(m)
    before, after = (x.prestrained(stretches, factor) for x in (compiled, plain))
    assert_same(*(x.evaluate(u, 0.01, parameters) for x in (before, after)))


@needs_kernel
@pytest.mark.parametrize("effects", [(), ("strain_stiffening", "hypodermis", "surface_layer")])
@pytest.mark.parametrize("law", ["extended_neo_hookean", "mooney_rivlin"])
def test_what_is_a_sum_of_terms_is_what_the_law_says(law, effects):
    effects = {name: get_effect(name).typical for name in effects}
    problem = problem_of(Skin((0.03, 1.0, 0.32), law=law), effects, Geometry(6.0, 1.0), cycle=1)
    prepared = prepare(problem, SCREENING_MESH)
    assembly, known = prepared.assembly, prepared.parameters(0.7)
    asked = {**known, "form": None}
    assert known["form"] is not None
    rng = np.random.default_rng(7)
    small = 0.02 * np.diff(np.unique(assembly.mesh.nodes[:, 1])).min()
    u, v = small * rng.normal(size=(2, assembly.n))
    assert_same(*(assembly.evaluate(u, 0.01, parameters) for parameters in (known, asked)))
    one, other = (assembly.virtual_work(u, v, 0.01, [[(2.0, x)]]) for x in (known, asked))
    np.testing.assert_allclose(one, other, rtol=1e-11)


def test_who_gives_another_energy_is_asked_for_it():
    class Other(ExtendedNeoHookean):
        def isochoric(self, i1, i2, j, parameters):
            return super().isochoric(i1, i2, j, parameters).scaled(2.0)

    assert get_law().form(SKIN) is not None
    assert Other().form(SKIN) is None


@needs_kernel
@pytest.mark.parametrize("element", [QUAD8_FULL, QUAD9_FULL], ids=lambda e: e.name)
def test_the_compiled_factor_solves_the_same_equations(element):
    (compiled, plain), _ = problems(element)
    u = 0.01 * np.random.default_rng(6).normal(size=plain.n)
    one, other = (x.evaluate(u, 0.01, SKIN) for x in (compiled, plain))
    right = np.stack([one.load, one.residual, np.arange(plain.n) % 7.0])
    expected = other.matrix.factorise().solve(right)
    factor = one.matrix.factorise()
    np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(factor.solve(right[1]), factor.solve(right)[1])


@needs_kernel
def test_what_is_not_positive_definite_has_no_compiled_factor():
    (compiled, plain), _ = problems(QUAD8_FULL)
    u = np.zeros(plain.n)
    for assembly in (compiled, plain):
        # a pressure no skin withstands: the load's stiffness takes more than the skin has
        assert assembly.evaluate(u, -10.0, SKIN).matrix.factorise() is None


@needs_kernel
def test_an_element_turned_inside_out_is_no_state():
    (compiled, plain), apex = problems(QUAD8_FULL)
    u = np.zeros(plain.n)
    u[apex] = -5.0
    assert compiled.evaluate(u, 0.0, SKIN) is None
    assert plain.evaluate(u, 0.0, SKIN) is None


@needs_kernel
@pytest.mark.parametrize("grid", [MESH_OF_RECORD, SCREENING_MESH], ids=lambda d: d.name)
@pytest.mark.parametrize("x", [(0.03, 1.0), (0.01, 4.9)])
def test_the_curve_is_the_same_to_a_millionth_of_a_micrometre(grid, x):
    (compiled, plain), apex = problems(grid.element, mesh=grid.mesh(Geometry(6.0, 1.0)))
    parameters = {**SKIN, "X1_MPa": x[0], "X2_MPa": x[1]}
    one, other = (trace(a, apex, parameters, 100.0, 3.0) for a in (compiled, plain))
    p = np.linspace(0.0, 100.0, 401)
    assert one.iterations == other.iterations
    np.testing.assert_allclose(1e3 * one(p), 1e3 * other(p), atol=1e-6, rtol=0)


@needs_kernel
def test_states_do_not_share_memory():
    (compiled, _), _ = problems(QUAD8_FULL)
    u = np.zeros(compiled.n)
    first = compiled.evaluate(u, 0.0, SKIN)
    before = first.tangent
    for k in range(4):
        compiled.evaluate(u + 1e-3 * k, 0.01, SKIN)
    np.testing.assert_array_equal(first.tangent, before)
    factor = compiled.evaluate(u, 0.0, SKIN).matrix.factorise()  # its state is gone
    expected = factor.solve(first.load)
    others = [compiled.evaluate(u + 1e-3, 0.01, SKIN) for _ in range(4)]
    np.testing.assert_array_equal(factor.solve(first.load), expected)
    assert all(x is not None for x in others)


def _hook():
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_without_a_compiler_the_installation_goes_on(tmp_path, capsys):
    library = tmp_path / "_kernel.so"
    library.write_bytes(b"of another time")
    assert _hook().compile_kernel(kernel.SOURCE, library, ["/no/such/compiler"]) is False
    assert not library.exists()
    assert "numpy computes" in capsys.readouterr().err


def test_source_that_does_not_compile_leaves_no_library(tmp_path):
    source = tmp_path / "kernel.c"
    source.write_text("this is no C")
    assert _hook().compile_kernel(source, tmp_path / "_kernel.so") is False


@needs_kernel
def test_a_library_of_another_source_is_not_used(tmp_path):
    names = re.findall(r"^\w[\w *]*?(skinlab_\w+)\(", kernel.SOURCE.read_text(), re.MULTILINE)
    assert "skinlab_source" in names
    source = tmp_path / "kernel.c"  # all that is asked for, and nothing in it: soon compiled
    source.write_text(
        "const char *skinlab_source(void) { return SKINLAB_SOURCE; }\n"
        + "".join(f"void {name}(void) {{}}\n" for name in names if name != "skinlab_source")
    )
    library = tmp_path / "_kernel.so"
    assert _hook().compile_kernel(source, library)
    assert kernel.load(library, source) is not None
    assert kernel.load(library, kernel.SOURCE) is None
    assert kernel.load(tmp_path / "absent.so", source) is None
