"""Claims about latitude, longitude and the local frame."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pymap3d.vincenty import vdist

from obsplan.geo import to_geographic, to_local

ORIGIN = (47.629, -122.337)
A, F = 6378137.0, 1 / 298.257223563  # WGS 84, NIMA TR8350.2


def ecef(latlon):
    """Textbook geocentric coordinates [m] of points on the ellipsoid."""
    lat, lon = np.radians(latlon[..., 0]), np.radians(latlon[..., 1])
    e2 = F * (2 - F)
    N = A / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    return np.stack(
        [N * np.cos(lat) * np.cos(lon), N * np.cos(lat) * np.sin(lon), N * (1 - e2) * np.sin(lat)],
        axis=-1,
    )


def test_local_axes_are_the_east_and_north_of_textbooks():
    latlon = np.array(ORIGIN) + np.random.default_rng(1).uniform(-0.2, 0.2, (50, 2))
    lat, lon = np.radians(ORIGIN)
    east = [-math.sin(lon), math.cos(lon), 0]
    north = [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
    offset = ecef(latlon) - ecef(np.array(ORIGIN))
    np.testing.assert_allclose(
        to_local(latlon, ORIGIN), np.column_stack([offset @ east, offset @ north]), atol=1e-6
    )  # 6e6 m in doubles


def test_distances_from_the_origin_fall_short_of_the_geodesic_by_the_stated_cubic():
    for distance in (500.0, 5e3, 20e3):
        point = to_geographic(np.array([[0.6 * distance, 0.8 * distance]]), ORIGIN)[0]
        geodesic, bearing = vdist(*ORIGIN, *point)
        assert geodesic - distance == pytest.approx(
            distance**3 / (6 * 6.371e6**2), rel=0.05, abs=1e-3
        )  # Vincenty converges to under 1 mm
        assert bearing == pytest.approx(math.degrees(math.atan2(0.6, 0.8)), abs=0.01)


@example(radius=20e3, angle=0.6, lat=47.6, lon=-122.3)
@given(
    radius=st.floats(0, 20e3),
    angle=st.floats(-math.pi, math.pi),
    lat=st.floats(-85, 85),
    lon=st.floats(-180, 180),
)
def test_round_trip_is_better_than_a_ten_thousandth_of_a_millimetre_within_20_km(
    radius, angle, lat, lon
):
    xy = radius * np.array([[math.cos(angle), math.sin(angle)]])
    np.testing.assert_allclose(
        to_local(to_geographic(xy, (lat, lon)), (lat, lon)), xy, rtol=0, atol=1e-7
    )


def test_points_of_any_shape_are_converted_alike():
    xy = np.random.default_rng(2).uniform(-1e3, 1e3, (3, 4, 2))
    np.testing.assert_array_equal(to_geographic(xy, ORIGIN)[1, 2], to_geographic(xy[1, 2], ORIGIN))
    latlon = to_geographic(xy, ORIGIN)
    np.testing.assert_array_equal(to_local(latlon, ORIGIN)[1, 2], to_local(latlon[1, 2], ORIGIN))


def test_longitude_runs_on_across_the_date_line():
    latlon = to_geographic(np.array([[2e3, 0.0]]), (0.0, 179.999))
    assert -180 < latlon[0, 1] < -179.9
    np.testing.assert_allclose(to_local(latlon, (0.0, 179.999)), [[2e3, 0.0]], atol=1e-6)
