"""Machine code from CasADi's Functions: the same bits, built once, and never in the way."""

import logging
import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from formulations.model import compiler as module
from formulations.model.casadi import Cases, Elementwise, cases_driver, machine_code, of_each
from formulations.model.compiler import find_compiler, say_there_is_no_compiler

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
CODE = "#!/bin/sh\n"


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own for each test, and nothing remembered of compilers."""
    monkeypatch.setenv("OBSPLAN_CACHE", str(tmp_path / "cache"))
    find_compiler.cache_clear()
    say_there_is_no_compiler.cache_clear()
    yield tmp_path / "cache"
    find_compiler.cache_clear()


def pendulum(damping=0.1):
    """A Function with roots, trigonometry and sums of products, which a compiler might fuse."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    y = ca.vertcat(
        x[0] * x[1] + ca.sin(x[2]),
        ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1) - damping * x[1],
        ca.atan2(x[2], x[0]) * u + x[1],
    )
    return ca.Function("step", [x, u], [y])


def values(function):
    rng = np.random.default_rng(0)
    return np.array([function(rng.normal(size=3), rng.normal()).full() for _ in range(200)])


def fake_compiler(folder, script, monkeypatch):
    """A program that is found as the compiler."""
    path = folder / "mycc"
    path.write_text(CODE + script)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("CC", str(path))
    find_compiler.cache_clear()


def test_machine_code_gives_the_same_bits():
    interpreted = pendulum()
    compiled = machine_code(interpreted)
    assert "External" in compiled.class_name()
    np.testing.assert_array_equal(values(compiled), values(interpreted))


def test_library_is_built_once_for_each_content(cache, monkeypatch):
    machine_code(pendulum())
    (library,) = cache.iterdir()
    built = library.stat().st_mtime_ns
    machine_code(pendulum())
    assert [path.stat().st_mtime_ns for path in cache.iterdir()] == [built]
    machine_code(pendulum(damping=0.2))
    assert len(list(cache.iterdir())) == 2
    monkeypatch.setattr(module, "FLAGS", ("-O1", *module.FLAGS[1:]))
    machine_code(pendulum())
    assert len(list(cache.iterdir())) == 3


def test_another_compiler_makes_another_library(cache, tmp_path, monkeypatch):
    machine_code(pendulum())
    fake_compiler(
        tmp_path,
        f'[ "$1" = --version ] && echo "mycc 1" && exit\nexec {find_compiler()} "$@"\n',
        monkeypatch,
    )
    machine_code(pendulum())
    assert len(list(cache.iterdir())) == 2


@pytest.mark.slow
def test_many_at_once_build_whole_libraries(cache):
    code = f"import sys; sys.path[:0] = {sys.path!r}\nimport test_machine_code as t\nt.machine_code(t.pendulum())(1, 1)"
    run = lambda _: subprocess.run([sys.executable, "-c", code], check=True, env=os.environ)  # noqa: E731
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(run, range(3)))
    (library,) = cache.iterdir()  # and no temporary folder
    assert library.suffix == ".so"


def test_compiler_killed_at_work_leaves_no_half_built_library(cache, tmp_path, monkeypatch, caplog):
    fake_compiler(
        tmp_path,
        '[ "$1" = --version ] && exit\nwhile [ "$1" != -o ]; do shift; done\nprintf half > "$2"\nkill -9 $$\n',
        monkeypatch,
    )
    function = pendulum()
    assert machine_code(function) is function
    assert list(cache.iterdir()) == []
    assert "mycc failed" in caplog.text


