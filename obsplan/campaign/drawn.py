"""Scenarios drawn at random: surveys, vehicles, ranging, limits and currents that nobody chose.

What is drawn, each value evenly between its ends, or evenly in its logarithm where "log" is said:

- aid vehicle: 0.5 to 2.5 m/s, turning radius 5 to 20 m, start 30 to 500 m (log) from the first AUV;
- one to six AUVs (35, 30, 15, 12, 8 % are 1, 2, 3, 4, 6), side by side or with surveys of their
  own; 0.1 to 1.4 times as fast as the aid vehicle; lawnmowers, waypoints, one in twelve moored;
- missions of 600 to 1000 s at steps of 1 s;
- ranges every 5 to 60 s (log), in slots in three of ten; errors of 0.3 to 3 m (log), in half of
  them growing by up to 2 % of the range; up to 30 % lost in half; slant over depths in half;
- first estimates off by 2 to 30 m (log), process noise of 0.02 to 0.1 m/sqrt(s) and 0.005 to
  0.02 m/s/sqrt(s), compasses of 0.5 to 2 degrees;
- in four of ten a current of up to half the slowest moving AUV's speed, known, half of the time
  carrying the aid vehicle, too;
- in four of ten limits: one or two keep-outs, a standoff of 10 to 40 m, or a fence 120 to 800 m
  wide; planners that keep a standoff know the surveys, too.
"""

from typing import Any

import numpy as np

from obsplan.scenario import from_dict
from obsplan.types import ObsplanError

ATTEMPTS = 50  # at a scenario that can be flown
TIME_STEP = 1.0  # [s]
AUVS, SHARES = (1, 2, 3, 4, 6), (0.35, 0.30, 0.15, 0.12, 0.08)


def drawn_scenario(seed: int) -> dict[str, Any]:
    """Draw a scenario that can be flown; the same seed draws the same.

    One whose survey, start or current cannot be flown is drawn again.

    Raises
    ------
    ObsplanError
        None of `ATTEMPTS` can be flown.
    """
    why = ""
    for attempt in range(ATTEMPTS):
        data = drawn(np.random.default_rng([seed, attempt]), f"drawn-{seed}")
        try:
            from_dict(data)
        except ObsplanError as error:
            why = str(error)
            continue
        return data
    raise ObsplanError(f"none of {ATTEMPTS} scenarios drawn by seed {seed} can be flown: {why}")


def drawn(rng: np.random.Generator, name: str) -> dict[str, Any]:
    """Draw a scenario, whether it can be flown or not."""
    speed = even(rng, 0.5, 2.5)
    radius = even(rng, 5.0, 20.0)
    duration = float(round(even(rng, 600.0, 1000.0)))
    auvs = drawn_auvs(rng, speed, duration)
    away, bearing = log_even(rng, 30.0, 500.0), rng.uniform(0.0, 2 * np.pi)
    start = {
        "x": round(away * np.cos(bearing), 1),
        "y": round(away * np.sin(bearing), 1),
        "heading_deg": even(rng, 0.0, 360.0),
    }
    ranging = drawn_ranging(rng, len(auvs))
    if ranging["geometry"] == "slant":
        for auv in auvs:
            auv["depth"] = even(rng, 5.0, 100.0)
    current, carried = drawn_current(rng, auvs)
    limits, knowledge = drawn_limits(rng, start, radius, nearest(start, auvs))
    return {
        "name": name,
        "seed": 1,
        "time_step": TIME_STEP,
        "duration": duration,
        "origin": {"lat": 47.629, "lon": -122.337},
        "cna": {
            "speed": speed,
            "min_turn_radius": radius,
            "start": start,
            "carried": carried,
        },
        "auv": auvs,
        "environment": {"current": current},
        "ranging": ranging,
        "constraints": limits,
        "planner": {"kind": "default", "interval": 2.0, "knowledge": knowledge},
    }


def even(rng: np.random.Generator, low: float, high: float) -> float:
    """A number evenly between two, to three decimals."""
    return round(float(rng.uniform(low, high)), 3)


