"""One Function applied step after step over arrays: covariances along a mission, say."""

import ctypes

import casadi as ca
import numpy as np

from .casadi import cases_driver, evaluate, in_sequence

# Steps that take as long in the virtual machine as compiling, a quarter of a second.
BREAK_EVEN = 100_000


class Recursion:
    """A Function (x, inputs) -> x, each step's from the last one's.

    Where there is a compiler it runs as machine code, which serves any number of steps and gives
    the same bits as CasADi's virtual machine. That is compiled once for ever, but not before
    `BREAK_EVEN` steps were asked for: until then a short mission is done sooner without.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._run = cases_driver(function, build=False)
        self._sizes = [function.nnz_in(i) for i in range(function.n_in())]
        self._left = BREAK_EVEN  # steps without machine code
        self._strides = ctypes.c_longlong * (function.n_in() + 1)
        self._given = ctypes.c_void_p * function.n_in()
        self._reals, self._integers = function.sz_w(), function.sz_iw()

    def __call__(self, x: np.ndarray, *inputs: np.ndarray) -> None:
        """Fill x[1:] from x[0] and each step's inputs; x is contiguous, of floats, steps first.

        Inputs have the steps first, too. They may be views that run backwards, or that repeat one
        matrix; each step's numbers are laid side by side unless they are already.
        """
        steps = len(x) - 1
        self._check(x, inputs)
        if steps == 0:
            return
        if self._run is None and self._left >= 0:
            self._left -= steps
            self._run = cases_driver(self.function) if self._left < 0 else None
        if self._run is None:
            given = [np.ascontiguousarray(a, dtype=float) for a in (x[0], *inputs)]
            evaluate(in_sequence(self.function, steps, 1), given, [x[1:]])
            return
        inputs = tuple(_each_side_by_side(a) for a in inputs)
        strides = [a.strides[0] // a.itemsize for a in (x, *inputs, x)]
        given = [a.ctypes.data for a in (x, *inputs)]
        found = (ctypes.c_void_p * 1)(x[1:].ctypes.data)
        work = np.empty(self._reals + self._integers)
        integers = work[self._reals :].ctypes.data
        self._run(
            steps,
            self._strides(*strides),
            self._given(*given),
            found,
            integers,
            work.ctypes.data,
        )

    def _check(self, x: np.ndarray, inputs: tuple[np.ndarray, ...]) -> None:
        """Refuse what would be read or written beyond its end, or in another order."""
        steps = len(x) - 1
        state, *sizes = self._sizes
        fits = x.size == (steps + 1) * state
        if not (fits and x.flags.c_contiguous and x.flags.writeable and x.dtype == float):
            raise ValueError(
                f"x must be {state} floats for each of {steps + 1} samples, side by "
                f"side, got {x.dtype} of {x.shape}"
            )
        for i, (a, size) in enumerate(zip(inputs, sizes, strict=True), start=1):
            if len(a) != steps or a.size != steps * size:
                raise ValueError(
                    f"input {i} must be {size} numbers for each of {steps} steps, "
                    f"got an array of {a.shape}"
                )


def _each_side_by_side(array: np.ndarray) -> np.ndarray:
    """The array, of floats, as it is if each step's numbers are side by side in memory."""
    array = np.asarray(array, dtype=float)
    return array if array[0].flags.c_contiguous else np.ascontiguousarray(array)
