"""Names of limits, by which formats that only have names tell them from tracks."""

from collections.abc import Iterator

from obsplan.missions.mission import Area, Mission


def limit_names(mission: Mission) -> Iterator[tuple[str, str, Area]]:
    """Name, kind and area of each limit: ``geofence``, ``geofence-2``, ``keep-out-1``, ..."""
    for i, area in enumerate(mission.geofences, start=1):
        yield ("geofence" if i == 1 else f"geofence-{i}"), "geofence", area
    for i, area in enumerate(mission.keep_outs, start=1):
        yield f"keep-out-{i}", "keep-out", area
