"""The one door to CasADi: symbols, evaluation on the memory of arrays, and machine code.

Arrays hold what CasADi stores by columns: a column is an axis (..., row), a matrix two axes (...,
column, row), cases come before them. Machine code does the same arithmetic as CasADi's virtual
machine, to the last bit, several times faster.
"""

import ctypes
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache
from inspect import signature
from typing import Any

import casadi as ca
import numpy as np

from .compiler import compiled_library

LEAST_CASES = 16  # that an elementwise Function is built for

SX = Any  # CasADi's own signatures do not say what its operators take and give


def symbol(name: str, rows: int = 1, columns: int = 1) -> SX:
    """A matrix of symbols, each a number of its own."""
    return ca.SX.sym(name, rows, columns)  # pyright: ignore[reportArgumentType, reportCallIssue]


def matrix(name: str, rows: int = 1, columns: int = 1) -> Any:
    """A symbol that is a matrix as a whole: an operation is one pass over all its entries."""
    return ca.MX.sym(name, rows, columns)  # pyright: ignore[reportArgumentType, reportCallIssue]


def evaluate(
    function: ca.Function,
    arguments: Sequence[np.ndarray],
    results: Sequence[np.ndarray | None],
) -> None:
    """Evaluate a Function on the memory of contiguous arrays of floats.

    Results that are None are not wanted.

    The buffer belongs to this call alone, so that threads may share a Function.
    """
    buffer, run = function.buffer()
    given = [a.data for a in arguments]  # kept alive until the call is done
    wanted = [None if a is None else a.data for a in results]
    # CasADi's own signatures are wrong
    for i, view in enumerate(given):
        buffer.set_arg(i, view)  # pyright: ignore[reportCallIssue]
    for i, view in enumerate(wanted):
        if view is not None:
            buffer.set_res(i, view)  # pyright: ignore[reportCallIssue]
    run()


