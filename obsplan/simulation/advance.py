"""A mission's memory, and some time steps in one call on it."""

import threading
from collections.abc import Iterable, Mapping
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
    field of the carry that is held has the present sample only. Covariances are the larger half and
    have a block of their own, which a run does not keep.
    """

    def __init__(
        self, scenario: Scenario, first: Carry, inputs: Inputs, *, covariances: bool
    ) -> None:
        steps = len(inputs.time)
        self.held = HELD if covariances else (*HELD, "covariance")
        self.recorded, states = [], {}
        for names in blocks(Carry._fields, self.held):
            block, views = room(steps + 1, {name: getattr(first, name).shape for name in names})
            self.recorded.append(block)
            states |= views
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
        rows = packed.size1_in(0)
        self._before, self._after = np.empty(rows), np.empty((count, rows))
        carried = packed.n_out() - 1  # logs are the last
        buffer, self._run = in_sequence(packed, count, carried).buffer()
        # CasADi's own signatures are wrong
        buffer.set_arg(0, self._before.data)  # pyright: ignore[reportCallIssue]
        buffer.set_res(0, self._after.data)  # pyright: ignore[reportCallIssue]
        self._buffer, self._count = buffer, count
        of_held = {name: sizes[name] for name in self._held}
        self._parts = fields(self._before[None], of_held)
        self._found = fields(self._after[-1:], of_held)

    def __call__(self, memory: Memory, k: int) -> None:
        """Take the steps from step k on."""
        end = k + self._count
        before = [block[k] for block in memory.recorded]
        after = [block[k + 1 : end + 1] for block in memory.recorded]
        for i, rows in enumerate([*before, memory.given[k:end]], start=1):
            self._buffer.set_arg(i, rows.data)  # pyright: ignore[reportCallIssue]
        for i, rows in enumerate([*after, memory.logged[k:end]], start=1):
            self._buffer.set_res(i, rows.data)  # pyright: ignore[reportCallIssue]
        # of hypotheses a step may have less room than the carry
        for name, part in self._parts.items():
            part[...] = getattr(memory.carry, name)[..., : part.shape[-1]]
        self._run()
        for name, part in self._found.items():
            getattr(memory.carry, name)[..., : part.shape[-1]] = part


def packed_step(step: ca.Function, held: tuple[str, ...]) -> tuple[ca.Function, Sizes]:
    """The step of columns, and its fields' axes.

    It is of (held, recorded blocks, inputs), and gives all but the last anew and what is logged.
    """
    names = step.name_in()
    kept = [name for name in names if name in held]
    carried = [kept, *blocks(names, held)]
    given = [name for name in names if name in Inputs._fields]
    logged = [name for name in step.name_out() if name in Log._fields]
    sizes = {name: step.size_in(name)[::-1] for name in names}
    columns, arguments = [], {}
    for parts in (*carried, given):
        column = matrix("column", sum(prod(sizes[name]) for name in parts))
        ends = np.cumsum([0, *(prod(sizes[name]) for name in parts)]).tolist()
        for name, part in zip(parts, ca.vertsplit(column, ends), strict=True):
            arguments[name] = ca.reshape(part, *sizes[name][::-1])
        columns.append(column)
    found: dict[str, Any] = step(**arguments)
    after = [[f"next_{name}" for name in parts] for parts in carried]
    results = [ca.vertcat(*(ca.vec(found[name]) for name in parts)) for parts in (*after, logged)]
    return ca.Function("packed", columns, results), sizes


def blocks(names: Iterable[str], held: Iterable[str]) -> list[list[str]]:
    """Which fields of a carry, of those not held, are in one block: covariances are alone."""
    recorded = [name for name in names if name in Carry._fields and name not in held]
    apart = [name for name in recorded if name == "covariance"]
    together = [name for name in recorded if name not in apart]
    return [together, apart] if apart else [together]


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
