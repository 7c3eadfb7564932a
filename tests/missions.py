"""A mission with everything in it, for tests of writers."""

import numpy as np
import pymap3d

from obsplan.missions import Area, Mission, Track

ORIGIN = (47.629, -122.337)
# waypoints [m], times [s], a hold of 30 s at the third, and two speeds
POINTS = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (-20.0, 60.0), (-20.0, 5.5)])
SPEED = np.array([2.0, 2.0, 1.25, 1.25])
HOLD = np.array([0.0, 0.0, 30.0, 0.0, 0.0])
TIME = np.array([0.0, 50.0, 80.0, 206.0, 249.6])
FENCE = np.array([(-60.0, -40.0), (-60.0, 90.0), (150.0, 90.0), (150.0, -40.0)])  # clockwise
WRECK = np.array([(20.0, 20.0), (45.0, 20.0), (30.0, 40.0)])
BUOY, BUOY_RADIUS = np.array([(75.0, 30.0)]), 12.5


def degrees(xy):
    """Latitudes and longitudes of places at altitude 0 near the origin, by pymap3d alone."""
    up = (xy**2).sum(axis=1) / (2 * 6.371e6)  # the tangent plane above the ellipsoid
    lat, lon, _ = pymap3d.enu2geodetic(xy[:, 0], xy[:, 1], -up, *ORIGIN, 0.0)
    return np.stack([lat, lon], axis=-1)


def metres(latlon):
    """East and north of the origin, by pymap3d alone."""
    return np.stack(
        pymap3d.geodetic2enu(latlon[:, 0], latlon[:, 1], 0.0, *ORIGIN, 0.0)[:2], axis=-1
    )


def full_mission(**changes):
    """One vehicle's mission with speeds, a hold, times, a geofence and two keep-outs."""
    track = Track(points=degrees(POINTS), speed=SPEED, hold=HOLD, time=TIME)
    mission = {
        "tracks": {"cna": track},
        "geographic": True,
        "home": tuple(degrees(np.array([(-5.0, -5.0)]))[0].tolist()),
        "geofences": (Area(points=degrees(FENCE)),),
        "keep_outs": (
            Area(points=degrees(WRECK)),
            Area(points=degrees(BUOY), radius=BUOY_RADIUS),
        ),
    }
    return Mission(**mission | changes)


def moos_behaviours(text):
    """Blocks of a behaviour file: name of the behaviour and its parameters."""
    lines = [line.split("//")[0].strip() for line in text.splitlines()]
    blocks, block = [], None
    for line in filter(None, lines):
        if line.startswith("Behavior"):
            block = {"Behavior": line.split("=")[1].strip()}
            blocks.append(block)
        elif "=" in line:
            key, _, value = line.partition("=")
            block[key.strip()] = value.strip()
    return blocks


def moos_points(text):
    return np.array([[float(number) for number in p.split(",")] for p in text.split(":")])