class Call(threading.local):
    """A Function of one column that gives one, with memory for both that is kept from call to call.

    Each thread has its own memory: ``given``, which the caller fills, and ``found``, which a call
    returns and the next one overwrites.
    """

    def __init__(self, function: ca.Function) -> None:
        self.given = np.zeros(function.size1_in(0))
        self.function = function
        self.found = np.empty(function.size1_out(0))
        buffer, self._run = function.buffer()
        buffer.set_arg(0, self.given.data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(0, self.found.data)  # pyright: ignore[reportCallIssue]
        self._buffer = buffer

    def __call__(self) -> np.ndarray:
        """Evaluate what is in ``given``."""
        self._run()
        return self.found


@lru_cache(maxsize=256)
def mapped(function: ca.Function, count: int) -> ca.Function:
    """The Function over ``count`` cases side by side.

    It is kept, because building it takes longer than calling it.
    """
    return function if count == 1 else function.map(count)


@lru_cache(maxsize=64)
def in_sequence(function: ca.Function, count: int, carried: int) -> ca.Function:
    """The Function ``count`` times, the first ``carried`` results being the next arguments."""
    return function.mapaccum("in_sequence", count, carried)


def of_each(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """Evaluate a Function for all cases at once.

    Leading axes of the arguments are cases, and are broadcast. Results have them before their own
    axes.
    """
    cores = [_axes(*function.size_in(i)) for i in range(function.n_in())]
    leading = [
        np.shape(a)[: np.ndim(a) - len(core)] for a, core in zip(arguments, cores, strict=True)
    ]
    batch = np.broadcast_shapes(*leading)
    given = [
        np.ascontiguousarray(np.broadcast_to(a, batch + core), dtype=float)
        for a, core in zip(arguments, cores, strict=True)
    ]
    results = [np.empty(batch + _axes(*function.size_out(i))) for i in range(function.n_out())]
    count = int(np.prod(batch))
    if count:
        evaluate(mapped(function, count), given, results)
    return results


def _axes(rows: int, columns: int) -> tuple[int, ...]:
    """Axes of an array that holds a matrix."""
    if columns > 1:
        return (columns, rows)
    return (rows,) if rows > 1 else ()


class Elementwise:
    """An expression of numbers, evaluated on arrays that are broadcast against each other.

    Each operation runs over all elements before the next: no slower than numpy. Functions are built
    for powers of two of elements.
    """

    def __init__(self, expression: Callable[..., Sequence[Any]]) -> None:
        self.expression = expression
        self.inputs = len(signature(expression).parameters)

    def __call__(self, *arguments: np.ndarray | float) -> list[np.ndarray]:
        """Values of the expressions, of the arguments' common shape."""
        shape = np.broadcast_shapes(*(np.shape(a) for a in arguments))
        count = int(np.prod(shape))
        size = max(LEAST_CASES, 1 << (count - 1).bit_length())
        given = np.zeros((self.inputs, size))
        for row, argument in zip(given, arguments, strict=True):
            row[:count].reshape(shape)[...] = argument
        function = self._function(size)
        results = np.empty((function.size2_out(0), size))
        evaluate(function, [given], [results])
        return [row[:count].reshape(shape) for row in results]

    @lru_cache(maxsize=64)  # noqa: B019 - instances are made once, with the module
    def _function(self, size: int) -> ca.Function:
        # MX: an operation is one pass over all elements, two to four times as fast as scalar by
        # scalar
        rows = [matrix(f"a{i}", 1, size) for i in range(self.inputs)]
        values = ca.Function("rows", rows, [ca.densify(v) for v in self.expression(*rows)])
        given = matrix("given", size, self.inputs)
        found = values.call([column.T for column in ca.horzsplit(given)], True, False)  # inlined
        return ca.Function("elementwise", [given], [ca.cse(ca.horzcat(*(v.T for v in found)))])


DRIVER = """
int {name}_cases(casadi_int count, const casadi_int* steps, const casadi_real** arg,
                 casadi_real** res, casadi_int* iw, casadi_real* w) {{
  const casadi_real* a[{sz_arg}];
  casadi_real* r[{sz_res}];
  for (casadi_int k = 0; k < count; ++k) {{
    for (int i = 0; i < {n_in}; ++i) a[i] = arg[i] + k * steps[i];
    for (int i = 0; i < {n_out}; ++i) r[i] = res[i] + k * steps[{n_in} + i];
    if ({name}(a, r, iw, w, 0)) return 1;
  }}
  return 0;
}}
"""


class Cases:
    """A Function run by the virtual machine for many cases at once, its last argument shared.

    ``scalars``: on scalars, which is faster while it is small.
    """

    def __init__(self, function: ca.Function, *, scalars: bool) -> None:
        self.function = function.expand() if scalars else function
        self._results = [_axes(*function.size_out(i)) for i in range(function.n_out())]

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Results of contiguous arrays of floats, cases first, and of the one that is shared."""
        *own, shared = arguments
        count = len(own[0])
        results = [np.empty((count, *axes)) for axes in self._results]
        repeated = np.ascontiguousarray(np.broadcast_to(shared, (count, *shared.shape)))
        evaluate(mapped(self.function, count), [*own, repeated], results)
        return results


def cases_driver(function: ca.Function, *, build: bool = True) -> Any:
    """What runs a Function's machine code for one case after the other; None without a compiler.

    None, too, if it would have to be built and need not be now.

    It takes the number of cases; how many numbers each argument's next case is further on, then
    each result's; pointers to those of the first case; and memory to work in, integers and reals.
    """
    driver = DRIVER.format(
        name=function.name(),
        sz_arg=function.sz_arg(),
        sz_res=function.sz_res(),
        n_in=function.n_in(),
        n_out=function.n_out(),
    )
    library = compiled_library(generate(function) + driver, asked_for=False, build=build)
    if library is None:
        return None
    run = ctypes.CDLL(str(library))[f"{function.name()}_cases"]
    run.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 5]
    return run


def address(array: np.ndarray) -> int:
    """Where the memory of an array is; three times as fast as numpy's own ``ctypes`` attribute."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array.data))


def machine_code(function: ca.Function) -> ca.Function:
    """Compile a Function, or give it back as it is, with a message, where that is not possible."""
    library = compiled_library(generate(function), asked_for=True)
    return function if library is None else ca.external(function.name(), str(library))


def generate(function: ca.Function) -> str:
    """C source of a Function."""
    generator = ca.CodeGenerator(function.name())
    generator.add(function)
    return generator.dump()
