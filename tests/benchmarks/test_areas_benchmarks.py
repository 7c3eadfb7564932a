"""Signed distances from polygons beside shapely, and a decision among three polygons beside one without limits.

Times are recorded, never asserted; every result is checked once. Compare within one run only, without the shape checks of the tests:
``pytest -o addopts='' tests/benchmarks/test_areas_benchmarks.py --benchmark-group-by=group,param --benchmark-sort=fullname``.
"""

import numpy as np
import pytest
import shapely

import obsplan as op
from formulations.model.areas import outline_of, signed_distance
from obsplan.constraints import UNLIMITED, Constraints, Polygon

CNA = op.Unicycle(speed=2.0, min_turn_radius=8.0)


def coast(corners, seed, middle=(0.0, 0.0), radius=100.0):
    """A star-shaped line that wavers."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * np.arange(corners) / corners
    radii = radius * (0.85 + 0.15 * rng.uniform(-1.0, 1.0, corners))
    return np.array(middle) + np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def path(count):
    """Places some metres apart, along a line that winds."""
    way = np.linspace(0.0, 1.0, count)
    return np.column_stack([160 * way - 80, 60 * np.sin(9 * way)])


SIZES = [(8, 1024), (20, 1024), (20, 16), (1000, 1024)]
sized = pytest.mark.parametrize(("corners", "points"), SIZES)
distances = pytest.mark.benchmark(group="signed distances")


@pytest.fixture
def told(corners, points):
    """A polygon as shapely knows it, ready to be asked, and places to ask of."""
    shape = shapely.Polygon(coast(corners, 1))
    shapely.prepare(shape)
    return shape, path(points)


def by_shapely(shape, points):
    distance = shapely.distance(shape.exterior, shapely.points(points))
    return np.where(shapely.contains_xy(shape, points[:, 0], points[:, 1]), -distance, distance)


@distances
@sized
def test_signed_distance(benchmark, told, corners):
    shape, points = told
    found = benchmark(signed_distance, points, outline_of(coast(corners, 1)))
    np.testing.assert_allclose(found, by_shapely(shape, points), rtol=1e-12, atol=1e-12)


@distances
@sized
def test_signed_distance_by_shapely(benchmark, told):
    assert np.isfinite(benchmark(by_shapely, *told)).all()


AMONG = Constraints(
    keep_out=(
        Polygon(points=coast(8, 1, (60.0, 20.0), 25.0)),
        Polygon(points=coast(14, 2, (-50.0, 60.0), 30.0)),
    ),
    geofence=Polygon(points=coast(20, 3, radius=260.0)),
)
PLANNERS = {"information": op.InformationHorizon, "gramian": op.GramianHorizon}


@pytest.mark.parametrize("limits", [UNLIMITED, AMONG], ids=["no limits", "three polygons"])
@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.benchmark(group="decision among three polygons")
def test_decision(benchmark, name, limits):
    planner = PLANNERS[name](
        op.Situation(CNA, ping_interval=4.0, decision_interval=2.0, constraints=limits)
    )
    covariance = np.diag([4.0, 9.0, 0.01, 0.01])
    auvs = [op.Belief.at(20.0, -10.0, speed=1.0, covariance=covariance)]
    decision = benchmark(planner.plan, op.Pose(10.0, -20.0, 0.5), auvs)
    assert abs(decision.turn_rate) <= CNA.max_turn_rate
    assert AMONG.fixed_violation(decision.path[:2, :2]).max() < 0