def log_even(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is evenly between those of two, to three decimals."""
    return round(float(np.exp(rng.uniform(np.log(low), np.log(high)))), 3)


def drawn_auvs(rng: np.random.Generator, speed: float, duration: float) -> list[dict[str, Any]]:
    """Draw AUVs that move for the whole mission, beside the first or each by itself."""
    count = int(rng.choice(AUVS, p=SHARES))
    side_by_side = bool(rng.random() < 0.5)
    noise = {
        "position": even(rng, 0.02, 0.1),
        "heading_deg": 0.1,
        "speed": even(rng, 0.005, 0.02),
    }
    unsure = {
        "sigma_position": log_even(rng, 2.0, 30.0),
        "sigma_heading_deg": 2.0,
        "sigma_speed": even(rng, 0.05, 0.3),
    }
    auvs: list[dict[str, Any]] = []
    for i in range(count):
        own = round(even(rng, 0.1, 1.4) * speed, 3)
        place = [0.0, 0.0] if i == 0 else [even(rng, -300.0, 300.0) for _ in range(2)]
        survey = drawn_survey(rng, place, own * duration)
        if side_by_side and i > 0:
            own = auvs[0]["speed"]
            survey = {"kind": "formation", "leader": "auv-1", "east": 25.0 * i, "north": 0.0}
        if survey["kind"] == "static":
            own = 0.0
        auv = {"speed": own, "survey": survey, "first_estimate": unsure, "process_noise": noise}
        auvs.append(auv)
    return auvs


def drawn_survey(rng: np.random.Generator, place: list[float], way: float) -> dict[str, Any]:
    """Draw a survey from a place, that lasts for a way [m] or longer."""
    kind = rng.choice(["static", "lawnmower", "waypoints"], p=[1 / 12, 6 / 12, 5 / 12])
    if kind == "static":
        return {"kind": "static", "x": place[0], "y": place[1]}
    if kind == "lawnmower":
        length, spacing = even(rng, 0.1, 0.4) * way + 30.0, even(rng, 20.0, 60.0)
        return {
            "kind": "lawnmower",
            "legs": int(np.ceil(way / (length + spacing))) + 1,
            "length": round(length, 1),
            "spacing": spacing,
            "x": place[0],
            "y": place[1],
            "heading_deg": even(rng, 0.0, 360.0),
            "side": str(rng.choice(["left", "right"])),
        }
    bearing = rng.uniform(0.0, 2 * np.pi)
    points, leg = [place], way / 3 + 20.0
    for _ in range(4):
        step = leg * np.array([np.cos(bearing), np.sin(bearing)])
        points.append([round(float(x), 1) for x in points[-1] + step])
        bearing += rng.uniform(-2.0, 2.0)
    return {"kind": "waypoints", "points": points}


def drawn_ranging(rng: np.random.Generator, auvs: int) -> dict[str, Any]:
    """Draw how AUVs range to the aid vehicle."""
    interval = float(round(log_even(rng, 5.0, 60.0)))
    slot = float(interval // auvs) if rng.random() < 0.3 else 0.0
    return {
        "kind": "range",
        "interval": interval,
        "slot": slot,
        "sigma": log_even(rng, 0.3, 3.0),
        "growth": even(rng, 0.0, 0.02) if rng.random() < 0.5 else 0.0,
        "loss": even(rng, 0.0, 0.3) if rng.random() < 0.5 else 0.0,
        "geometry": "slant" if rng.random() < 0.5 else "horizontal",
        "heading_sigma_deg": even(rng, 0.5, 2.0),
    }


def drawn_current(rng: np.random.Generator, auvs: list[dict[str, Any]]) -> tuple[list[float], bool]:
    """Draw a current [m/s], and whether it carries the aid vehicle."""
    moving = [auv["speed"] for auv in auvs if auv["speed"] > 0]
    if rng.random() >= 0.4 or not moving:
        return [0.0, 0.0], False
    strength, bearing = even(rng, 0.0, 0.5) * min(moving), rng.uniform(0.0, 2 * np.pi)
    east, north = strength * np.cos(bearing), strength * np.sin(bearing)
    return [round(float(east), 3), round(float(north), 3)], bool(rng.random() < 0.5)


def nearest(start: dict[str, float], auvs: list[dict[str, Any]]) -> float:
    """How far the nearest AUV is from the aid vehicle's start [m]."""
    places = []
    for auv in auvs:
        survey = auv["survey"]
        first = survey.get("points", [[survey.get("x", 0.0), survey.get("y", 0.0)]])[0]
        follows = [survey.get("east", 0.0), survey.get("north", 0.0)]  # one that begins at zero
        places.append(np.add(first, follows))
    return float(np.min(np.hypot(*(np.array(places) - [start["x"], start["y"]]).T)))


def drawn_limits(
    rng: np.random.Generator, start: dict[str, float], radius: float, room: float
) -> tuple[dict[str, Any], str]:
    """Draw limits, none about the start, and what planners know of the AUVs to keep them."""
    kind = rng.choice(["none", "keep-out", "standoff", "fence"], p=[0.6, 0.2, 0.1, 0.1])
    if kind == "keep-out":
        discs = [drawn_keep_out(rng, start, radius) for _ in range(int(rng.integers(1, 3)))]
        return {"keep_out": discs}, "estimate"
    if kind == "standoff":
        standoff = min(even(rng, 10.0, 40.0), round(room / 2, 1))
        return {"min_separation": standoff}, "estimate-and-survey"
    if kind == "fence":
        return {"geofence": drawn_fence(rng, start)}, "estimate"
    return {}, "estimate"


def drawn_fence(rng: np.random.Generator, start: dict[str, float]) -> list[list[float]]:
    """Draw a rectangle about the start, 120 to 800 m wide and as long."""
    east, north = even(rng, 60.0, 400.0), even(rng, 60.0, 400.0)
    west_side, east_side = round(start["x"] - east, 1), round(start["x"] + east, 1)
    south_side, north_side = round(start["y"] - north, 1), round(start["y"] + north, 1)
    south = [[west_side, south_side], [east_side, south_side]]
    return [*south, [east_side, north_side], [west_side, north_side]]


def drawn_keep_out(
    rng: np.random.Generator, start: dict[str, float], radius: float
) -> dict[str, float]:
    """Draw a disc that leaves the aid vehicle room to turn at its start."""
    size, bearing = even(rng, 10.0, 40.0), rng.uniform(0.0, 2 * np.pi)
    away = size + 4 * radius + even(rng, 0.0, 200.0)
    return {
        "x": round(start["x"] + away * np.cos(bearing), 1),
        "y": round(start["y"] + away * np.sin(bearing), 1),
        "radius": size,
    }
