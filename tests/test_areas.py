"""Signed distances from polygons, against shapely's: on edges and corners, on their extensions, in slivers, far from the origin."""

import numpy as np
import pytest
import shapely

from formulations.model.areas import outline_of, signed_distance

COMB = np.array(  # concave, with edges on one line, level edges, and two corners in the same place
    [(0, 0), (9, 0), (9, 6), (8, 6), (8, 1), (6, 1), (6, 6), (5, 6), (5, 6), (5, 1), (3, 1), (3, 6), (0, 6)],
    dtype=float,
)  # fmt: skip
SLIVER = np.array([(0.0, 0.0), (100.0, 1e-9), (200.0, 0.0), (100.0, 2e-9)])
ROUNDING = 2.0**-52


def coast(corners, seed):
    """A star-shaped line that wavers."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * np.arange(corners) / corners
    radii = rng.uniform(40.0, 100.0, corners)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def expected(corners, points):
    shape = shapely.Polygon(corners)
    shapely.prepare(shape)
    distance = shapely.distance(shape.exterior, shapely.points(points))
    return np.where(shapely.contains_xy(shape, *points.T), -distance, distance)


def places(corners, count, seed):
    """Points all around, at corners, on edges, on their extensions, level with corners, and a hair beside all of these."""
    rng = np.random.default_rng(seed)
    begin, end = corners, np.roll(corners, -1, axis=0)
    size = np.ptp(corners, axis=0).max()
    k = rng.integers(len(corners), size=count)
    share = rng.uniform(-1.0, 2.0, (count, 1))  # beyond 0 to 1: on an extension
    on_lines = begin[k] + share * (end[k] - begin[k])
    anywhere = corners.mean(axis=0) + rng.uniform(-size, size, (count, 2))
    level = np.column_stack([anywhere[:, 0], begin[k, 1]])
    exact = np.concatenate([on_lines, anywhere, level, begin[k]])
    beside = exact + size * 1e-9 * rng.normal(size=exact.shape)
    return np.concatenate([exact, beside])


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 1e5])
@pytest.mark.parametrize(
    "corners",
    [COMB, COMB[::-1], SLIVER, coast(8, 1), coast(20, 2), coast(400, 3)],
    ids=["comb", "clockwise", "sliver", "8", "20", "400"],
)
def test_distance_is_that_of_shapely(corners, offset):
    """To rounding of the coordinates: 1e-9 of the distance but for that."""
    corners = corners + offset * np.array([1.0, -1.0])
    count = 2000 if len(corners) > 100 else 12_000
    points = places(corners, count, seed=4)
    atol = 8 * ROUNDING * np.abs(points).max()
    found = signed_distance(points, outline_of(corners))
    np.testing.assert_allclose(found, expected(corners, points), rtol=1e-12, atol=atol)


def test_distance_at_a_place_does_not_hang_on_the_places_beside_it():
    corners = coast(300, 5)
    points = places(corners, 30, seed=6)
    outline = outline_of(corners)
    alone = [signed_distance(point, outline) for point in points]
    np.testing.assert_array_equal(signed_distance(points, outline), alone)
    grid = points.reshape(2, -1, 2)
    np.testing.assert_array_equal(signed_distance(grid, outline), np.reshape(alone, (2, -1)))


def test_no_number_is_no_distance_and_no_place_none():
    outline = outline_of(COMB)
    assert np.isnan(signed_distance(np.array([[np.nan, 1.0], [1.0, np.nan]]), outline)).all()
    assert signed_distance(np.empty((0, 2)), outline).shape == (0,)
