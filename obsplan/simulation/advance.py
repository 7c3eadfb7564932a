"""Some time steps in one call, on memory that is kept from call to call, and a mission's memory."""

import threading

import casadi as ca
import numpy as np

from formulations.model.casadi import Call, in_sequence, matrix
from formulations.model.covariance import unpack_array
from obsplan.simulation.step import Carry, Inputs, Log


class Advance(threading.local):
    """The step a number of times; each thread has memory of its own."""

    def __init__(self, step: ca.Function, count: int) -> None:
        names = step.name_in()
        self._carried = [name for name in names if name in Carry._fields]
        self._inputs = [name for name in names if name in Inputs._fields]
        self._logged = [name for name in step.name_out() if name in Log._fields]
        carried = len(self._carried)
        steps = in_sequence(step, count, carried)
        sizes = [steps.numel_in(i) for i in range(steps.n_in())]
        given = matrix("given", sum(sizes))
        parts = ca.vertsplit(given, np.cumsum([0, *sizes]).tolist())
        arguments = [ca.reshape(a, *steps.size_in(i)) for i, a in enumerate(parts)]
        found = ca.vertcat(*(ca.vec(result) for result in steps.call(arguments)))
        self._call = Call(ca.Function("advance", [given], [found]))
        self._count = count
        before = [(1, *step.size_in(i)[::-1]) for i in range(carried)]
        each = [(count, *step.size_in(i)[::-1]) for i in range(carried, step.n_in())]
        after = [(count, *step.size_out(i)[::-1]) for i in range(step.n_out())]
        self._given = _parts(self._call.given, before + each)
        self._found = _parts(self._call.found, after)

    def __call__(self, carry: Carry, inputs: Inputs, log: Log, k: int) -> None:
        """Take the steps from step k on.

        An array of the carry that has one sample only holds the present one.
        """
        now, after = slice(k, k + self._count), slice(k + 1, k + 1 + self._count)
        states = [getattr(carry, name) for name in self._carried]
        given = [values[k if len(values) > 1 else 0] for values in states]
        given += [getattr(inputs, name)[now] for name in self._inputs]
        found = [values[after] if len(values) > 1 else values for values in states]
        found += [getattr(log, name)[now] for name in self._logged]
        # of hypotheses a step may have less room than the carry
        for memory, values in zip(self._given, given, strict=True):
            memory[...] = values[..., : memory.shape[-1]]
        self._call()
        for memory, values in zip(self._found, found, strict=True):
            values[..., : memory.shape[-1]] = memory[-len(values) :]


def _parts(column: np.ndarray, shapes: list[tuple[int, ...]]) -> list[np.ndarray]:
    """Views of a column's parts, each of a shape."""
    ends = np.cumsum([np.prod(shape) for shape in shapes])
    parts = np.split(column, ends[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def carried(first: Carry, steps: int, held: tuple[str, ...]) -> Carry:
    """The carry at time 0, with room for those after each step, or the present one if held."""
    arrays = []
    for name, start in zip(Carry._fields, first, strict=True):
        samples = 1 if name in held else steps + 1
        array = room(samples, *start.shape)
        array[0] = start
        arrays.append(array)
    return Carry(*arrays)


def room(samples: int, columns: int, rows: int) -> np.ndarray:
    """An empty array (samples, columns, rows), in memory with the columns first, as runs are."""
    return np.empty((columns, samples, rows)).swapaxes(0, 1)


def recorded_covariance(carry: Carry) -> np.ndarray:
    """Covariances as a run has them, nan where only the present ones were held."""
    whole = unpack_array(carry.covariance.swapaxes(0, 1))
    samples, auvs, m = carry.mean.shape
    if whole.shape[1] < samples:
        return np.broadcast_to(np.nan, (auvs, samples, m, m))
    return whole