def test_without_a_compiler_the_function_itself_and_one_message(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    function = pendulum()
    assert machine_code(function) is function
    assert machine_code(function) is function
    assert caplog.messages == [
        "no C compiler found: using CasADi's virtual machine, with the same results, about three times slower"
    ]


def test_compiler_that_fails_is_quoted_and_the_function_itself_returned(
    cache, tmp_path, monkeypatch, caplog
):
    fake_compiler(tmp_path, "echo 'step.c:1: out of patience' >&2\nexit 1\n", monkeypatch)
    function = pendulum()
    assert machine_code(function) is function
    assert caplog.messages == [
        f"no generated code: {tmp_path}/mycc failed (step.c:1: out of patience); using CasADi's virtual machine"
    ]
    assert list(cache.iterdir()) == []


def test_cache_that_cannot_be_written_is_a_message_and_the_function_itself(monkeypatch, caplog):
    monkeypatch.setenv("OBSPLAN_CACHE", "/proc/cache")  # where no one can make a folder
    function = pendulum()
    with caplog.at_level(logging.WARNING):
        assert machine_code(function) is function
    assert "/proc/cache" in caplog.text
    assert "failed" not in caplog.text  # the compiler was not to blame
    assert "using CasADi's virtual machine" in caplog.text


def test_cache_folder_is_the_users_unless_named(tmp_path, monkeypatch):
    monkeypatch.delenv("OBSPLAN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    machine_code(pendulum())
    assert len(list((tmp_path / "xdg/obsplan").glob("*.so"))) == 1


# Libraries that are not ours


def only_library(cache):
    (library,) = cache.iterdir()
    return library


@pytest.mark.parametrize(
    "damage",
    [
        lambda library: library.write_bytes(b""),
        lambda library: library.write_bytes(library.read_bytes()[:-100]),
        lambda library: library.write_bytes(b"\x7fELF" + bytes(4000)),
        lambda library: library.write_bytes(library.read_bytes().replace(b"step", b"stop")),
    ],
    ids=["empty", "cut", "another", "edited"],
)
def test_library_that_is_damaged_is_never_loaded_and_built_anew(damage, cache, caplog):
    expected = values(machine_code(pendulum()))
    library = only_library(cache)
    whole = library.read_bytes()
    damage(library)
    np.testing.assert_array_equal(values(machine_code(pendulum())), expected)
    assert caplog.messages == [f"generated code in {library} is damaged; it is built anew"]
    assert only_library(cache).read_bytes() == whole


def test_library_of_another_function_under_this_ones_name_is_never_loaded(cache):
    expected = values(machine_code(pendulum()))
    ours = only_library(cache)
    machine_code(pendulum(damping=0.2))
    (other,) = set(cache.iterdir()) - {ours}
    ours.write_bytes(other.read_bytes())
    np.testing.assert_array_equal(values(machine_code(pendulum())), expected)
    # the whole name of the other, put under this one's first part
    digest = other.name.split("-")[1]
    ours.unlink()
    (cache / f"{ours.name.split('-')[0]}-{digest}").write_bytes(other.read_bytes())
    np.testing.assert_array_equal(values(machine_code(pendulum())), expected)


def test_folder_is_private_even_where_all_is_open(cache):
    before = os.umask(0)
    try:
        machine_code(pendulum())
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_folder_that_others_can_write_into_is_not_used(mode, cache, caplog):
    cache.mkdir()
    cache.chmod(mode)
    function = pendulum()
    assert machine_code(function) is function
    assert f"others can write into {cache}: chmod go-w it" in caplog.text
    assert list(cache.iterdir()) == []


def test_compiler_that_never_ends_is_given_up(cache, tmp_path, monkeypatch, caplog):
    fake_compiler(tmp_path, '[ "$1" = --version ] && exit\nexec sleep 60\n', monkeypatch)
    monkeypatch.setattr(module, "PATIENCE", 0.3)
    function = pendulum()
    assert machine_code(function) is function
    assert "mycc did not end within 0 s; using CasADi's virtual machine" in caplog.text
    assert list(cache.iterdir()) == []


# Many cases at once


def weighed():
    """A Function of a vector, a matrix and something shared, with a root and a loop over columns."""
    a, B, shared = ca.MX.sym("a", 2), ca.MX.sym("B", 2, 3), ca.MX.sym("s", 4)
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 2)
    root = ca.Function("root", [x, y], [ca.sqrt(x[0] ** 2 + y[1] ** 2) * x[1] + y[0]])
    each = root.map(3)(ca.repmat(a, 1, 3), B)
    return ca.Function("weighed", [a, B, shared], [each @ shared[1:], B * shared[0]])


def cases(count):
    rng = np.random.default_rng(count)
    return rng.normal(size=(count, 2)), rng.normal(size=(count, 3, 2)), rng.normal(size=4)


@pytest.mark.parametrize("count", [1, 2, 57])
@pytest.mark.parametrize("scalars", [False, True])
def test_many_cases_at_once_are_the_function_of_each(count, scalars):
    function, given = weighed(), cases(count)
    together = Cases(function, scalars=scalars)(*given)
    for k in range(count):
        apart = function(given[0][k], given[1][k].T, given[2])
        assert together[0][k] == float(apart[0])
        np.testing.assert_array_equal(together[1][k], apart[1].full().T)


def test_nobody_who_did_not_ask_for_a_compiler_is_told_that_there_is_none(monkeypatch, caplog):
    monkeypatch.setattr(module, "find_compiler", lambda: None)
    assert cases_driver(weighed()) is None
    assert caplog.messages == []


def test_what_does_not_fit_is_refused_before_it_is_read():
    run, (a, B, shared) = Cases(weighed(), scalars=False), cases(5)
    with pytest.raises(RuntimeError, match="Needed 240 bytes, got 192"):
        run(a, B[:4], shared)
    with pytest.raises(NotImplementedError):  # not contiguous
        run(a, B.swapaxes(1, 2), shared)
    with pytest.raises(RuntimeError, match="Needed 160 bytes, got 120"):
        run(a, B, shared[:3])


def test_cases_are_broadcast_against_each_other():
    function = pendulum()
    x, u = np.random.default_rng(1).normal(size=(4, 1, 3)), np.array([0.0, 1.0, -2.0])
    (together,) = of_each(function, x, u)
    assert together.shape == (4, 3, 3)
    for i in range(4):
        for j in range(3):
            np.testing.assert_array_equal(together[i, j], function(x[i, 0], u[j]).full()[:, 0])
    assert of_each(function, x[:0], u[:1])[0].shape == (0, 1, 3)


@pytest.mark.parametrize("shape", [(), (1,), (16,), (17,), (3, 40)])
def test_elements_are_evaluated_whatever_their_number(shape):
    both = Elementwise(lambda a, b: (ca.hypot(a, b), ca.if_else(a > 0, a, b)))
    a, b = np.random.default_rng(2).normal(size=shape), 0.5
    found = both(a, b)
    np.testing.assert_allclose(found[0], np.hypot(a, b), rtol=1e-15)
    np.testing.assert_array_equal(found[1], np.where(a > 0, a, b))
