"""Where a scenario's vehicles are to be and when: surveys, samples, water, rounds of ranges."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Integer

from obsplan.missions import Mission, read_mission, to_local
from obsplan.plugins import class_of
from obsplan.scenario.beacons import offsets, ranged_steps
from obsplan.scenario.choice import options
from obsplan.scenario.communication import MOST_IN_FLIGHT, most_in_flight
from obsplan.scenario.equipment import Equipment
from obsplan.scenario.plausible import check_metres_are_metres, known_speeds
from obsplan.scenario.size import check_steps
from obsplan.scenario.surveys import asked
from obsplan.scenario.tables import MissionSurvey, aids_of
from obsplan.surveys import SURVEYS, Formation, Motion, Reference, Waypoints
from obsplan.types import ObsplanError, Pose
from obsplan.vehicles import Unicycle

SEVERAL = 24  # hypotheses that follow the first range, where one would not do


@dataclass(frozen=True, kw_only=True)
class Course(Equipment):
    """What follows from a `Scenario` before anything is flown; ``folder`` is where paths start."""

    folder: Path = Path()

    @property
    def cna(self) -> Unicycle:
        """The aid vehicle; of several the first."""
        return self.aids[0]

    @cached_property
    def aids(self) -> tuple[Unicycle, ...]:
        """The aid vehicles."""
        return tuple(
            Unicycle(speed=aid.speed, min_turn_radius=aid.min_turn_radius)
            for aid in aids_of(self.table)
        )

    @property
    def start(self) -> Pose:
        """Where the (first) aid vehicle starts, unless its planner says otherwise."""
        return self.starts[0]

    @property
    def starts(self) -> tuple[Pose, ...]:
        """Where the aid vehicles start, unless their planners say otherwise."""
        starts = [aid.start for aid in aids_of(self.table)]
        return tuple(Pose(s.x, s.y, float(np.deg2rad(s.heading_deg))) for s in starts)

    @cached_property
    def hypotheses(self) -> int:
        """How many positions of an AUV there is room for at first.

        There is more than one where the ring of a range at the start bends, over a standard
        deviation of the first estimate, by more than the range's own.
        """
        asked = self.table.estimator.hypotheses
        if asked != "auto":
            return asked
        carried = [(start.x, start.y) for start in self.starts]
        moored = [beacon.place for beacon in self.beacons if beacon.carrier is None]
        places = np.array([*carried, *moored])
        for auv, reference in zip(self.table.auv, self.references, strict=True):
            apart = np.hypot(*(places - reference.polyline[0]).T)
            width2 = auv.first_estimate.sigma_position**2
            if (width2 > 2 * apart * self._thickness(apart)).any():
                return SEVERAL
        return 1

    def process_noise(self, *, assumed: bool = False) -> Float[np.ndarray, "auvs 4"]:
        """Standard deviations per square root of a second of (east, north, heading, speed).

        They are the truth's, or those that the filter assumes; what grows with the distance
        travelled is at the survey's mean speed.
        """
        override = self.table.estimator.process_noise if assumed else None
        found = []
        for i, auv in enumerate(self.table.auv):
            noise = override or auv.process_noise
            position, heading = noise.position, noise.heading_deg
            if noise.position_per_meter or noise.heading_deg_per_meter:
                way = np.sqrt(self.motions[i].speed.mean())
                position = np.hypot(position, noise.position_per_meter * way)
                heading = np.hypot(heading, noise.heading_deg_per_meter * way)
            found.append([position, position, np.deg2rad(heading), noise.speed])
        return np.array(found)

    @cached_property
    def assumed_noises(self) -> list[tuple[float, float, float]]:
        """Of position, heading and speed, as the filter of each AUV assumes them."""
        noises = self.process_noise(assumed=True).tolist()
        return [(position, heading, speed) for position, _, heading, speed in noises]

    def _thickness(self, apart: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Standard deviation of a range at some distances [m], a squared range's in metres."""
        sensor = self.filter_sensor
        if self.ranging_kind == "squared-range":
            return sensor.sigma / (2 * np.maximum(apart, 1e-3))
        growth = getattr(sensor, "growth", 0.0)
        return np.hypot(sensor.sigma, growth * apart)

    @cached_property
    def references(self) -> tuple[Reference, ...]:
        """Motion each AUV is asked to follow."""
        done: dict[str, Reference] = {}
        for i, auv in enumerate(self.table.auv):
            try:
                done[auv.name] = self._reference(i, done)
            except (ValueError, ObsplanError) as error:
                raise self.error(f"auv.{i}.survey", error) from None
        return tuple(done.values())

    def _reference(self, i: int, done: dict[str, Reference]) -> Reference:
        auv = self.table.auv[i]
        current = np.array(self.assumed_currents[i])
        if isinstance(auv.survey, MissionSurvey):
            survey = self._mission(auv.survey, paced=auv.speed is None)
            return survey.reference(speed=auv.speed, current=current)
        cls = class_of(auv.survey.kind, SURVEYS)
        survey = cls(**options(cls, auv.survey))
        if not isinstance(survey, Formation):
            return asked(survey, auv.speed, current)
        if survey.leader not in done:
            raise ValueError(
                f'leader "{survey.leader}" is not an AUV listed before "{auv.name}"; '
                f"listed are {list(done) or 'none'}: name one of them, or list the leader first"
            )
        return survey.follow(done[survey.leader], current)

    def _mission(self, survey: MissionSurvey, *, paced: bool) -> Waypoints:
        """The track of a mission file, with its holds and, where it sets the pace, its speeds."""
        tracks = self._missions[survey.file].tracks
        name = survey.track if survey.track is not None else next(iter(tracks))
        if name not in tracks:
            raise ValueError(f'{survey.file} has no track "{name}"; known are {", ".join(tracks)}')
        track = tracks[name]
        speeds = known_speeds(track) if paced else None
        return Waypoints(
            points=tuple((x, y) for x, y in track.points.tolist()),
            speeds=None if speeds is None else tuple(speeds.tolist()),
            holds=None if track.hold is None else tuple(track.hold.tolist()),
        )

    @cached_property
    def _missions(self) -> dict[str, Mission]:
        """Every mission file a survey names, in metres."""
        surveys = [auv.survey for auv in self.table.auv]
        names = dict.fromkeys(s.file for s in surveys if isinstance(s, MissionSurvey))
        return {name: self._read_mission(name) for name in names}

    def _read_mission(self, name: str) -> Mission:
        mission = read_mission(self.folder / name)
        check_metres_are_metres(name, mission)
        return to_local(mission, self._origin)

    @property
    def _origin(self) -> tuple[float, float]:
        origin = self.table.origin
        return origin.lat, origin.lon

    @cached_property
    def time(self) -> Float[np.ndarray, " steps"]:
        """Sample instants [s], from 0."""
        duration = self.table.duration or max(reference.duration for reference in self.references)
        if not duration > 0:
            raise self.error(
                "duration", "is missing, and no AUV moves; give the length of the mission [s]"
            )
        step = self.table.time_step
        steps = int(np.ceil(duration / step - 1e-9))
        auvs = len(self.table.auv)
        check_steps(steps, auvs, duration=duration, time_step=step, source=self.source)
        return np.arange(steps + 1) * step

    @cached_property
    def unknown_currents(self) -> Float[np.ndarray, "samples auvs 2"] | None:
        """The true current at each AUV less the one it counts on [m/s]; None where they agree."""
        off = self.currents - np.array(self.assumed_currents)
        return off if off.any() else None

    @cached_property
    def currents(self) -> Float[np.ndarray, "samples auvs 2"]:
        """The true current at each AUV, east and north [m/s]."""
        return self.water.at(self.time[:, None], self.depths)

    @property
    def log_every(self) -> tuple[int, ...]:
        """Steps between measurements of each AUV's speed; 0 where nothing measures it."""
        return tuple(
            0
            if auv.speed_sensor is None
            else self._steps(f"auv.{i}.speed_sensor.interval", auv.speed_sensor.interval)
            for i, auv in enumerate(self.table.auv)
        )

    @cached_property
    def motions(self) -> tuple[Motion, ...]:
        """The references at the sample instants."""
        return tuple(reference.sample(self.time) for reference in self.references)

    @property
    def ping_every(self) -> int:
        """Steps between ranges."""
        return self._steps("ranging.interval", self.table.ranging.interval)

    @property
    def decide_every(self) -> int:
        """Steps between decisions: as many as make about a second, unless the scenario says."""
        interval, step = self.table.planner.interval, self.table.time_step
        return self._steps(
            "planner.interval", max(1, round(1.0 / step)) * step if interval is None else interval
        )

    def _steps(self, key: str, interval: float) -> int:
        ratio = interval / self.table.time_step
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
            raise self.error(
                key,
                (
                    f"{interval} s is not a whole multiple of time_step = {self.table.time_step} "
                    "s; change one of them"
                ),
            )
        return round(ratio)

    @property
    def late(self) -> int:
        """Steps that a report takes."""
        latency = self.communication.latency
        return self._steps("communication.latency", latency) if latency else 0

    @property
    def in_flight(self) -> int:
        """Reports of an AUV that may be on their way at once."""
        ranging, latency = self.table.ranging, self.communication.latency
        spread = bool(ranging.slot or ranging.jitter)
        carried = sum(beacon.carrier is not None for beacon in self.beacons)
        in_round = carried if spread else min(carried, 1)
        most = most_in_flight(
            latency, interval=ranging.interval, jitter=ranging.jitter, in_round=in_round
        )
        found = min(self.late, most)
        if found > MOST_IN_FLIGHT:
            raise self.error(
                "communication.latency",
                f"{latency:g} s keeps up to {found} reports of an AUV on their way at once, and at "
                f"most {MOST_IN_FLIGHT} are followed: give a shorter one, or a longer "
                "ranging.interval",
            )
        return found

    @property
    def pings(self) -> Integer[np.ndarray, " pings"]:
        """Indices of the sample instants at which ranges are due; none at time 0."""
        return np.flatnonzero(self.ranged(None).any(axis=(1, 2))) + 1

    @cached_property
    def offsets(self) -> Float[np.ndarray, "beacons auvs"]:
        """When in a round each AUV ranges to each beacon [s]."""
        found = offsets(self.table, len(self.beacons), len(self.table.auv))
        ranging = self.table.ranging
        last = found.max() + ranging.jitter
        if last >= ranging.interval and last > 0:
            raise self.error(
                "ranging.slot",
                f"{ranging.slot} s and jitter = {ranging.jitter} s make a round of {last:g} s and "
                f"more, and interval is {ranging.interval} s: give a longer interval, or less",
            )
        return found

    def ranged(self, random: np.random.Generator | None) -> Bool[np.ndarray, "steps beacons auvs"]:
        """At the end of which steps each AUV ranges to each beacon; ``random`` adds the jitter."""
        return ranged_steps(self.table, self.time.size - 1, self.offsets, random)

    @cached_property
    def depths(self) -> Float[np.ndarray, "samples auvs"]:
        """Depths of the AUVs' transducers [m]; between points of a survey they change evenly."""
        found = np.empty((self.time.size, len(self.table.auv)))
        for i, (auv, reference) in enumerate(zip(self.table.auv, self.references, strict=True)):
            try:
                found[:, i] = reference.depth(self.time, auv.depth)
            except ValueError as error:
                raise self.error(f"auv.{i}.depth", error) from None
        return found
