"""From a task to the shape and the parameters of its program."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..metrics import EPS
from ..model.covariance import motions, pack_array
from ..model.ranging import Form
from .expressions import Shape, stage_blocks, task_blocks
from .program import Controls
from .rollout import Path, gramians, rollout, scores
from .share import counts
from .task import Task

# Of the aid vehicle's way: AUVs that move less over the horizon are at rest for the program.
AT_REST = 0.02
# AUVs that a program keeps states for: those that count most; an answer good for few of many is
# refused in the end.
MOST_AUVS = 8
MOST_NEIGHBOURS = 16  # that a program keeps a distance from: those nearest to a limit
FLOOR = 1e-4  # of the starting determinant; below it the logarithm is continued
# Of the mean variance: ranges that err less count as erring that much in the program, which would
# not converge otherwise.
SHARP = 1e-3
SLACK_WEIGHT = 100.0  # per length and time in units of the task; of scores of the order of 1
# Of a keep-out polygon's inner radius, by which its rounded boundary may be away from it.
STAND_OFF = 0.05


class Setting(NamedTuple):
    """A program's shape, and what it is fed."""

    shape: Shape
    parameters: Float[np.ndarray, " n"]
    unit: float  # of the score, in the program's objective


def setting(task: Task, heard: Task, start: Controls, objective: str, side: float) -> Setting:
    """What the program of a task in body frame is fed.

    ``heard`` is the task of the AUVs that have a weight. ``side`` is of the terminal safe set: 1 if
    the sequence can turn to the left for ever after its end, -1 if to the right.
    """
    path = rollout(heard, start.turn_rates[None], start.speeds[None])
    heard, moving = _counted(heard, path, objective)
    near = _neighbours(task, path)
    shape = _shape(task, heard, objective, moving=moving, neighbours=len(near))
    unit = 1.0
    if objective == "covariance":
        mean = float(scores(heard, path, objective)[0] @ heard.weights)
        unit = max(mean, EPS * task.ranging.sigma**2)
    whole = _flat(_of_task(task, heard, path, shape, side=side, unit=unit), task_blocks(shape), 1)
    stages = _flat(_of_stages(task, heard, shape, near), stage_blocks(shape), shape.stages)
    return Setting(shape, np.concatenate([whole.ravel(), stages.ravel()]), unit)


def _shape(task: Task, heard: Task, objective: str, *, moving: bool, neighbours: int) -> Shape:
    """What the program of a task depends on."""
    separated = neighbours > 0
    covariance = objective == "covariance"
    return Shape(
        objective=objective,
        stages=len(task.durations),
        auvs=len(heard.weights),
        moving=moving and not covariance,  # which looks at the ends of stages alone
        form=_form(task, objective),
        neighbours=neighbours,
        least=separated and bool(task.least > 0),
        greatest=separated and bool(np.isfinite(task.greatest)),
        discs=len(task.areas.discs),
        keep_outs=tuple(len(lines) for lines in task.areas.keep_outs),
        fence=len(task.areas.fence),
        slew=task.reach is not None,
        free_speed=task.speed[0] < task.speed[1],
        carried=bool(task.areas) and any(task.current),
    )


def _form(task: Task, objective: str) -> Form:
    """What the program has of the ranging's law; Gramians have what makes ranges count less."""
    form = task.ranging.form
    if objective == "covariance":
        return form
    return form._replace(squared=False) if counts(form) else Form()


def _flat(
    blocks: dict[str, np.ndarray], sizes: dict[str, tuple[int, int]], stages: int
) -> Float[np.ndarray, "{stages} n"]:
    """Blocks one after the other, each by columns; what a shape does not have is left out."""
    parts = []
    for key, (rows, cols) in sizes.items():
        if rows * cols:
            parts.append(np.reshape(blocks[key], (stages, -1)))
    return np.concatenate(parts, axis=1)


