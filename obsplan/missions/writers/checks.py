"""What a writer asks of a mission."""

from obsplan.missions.mission import Mission, Track


def check_geographic(mission: Mission, what: str) -> None:
    """Refuse local tracks where a format has degrees.

    Raises
    ------
    ValueError
        The mission is local.
    """
    if not mission.geographic:
        raise ValueError(
            f"{what} has latitudes and longitudes, got local tracks: convert them about the "
            "origin first"
        )


def only_track(mission: Mission, what: str) -> tuple[str, Track]:
    """Name and track of a mission for one vehicle.

    Raises
    ------
    ValueError
        Several tracks, or none.
    """
    if len(mission.tracks) != 1:
        raise ValueError(f"{what} holds one track, got {len(mission.tracks)}: write one at a time")
    return next(iter(mission.tracks.items()))
