"""From a task to the shape and the parameters of its program."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.covariance import pack_array
from .expressions import Shape, stage_blocks, task_blocks
from .program import Controls
from .rollout import Path, follow, gramians, scores
from .task import Task

AT_REST = 0.02  # of the aid vehicle's way: AUVs that move less over the horizon are taken to be at rest by the program
MOST_AUVS = 8  # that a program keeps states for: those that count most; an answer good for few of many is refused in the end
MOST_NEIGHBOURS = 16  # that a program keeps a distance from: those nearest to a limit
FLOOR = 1e-4  # of the starting determinant; below it the logarithm is continued
SHARP = 1e-3  # of the mean variance: ranges that err less are taken to err that much by the program, which would not converge otherwise
SLACK_WEIGHT = 100.0  # per length and time in units of the task; of scores of the order of 1
STAND_OFF = (
    0.05  # of a keep-out polygon's inner radius, by which its rounded boundary may be away from it
)


class Setting(NamedTuple):
    """A program's shape, and what it is fed."""

    shape: Shape
    parameters: Float[np.ndarray, " n"]
    unit: float  # of the score, in the program's objective


def setting(task: Task, heard: Task, start: Controls, objective: str, side: float) -> Setting:
    """What the program of a task in body frame is fed; ``heard`` is the task of the AUVs that have a weight.

    ``side``: 1 if the sequence can turn to the left for ever after its end, -1 if to the right.
    """
    path = follow(heard, start.turn_rates[None], start.speeds[None])
    heard, moving = _counted(heard, path, objective)
    near = (
        _neighbours(task, path)
        if task.least > 0 or np.isfinite(task.greatest)
        else np.empty(0, dtype=int)
    )
    shape = Shape(
        objective=objective,
        stages=len(task.durations),
        auvs=len(heard.weights),
        moving=moving,
        squared=task.ranging.squared if objective == "covariance" else False,
        neighbours=len(near),
        least=bool(task.least > 0) and len(near) > 0,
        greatest=bool(np.isfinite(task.greatest)) and len(near) > 0,
        discs=len(task.areas.discs),
        keep_outs=tuple(len(lines) for lines in task.areas.keep_outs),
        fence=len(task.areas.fence),
        slew=task.reach is not None,
        free_speed=task.speed[0] < task.speed[1],
    )
    unit = 1.0
    if objective == "covariance":
        unit = max(
            float(scores(heard, path, objective)[0] @ heard.weights),
            np.finfo(float).eps * task.ranging.sigma**2,
        )
    whole = _flat(_of_task(task, heard, path, shape, side=side, unit=unit), task_blocks(shape), 1)
    stages = _flat(_of_stages(task, heard, shape, near), stage_blocks(shape), shape.stages)
    return Setting(shape, np.concatenate([whole.ravel(), stages.ravel()]), unit)


def _flat(
    blocks: dict[str, np.ndarray], sizes: dict[str, tuple[int, int]], stages: int
) -> Float[np.ndarray, "{stages} n"]:
    """Blocks one after the other, each by columns; what a shape does not have is left out."""
    return np.concatenate(
        [
            np.reshape(blocks[key], (stages, -1))
            for key, (rows, cols) in sizes.items()
            if rows * cols
        ],
        axis=1,
    )


def chosen(task: Task, which: np.ndarray) -> Task:
    """The task of some of its AUVs."""
    return task._replace(
        positions=task.positions[:, which],
        headings=task.headings[:, which],
        speeds=task.speeds[:, which],
        covariance=task.covariance[which],
        process_noise=task.process_noise[which],
        spread=task.spread[which],
        weights=task.weights[which],
    )


def _counted(heard: Task, path: Path, objective: str) -> tuple[Task, bool]:
    """The AUVs that the program counts, and whether they move."""
    way = np.linalg.norm(heard.positions - heard.positions[:1], axis=-1).max()
    moving = bool(way > AT_REST * heard.durations.sum())
    if len(heard.weights) <= MOST_AUVS or (objective != "covariance" and not moving):
        return heard, moving
    score = scores(heard, path, objective)[0]
    score = score if objective == "covariance" else score - score.min() + 1.0
    return chosen(
        heard, np.sort(np.argsort(-heard.weights * score, kind="stable")[:MOST_AUVS])
    ), moving


def _neighbours(task: Task, path: Path) -> np.ndarray:
    distance = np.linalg.norm(path.poses[0, :, None, :2] - task.positions, axis=-1)
    room = np.minimum(
        distance - task.least if task.least > 0 else np.inf, task.greatest - distance
    ).min(axis=0)
    return np.sort(np.argsort(room, kind="stable")[:MOST_NEIGHBOURS])