def chosen(task: Task, which: np.ndarray) -> Task:
    """The task of some of its AUVs."""
    return task._replace(
        pings=task.pings[:, which],
        positions=task.positions[:, which],
        headings=task.headings[:, which],
        heights=task.heights[:, which],
        speeds=task.speeds[:, which],
        covariance=task.covariance[which],
        process_noise=task.process_noise[which],
        spread=task.spread[which],
        weights=task.weights[which],
    )


def _counted(heard: Task, path: Path, objective: str) -> tuple[Task, bool]:
    """The AUVs that the program counts, and whether it keeps states of each."""
    way = np.linalg.norm(heard.positions - heard.positions[:1], axis=-1).max()
    moving = bool(way > AT_REST * heard.durations.sum()) or counts(heard.ranging.form)
    if len(heard.weights) <= MOST_AUVS or (objective != "covariance" and not moving):
        return heard, moving
    score = scores(heard, path, objective)[0]
    if objective != "covariance":
        score = score - score.min() + 1.0  # logarithms: only differences mean anything
    order = np.argsort(-heard.weights * score, kind="stable")
    return chosen(heard, np.sort(order[:MOST_AUVS])), moving


def _neighbours(task: Task, path: Path) -> np.ndarray:
    """The AUVs nearest to a limit on their separation, where there is one."""
    if task.least == 0 and np.isinf(task.greatest):
        return np.empty(0, dtype=int)
    distance = np.linalg.norm(path.poses[0, :, None, :2] - task.positions, axis=-1)
    clearance = task.greatest - distance
    if task.least > 0:
        clearance = np.minimum(distance - task.least, clearance)
    order = np.argsort(clearance.min(axis=0), kind="stable")
    return np.sort(order[:MOST_NEIGHBOURS])


