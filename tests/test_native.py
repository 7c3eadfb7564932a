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

from obsplan.simulation import native as module
from obsplan.simulation.native import find_compiler, native

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")
CODE = "#!/bin/sh\n"


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own for each test, and nothing remembered of compilers."""
    monkeypatch.setenv("OBSPLAN_CACHE", str(tmp_path / "cache"))
    find_compiler.cache_clear()
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
    compiled = native(interpreted)
    assert "External" in compiled.class_name()
    np.testing.assert_array_equal(values(compiled), values(interpreted))


def test_library_is_built_once_for_each_content(cache, monkeypatch):
    native(pendulum())
    (library,) = cache.iterdir()
    built = library.stat().st_mtime_ns
    native(pendulum())
    assert [path.stat().st_mtime_ns for path in cache.iterdir()] == [built]
    native(pendulum(damping=0.2))
    assert len(list(cache.iterdir())) == 2
    monkeypatch.setattr(module, "FLAGS", ("-O1", *module.FLAGS[1:]))
    native(pendulum())
    assert len(list(cache.iterdir())) == 3


def test_another_compiler_makes_another_library(cache, tmp_path, monkeypatch):
    native(pendulum())
    fake_compiler(
        tmp_path,
        f'[ "$1" = --version ] && echo "mycc 1" && exit\nexec {find_compiler()} "$@"\n',
        monkeypatch,
    )
    native(pendulum())
    assert len(list(cache.iterdir())) == 2


def test_many_at_once_build_whole_libraries(cache):
    code = f"import sys; sys.path[:0] = {sys.path!r}\nimport test_native as t\nt.native(t.pendulum())(1, 1)"
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
    assert native(function) is function
    assert list(cache.iterdir()) == []
    assert "mycc failed" in caplog.text


def test_without_a_compiler_the_function_itself_and_one_message(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    function = pendulum()
    assert native(function) is function
    assert native(function) is function
    assert caplog.messages == [
        "no C compiler found: using CasADi's virtual machine, with the same results, about three times slower"
    ]


def test_compiler_that_fails_is_quoted_and_the_function_itself_returned(
    cache, tmp_path, monkeypatch, caplog
):
    fake_compiler(tmp_path, "echo 'step.c:1: out of patience' >&2\nexit 1\n", monkeypatch)
    function = pendulum()
    assert native(function) is function
    assert caplog.messages == [
        f"no generated code: {tmp_path}/mycc failed (step.c:1: out of patience); using CasADi's virtual machine"
    ]
    assert list(cache.iterdir()) == []


def test_cache_that_cannot_be_written_is_a_message_and_the_function_itself(monkeypatch, caplog):
    monkeypatch.setenv("OBSPLAN_CACHE", "/proc/cache")  # where no one can make a folder
    function = pendulum()
    with caplog.at_level(logging.WARNING):
        assert native(function) is function
    assert "/proc/cache" in caplog.text
    assert "failed" not in caplog.text  # the compiler was not to blame
    assert "using CasADi's virtual machine" in caplog.text


def test_cache_folder_is_the_users_unless_named(tmp_path, monkeypatch):
    monkeypatch.delenv("OBSPLAN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    native(pendulum())
    assert len(list((tmp_path / "xdg/obsplan").glob("*.so"))) == 1
