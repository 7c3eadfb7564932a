"""A Function applied step after step: machine code, the virtual machine and a plain loop agree."""

import casadi as ca
import numpy as np
import pytest

from formulations.model import compiler as module
from formulations.model import recursion
from formulations.model.compiler import find_compiler
from formulations.model.recursion import Recursion


@pytest.fixture(autouse=True)
def compiled_at_once(monkeypatch):
    monkeypatch.setattr(recursion, "BREAK_EVEN", 0)


def spiral():
    """A step of a vector by a matrix and a number, with a root that a compiler might fuse."""
    x, At, b = ca.SX.sym("x", 3), ca.SX.sym("At", 3, 3), ca.SX.sym("b")
    return ca.Function("spiral", [x, At, b], [At.T @ x / ca.sqrt(1 + ca.sumsqr(x)) + b * x[0]])


def inputs(steps):
    rng = np.random.default_rng(steps)
    return rng.normal(size=(steps, 3, 3)), rng.normal(size=steps)


def walked(turning, A, b):
    x = np.empty((len(b) + 1, 3))
    x[0] = 1.0, -2.0, 0.5
    turning(x, A, b)
    return x


@pytest.fixture
def interpreted(monkeypatch):
    monkeypatch.setattr(module, "find_compiler", lambda: None)
    return Recursion(spiral())


VIEWS = {
    "forwards": lambda a: a,
    "backwards": lambda a: a[::-1],
    "every-other": lambda a: a[::2],
    "the-same": lambda a: np.broadcast_to(a[0], a.shape),
    "transposed": lambda a: a.swapaxes(1, 2) if a.ndim > 1 else a,
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("steps", [1, 2, 31])
def test_each_step_is_made_of_the_last_ones_result(view, steps):
    A, b = map(VIEWS[view], inputs(steps))
    found = walked(Recursion(spiral()), A, b)
    for k in range(len(b)):
        x = found[k]
        expected = A[k] @ x / np.sqrt(1 + x @ x) + b[k] * x[0]
        np.testing.assert_allclose(found[k + 1], expected, rtol=1e-13, atol=1e-14)


@pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize("view", VIEWS)
def test_machine_code_gives_the_bits_of_the_virtual_machine(view, interpreted, monkeypatch):
    A, b = map(VIEWS[view], inputs(57))
    monkeypatch.undo()
    compiled = Recursion(spiral())
    np.testing.assert_array_equal(walked(compiled, A, b), walked(interpreted, A, b))


@pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
def test_one_library_serves_any_number_of_steps(tmp_path, monkeypatch):
    monkeypatch.setenv("OBSPLAN_CACHE", str(tmp_path / "cache"))
    for steps in (1, 5, 400):
        walked(Recursion(spiral()), *inputs(steps))
    assert len(list((tmp_path / "cache").iterdir())) == 1


@pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
def test_what_is_done_sooner_without_is_not_compiled(tmp_path, monkeypatch):
    monkeypatch.setenv("OBSPLAN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(recursion, "BREAK_EVEN", 100)
    short = Recursion(spiral())
    count = lambda: len(list((tmp_path / "cache").iterdir()))  # noqa: E731
    walked(short, *inputs(60))
    assert count() == 0
    walked(short, *inputs(60))
    assert count() == 1
    monkeypatch.setattr(module, "_built", None)  # what was built is loaded, not built again
    walked(Recursion(spiral()), *inputs(3))


def test_no_steps_leave_the_first_sample_as_it_is():
    assert walked(Recursion(spiral()), *inputs(0)).tolist() == [[1.0, -2.0, 0.5]]


def test_what_does_not_fit_is_refused_before_it_is_read():
    A, b = inputs(5)
    turning, x = Recursion(spiral()), np.ones((6, 3))
    with pytest.raises(ValueError, match="input 1 must be 9 numbers for each of 5 steps"):
        turning(x, A[:4], b)
    with pytest.raises(ValueError, match="input 2 must be 1 numbers for each of 5 steps"):
        turning(x, A, np.ones(6))
    for wrong in (np.ones((6, 2)), np.ones((3, 6)).T, np.ones((6, 3), dtype=np.float32)):
        with pytest.raises(ValueError, match="x must be 3 floats for each of 6 samples"):
            turning(wrong, A, b)
