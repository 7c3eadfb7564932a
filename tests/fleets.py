"""Small fleets for bounds, and the covariance recursion of a path in plain numpy."""

import numpy as np
from scipy.optimize import minimize

from formulations.fleet import AidVehicle, RangedAuv

STEP = 5.0  # [s]


def small_fleet(rng, *, auvs=2, pings=6, every=2):
    """AUVs on random straight courses near an aid vehicle, with a range to it every ``every`` steps, in turn."""
    steps = pings * every
    time = STEP * np.arange(steps + 1)
    made = []
    for i in range(auvs):
        heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.5)
        velocity = speed * np.array([np.cos(heading), np.sin(heading)])
        track = rng.uniform(-40, 40, 2) + time[:, None] * velocity
        F = np.eye(4)
        F[:2, 2] = -velocity[1] * STEP, velocity[0] * STEP
        F[:2, 3] = velocity * STEP / speed
        J = np.zeros((steps, 4, 4))
        J[:, 2, 2] = 1 / 0.05**2
        at = np.arange(every - 1, steps, every)[i % 2 :: min(2, auvs)]
        P0 = np.diag(rng.uniform([0.5, 0.5, 0.02, 0.05], [8.0, 8.0, 0.1, 0.2]) ** 2)
        auv = RangedAuv(
            P0=P0,
            F=np.tile(F, (steps, 1, 1)),
            Q=np.diag([0.05, 0.05, 0.0, 0.002]),
            J_other=J,
            pings=at,
            places=track[at + 1],
            aids=np.zeros(len(at), dtype=int),
            weight=rng.uniform(0.5, 2.0),
        )
        made.append(auv)
    aid = AidVehicle(start=rng.uniform(-60, 60, 2), speed=rng.uniform(0.5, 3.0))
    return made, aid, time


def mean_squares(fleet, paths, sigma):
    """Weighted mean square error for aid vehicle's paths (paths, samples, 2), written out."""
    auvs, _, _ = fleet
    total = sum(auv.weight for auv in auvs)
    found = np.zeros(len(paths))
    for auv in auvs:
        P = np.tile(auv.P0, (len(paths), 1, 1))
        squares = [P[:, 0, 0] + P[:, 1, 1]]
        for k, F in enumerate(auv.F):
            P = F @ P @ F.T + auv.Q
            J = np.tile(auv.J_other[k], (len(paths), 1, 1))
            for j in np.flatnonzero(auv.pings == k):
                u = paths[:, k + 1] - auv.places[j]
                u = u / np.linalg.norm(u, axis=1, keepdims=True)
                J[:, :2, :2] += u[:, :, None] * u[:, None, :] / sigma**2
            P = np.linalg.solve(np.eye(4) + P @ J, P)
            squares.append(P[:, 0, 0] + P[:, 1, 1])
        found += auv.weight / total * np.mean(squares, axis=0)
    return found


def path_of(fleet, moves):
    """Paths whose every step is a move (paths, steps, 2) in units of the greatest, none longer."""
    _, aid, time = fleet
    length = np.linalg.norm(moves, axis=-1, keepdims=True)
    steps = moves / np.maximum(length, 1.0) * aid.speed * np.diff(time)[:, None]
    after = aid.start + np.cumsum(steps, axis=-2)
    start = np.broadcast_to(aid.start, (*after.shape[:-2], 1, 2))
    return np.concatenate([start, after], axis=-2)


def random_paths(fleet, rng, count):
    """Straight, winding and erratic paths at up to the greatest speed."""
    steps = len(fleet[2]) - 1
    wander = rng.choice([0.0, 0.3, 1.0, 3.0], size=(count, 1))
    heading = rng.uniform(0, 2 * np.pi, (count, 1)) + np.cumsum(
        wander * rng.normal(size=(count, steps)), axis=1
    )
    pace = rng.uniform(0.3, 1.2, (count, 1))
    moves = np.stack([np.cos(heading), np.sin(heading)], axis=-1) * pace[..., None]
    return path_of(fleet, moves)


def best_path(fleet, rng, sigma, *, starts=3):
    """Least mean square of paths optimised by a quasi-Newton method from the best of random ones."""
    steps = len(fleet[2]) - 1

    def value(flat):
        moves = flat.reshape(1, steps, 2)
        return mean_squares(fleet, path_of(fleet, moves), sigma)[0]

    def slope(flat):
        nearby = flat + 1e-5 * np.vstack([np.zeros(len(flat)), np.eye(len(flat))])
        values = mean_squares(fleet, path_of(fleet, nearby.reshape(-1, steps, 2)), sigma)
        return (values[1:] - values[0]) / 1e-5

    paths = random_paths(fleet, rng, 300)
    first = np.argsort(mean_squares(fleet, paths, sigma))[:starts]
    found = []
    for path in paths[first]:
        moves = np.diff(path, axis=0) / (fleet[1].speed * np.diff(fleet[2])[:, None])
        end = minimize(value, moves.ravel(), jac=slope, method="L-BFGS-B", options={"maxiter": 60})
        found.append(end.fun)
    return min(found)