def _of_task(
    task: Task, heard: Task, path: Path, shape: Shape, *, side: float, unit: float
) -> dict[str, np.ndarray]:
    """Blocks of the task, each by columns."""
    blocks = {"start": np.zeros(shape.accumulated)}
    if shape.objective == "covariance":
        blocks["start"] = pack_array(heard.covariance).ravel() / unit
        floor = np.empty((0, 2))
    else:
        W = gramians(heard, path)[0]
        floor = FLOOR * np.stack(
            [np.maximum(np.linalg.det(W), np.finfo(float).eps), W[:, 0, 0] + W[:, 1, 1]], axis=-1
        )
    edges = [*task.areas.keep_outs, task.areas.fence]
    return {
        **blocks,
        "weight": heard.weights / heard.weights.sum(),
        "last_rate": np.array(task.turn_rate),
        "radius": np.array(task.min_turn_radius),
        "slack_weight": np.array(SLACK_WEIGHT),
        "noise": heard.process_noise / np.sqrt(unit),
        "sigma": np.sqrt(max(task.ranging.sigma**2, SHARP * unit * _square_range(heard, path))),
        "unit": np.array(unit),
        "at_rest": heard.positions[len(heard.positions) // 2],
        "time": np.array(task.durations.sum()),
        "floor": floor,
        "disc": task.areas.discs,
        "line": np.concatenate(edges),
        "sharpness": np.array([_sharpness(lines) for lines in task.areas.keep_outs]),
        "side": np.array(side),
        "least": np.array(task.least),
        "greatest": np.array(task.greatest),
    }


def _square_range(task: Task, path: Path) -> float:
    """What a variance of distance is times in one of what is measured: 4 d² of a squared range, d the root mean square over the way."""
    if not task.ranging.squared:
        return 1.0
    return 4 * float(np.mean(np.sum((path.poses[0, :, None, :2] - task.positions) ** 2, axis=-1)))


def _sharpness(lines: Float[np.ndarray, "J 3"]) -> float:
    """Of the log-sum-exp, such that the rounded boundary stands off by no more than a part of the inner radius."""
    x, y, _ = np.linalg.lstsq(
        np.column_stack([lines[:, :2], np.ones(len(lines))]), lines[:, 2], rcond=None
    )[0]  # about as far from all
    inner = np.abs(lines[:, :2] @ [x, y] - lines[:, 2]).min()
    return float(np.log(len(lines)) / (STAND_OFF * inner))


def _of_stages(task: Task, heard: Task, shape: Shape, near: np.ndarray) -> dict[str, np.ndarray]:
    """Blocks of all stages, the stages first, each block by columns."""
    start, middle, end = slice(0, -1, 2), slice(1, None, 2), slice(2, None, 2)
    ends = [end] if shape.objective == "covariance" else [start, middle, end]
    looks = _looks(task)
    f = (looks / task.durations)[:, None, None]
    p0, p1, p2 = (task.positions[at][:, near] for at in (start, middle, end))
    looked = p0 * (1 - f) * (1 - 2 * f) + p1 * 4 * f * (1 - f) + p2 * f * (2 * f - 1)
    return {
        "duration": task.durations,
        "reach": np.zeros(shape.stages) if task.reach is None else task.reach,
        "look": looks,
        "margin": _margins(task, near),
        "pings": task.pings,
        "course": np.stack([np.cos(heard.headings), np.sin(heard.headings), heard.speeds], axis=-1),
        "there": np.concatenate([heard.positions[at] for at in ends], axis=1),
        "neighbour": np.concatenate([looked, p2], axis=1),
    }


def _looks(task: Task) -> Float[np.ndarray, " N"]:
    """When limits are looked at: in the middle of what the stage was when it was whole, so that a trajectory that was right stays so."""
    before_end = 0.5 * task.durations.max()
    return np.where(task.durations > before_end, task.durations - before_end, task.durations)


def _margins(task: Task, near: np.ndarray) -> Float[np.ndarray, "N 3"]:
    """How far a path may come nearer between two points: the sagitta of its chord, bent against the boundary as both can be.

    Separations are given room for straying AUVs besides.
    """
    h = 0.5 * task.durations.max()
    bulge = np.full_like(task.durations, h**2 / 8 / task.min_turn_radius)
    area = bulge + (h**2 / 8 / task.areas.discs[:, 2].min() if len(task.areas.discs) else 0.0)
    way = np.linalg.norm(np.diff(task.positions[::2, near], axis=0), axis=-1).max(
        axis=1, initial=0.0
    )
    apart = h * (1 + way / task.durations)
    spread = bulge + task.spread[near].max(initial=0.0)
    return np.stack(
        [area, spread + (apart**2 / 8 / task.least if task.least > 0 else 0.0), spread], axis=-1
    )
