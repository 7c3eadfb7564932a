"""A mission's memory, and some time steps in one call on it."""

import threading
from collections.abc import Mapping
from math import prod
from typing import Any

import casadi as ca
import numpy as np

from formulations.model.casadi import in_sequence, matrix
from formulations.model.covariance import unpack_array
from obsplan.scenario import Scenario
from obsplan.simulation.step import HELD, Carry, Inputs, Log, shape_of

Sizes = Mapping[str, tuple[int, ...]]  # axes (column, row) of fields


class Memory:
    """What a flight reads and writes, with one row for each step.

    Fields are views, so that nothing is moved between what is computed and what is recorded. A
    field of the carry that is held has the present sample only.
    """

    def __init__(
        self, scenario: Scenario, first: Carry, inputs: Inputs, *, covariances: bool
    ) -> None:
        steps = len(inputs.time)
        self.held = HELD if covariances else (*HELD, "covariance")
        recorded = {n: a.shape for n, a in first._asdict().items() if n not in self.held}
        self.recorded, states = room(steps + 1, recorded)
        given = {name: values.shape[1:] for name, values in inputs._asdict().items()}
        self.given, told = room(steps, given)
        self.logged, logs = room(steps, {n: shape_of(n, scenario) for n in Log._fields})
        states |= {name: getattr(first, name)[None].copy() for name in self.held}
        for name, start in first._asdict().items():
            states[name][0] = start
        for name, values in inputs._asdict().items():
            told[name][...] = values
        self.carry, self.inputs, self.log = Carry(**states), Inputs(**told), Log(**logs)


class Advance(threading.local):
    """The step a number of times; each thread has memory of its own for what is held."""

    def __init__(self, step: ca.Function, count: int, held: tuple[str, ...]) -> None:
        packed, sizes = packed_step(step, held)
        self._held = [name for name in sizes if name in held]
        buffer, self._run = in_sequence(packed, count, 2).buffer()
        rows = packed.size1_in(1)
        self._before, self._after = np.empty(rows), np.empty((count, rows))
        # CasADi's own signatures are wrong
        buffer.set_arg(1, self._before.data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(1, self._after.data)  # pyright: ignore[reportCallIssue]
        self._buffer, self._count = buffer, count
        of_held = {name: sizes[name] for name in self._held}
        self._parts = fields(self._before[None], of_held)
        self._found = fields(self._after[-1:], of_held)

    def __call__(self, memory: Memory, k: int) -> None:
        """Take the steps from step k on."""
        end = k + self._count
        before, given = memory.recorded[k], memory.given[k:end]
        after, logged = memory.recorded[k + 1 : end + 1], memory.logged[k:end]
        for i, rows in ((0, before), (2, given)):
            self._buffer.set_arg(i, rows.data)  # pyright: ignore[reportCallIssue]
        for i, rows in ((0, after), (2, logged)):
            self._buffer.set_res(i, rows.data)  # pyright: ignore[reportCallIssue]
        # of hypotheses a step may have less room than the carry
        for name, part in self._parts.items():
            part[...] = getattr(memory.carry, name)[..., : part.shape[-1]]
        self._run()
        for name, part in self._found.items():
            getattr(memory.carry, name)[..., : part.shape[-1]] = part


def packed_step(step: ca.Function, held: tuple[str, ...]) -> tuple[ca.Function, Sizes]:
    """The step of columns, and its fields' axes.

    It is of (recorded, held, inputs), and gives the first two anew and what is logged.
    """
    names = step.name_in()
    recorded = [name for name in names if name in Carry._fields and name not in held]
    kept = [name for name in names if name in held]
    given = [name for name in names if name in Inputs._fields]
    logged = [name for name in step.name_out() if name in Log._fields]
    sizes = {name: step.size_in(name)[::-1] for name in names}
    columns, arguments = [], {}
    for parts in (recorded, kept, given):
        column = matrix("column", sum(prod(sizes[name]) for name in parts))
        ends = np.cumsum([0, *(prod(sizes[name]) for name in parts)]).tolist()
        for name, part in zip(parts, ca.vertsplit(column, ends), strict=True):
            arguments[name] = ca.reshape(part, *sizes[name][::-1])
        columns.append(column)
    found: dict[str, Any] = step(**arguments)
    after = [[f"next_{name}" for name in recorded], [f"next_{name}" for name in kept], logged]
    results = [ca.vertcat(*(ca.vec(found[name]) for name in parts)) for parts in after]
    return ca.Function("packed", columns, results), sizes


def room(samples: int, sizes: Sizes) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Memory for so many samples, and its fields."""
    rows = np.empty((samples, sum(prod(size) for size in sizes.values())))
    return rows, fields(rows, sizes)


def fields(rows: np.ndarray, sizes: Sizes) -> dict[str, np.ndarray]:
    """Views (samples, columns, rows) of the fields that are one after the other in each row."""
    ends = np.cumsum([prod(size) for size in sizes.values()])
    parts = np.split(rows, ends[:-1], axis=1)
    shaped = zip(sizes.items(), parts, strict=True)
    return {name: part.reshape(len(rows), *size) for (name, size), part in shaped}


def recorded_covariance(carry: Carry) -> np.ndarray:
    """Covariances as a run has them, nan where only the present ones were held."""
    whole = unpack_array(carry.covariance.swapaxes(0, 1))
    samples, auvs, m = carry.mean.shape
    if whole.shape[1] < samples:
        return np.broadcast_to(np.nan, (auvs, samples, m, m))
    return whole