def _of_task(
    task: Task, heard: Task, path: Path, shape: Shape, *, side: float, unit: float
) -> dict[str, np.ndarray]:
    """Blocks of the task, each by columns."""
    start = np.zeros(shape.accumulated)
    floor = np.empty((0, 2))
    if shape.objective == "covariance":
        start = pack_array(heard.covariance).ravel() / unit
    else:
        W = gramians(heard, path)[0]
        det = np.maximum(np.linalg.det(W), EPS)
        floor = FLOOR * np.stack([det, W[:, 0, 0] + W[:, 1, 1]], axis=-1)
    ranging = task.ranging
    if shape.objective == "covariance":
        sharp = SHARP * unit * _square_range(heard, path)
        ranging = ranging._replace(sigma=np.sqrt(max(ranging.sigma**2, sharp)))
    blocks = {
        "start": start,
        "weight": heard.weights / heard.weights.sum(),
        "last_rate": np.array(task.turn_rate),
        "radius": np.array(task.min_turn_radius),
        "slack_weight": np.array(SLACK_WEIGHT),
        "noise": heard.process_noise / np.sqrt(unit),
        "law": np.array(ranging.numbers),
        "unit": np.array(unit),
        "at_rest": heard.positions[len(heard.positions) // 2],
        "time": np.array(task.durations.sum()),
        "floor": floor,
    }
    edges = [*task.areas.keep_outs, task.areas.fence]
    of_limits = {
        "disc": task.areas.discs,
        "line": np.concatenate(edges),
        "sharpness": np.array([_sharpness(lines) for lines in task.areas.keep_outs]),
        "side": np.array(side),
        "loiter": np.array(_loiter(task)),
        "least": np.array(task.least),
        "greatest": np.array(task.greatest),
    }
    return blocks | of_limits


def _square_range(task: Task, path: Path) -> float:
    """The factor from the variance of a distance to that of what is measured.

    Of a squared range it is 4 d², d the root mean square over the way.
    """
    if not task.ranging.squared:
        return 1.0
    apart = path.poses[0, :, None, :2] - task.positions
    return 4 * float(np.mean(np.sum(apart**2, axis=-1)))


def _sharpness(lines: Float[np.ndarray, "J 3"]) -> float:
    """Of the log-sum-exp: the rounded boundary stands off by `STAND_OFF` of the inner radius."""
    normals, offsets = lines[:, :2], lines[:, 2]
    equations = np.column_stack([normals, np.ones(len(lines))])
    x, y, _ = np.linalg.lstsq(equations, offsets, rcond=None)[0]  # about as far from all
    inner = np.abs(normals @ [x, y] - offsets).min()
    return float(np.log(len(lines)) / (STAND_OFF * inner))


def _of_stages(task: Task, heard: Task, shape: Shape, near: np.ndarray) -> dict[str, np.ndarray]:
    """Blocks of all stages, the stages first, each block by columns."""
    looks = _looks(task)
    start, middle, end = _thirds(heard.positions)
    at_start, at_middle, at_end = _thirds(heard.heights)
    places, heights = [start, middle, end], [at_start, at_middle, at_end]
    if shape.objective == "covariance":
        places, heights = [end], [at_end]
    f = (looks / task.durations)[:, None, None]
    p0, p1, p2 = _thirds(task.positions[:, near])
    looked = p0 * (1 - f) * (1 - 2 * f) + p1 * 4 * f * (1 - f) + p2 * f * (2 * f - 1)  # parabola
    return {
        "duration": task.durations,
        "reach": np.zeros(shape.stages) if task.reach is None else task.reach,
        "look": looks,
        "margin": _margins(task, near),
        "pings": heard.pings,
        "motion": motions(heard.headings, heard.speeds),
        "there": np.concatenate(places, axis=1),
        "height": np.concatenate(heights, axis=1),
        "neighbour": np.concatenate([looked, p2], axis=1),
        "drift": _drift(task, looks),
    }


def _drift(task: Task, looks: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N 2 2"]:
    """How far the water has gone since now, by the look and the end of each stage."""
    ends = np.cumsum(task.durations)
    times = np.stack([ends - task.durations + looks, ends], axis=-1)
    return times[..., None] * np.array(task.current)


def _loiter(task: Task) -> float:
    """Radius that a loiter in a current does not leave: a turn's, and the water's way meanwhile."""
    radius = task.min_turn_radius
    return radius + np.hypot(*task.current) * 2 * np.pi * radius / task.speed[1]


def _thirds(
    values: Float[np.ndarray, "T M *rest"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values of the AUVs at the beginning, in the middle and at the end of each stage."""
    return values[:-1:2], values[1::2], values[2::2]


def _looks(task: Task) -> Float[np.ndarray, " N"]:
    """When limits are looked at: in the middle of what the stage was when it was whole.

    So a trajectory that was right stays so.
    """
    before_end = 0.5 * task.durations.max()
    return np.where(task.durations > before_end, task.durations - before_end, task.durations)


def _margins(task: Task, near: np.ndarray) -> Float[np.ndarray, "N 3"]:
    """How far a path may come nearer between two points: of areas, least and greatest separation.

    It is the sagitta of its chord, bent against the boundary as both can be. Separations have a
    margin for straying AUVs besides.
    """
    h = 0.5 * task.durations.max()
    bulge = np.full_like(task.durations, h**2 / 8 / task.min_turn_radius)
    area = bulge
    if len(task.areas.discs):
        way = h * (1 + np.hypot(*task.current))
        area = bulge + way**2 / 8 / task.areas.discs[:, 2].min()
    greatest = bulge + task.spread[near].max(initial=0.0)
    least = greatest
    if task.least > 0:
        way = np.linalg.norm(np.diff(task.positions[::2, near], axis=0), axis=-1)
        apart = h * (1 + way.max(axis=1, initial=0.0) / task.durations)
        least = greatest + apart**2 / 8 / task.least
    return np.stack([area, least, greatest], axis=-1)
