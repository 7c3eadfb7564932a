"""A log as a recording: merged by time, in one frame, with the scenario it belongs to."""

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from obsplan.missions.mission import FARTHEST
from obsplan.quantities import DURATION
from obsplan.replay import conventions, distances
from obsplan.replay.beside import NOISE, First, Near, as_survey, first_estimate, make_scenario
from obsplan.replay.compass import with_headings
from obsplan.replay.conventions import Heard, Reckoned
from obsplan.replay.log import EPOCH, Fixes, Log
from obsplan.replay.merge import Candidates, Course, Frame, Held, courses, sort_ranges, to_tape
from obsplan.replay.motion import flat
from obsplan.replay.recorded import Recording
from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance
from obsplan.sensors import BEACON, Range
from obsplan.spelling import nearest
from obsplan.tape import Tape
from obsplan.types import ObsplanError

STEPS = (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0)  # that a time step may be [s]
LONGEST_STEP = 1.0  # [s], where there are not too many samples
MOST_SAMPLES = 100_000
ABOUT = 1.05  # a step is chosen if it is no longer than that times the usual one


def assemble(log: Log) -> Recording:
    """Merge a log.

    Raises
    ------
    ObsplanError
        No beacon, or times, places or keys that cannot be.
    """
    log.check_clocks()
    if not log.beacons:
        raise ObsplanError(
            f"{log.path} says of no beacon where it is, and ranges alone give no position: add "
            "beacons.csv"
        )
    frame = Frame(min(float(motion.time[0]) for motion in log.motions.values()), _origin(log))
    beacons = {name: frame.local(fixes) for name, fixes in log.beacons.items()}
    # those that move first, as a scenario's aid vehicles are
    beacons = dict(sorted(beacons.items(), key=lambda item: item[1].fixed))
    truths = {name: frame.local(fixes) for name, fixes in log.truths.items()}
    _check_places(log, {**beacons, **truths})
    auvs = courses(log, frame)
    _check_names(log, "auv", [course.name for course in auvs])
    _check_names(log, "beacon", [*beacons])
    step, grid = _grid(log, auvs)
    auvs = tuple(replace(course, end=min(course.end, float(grid[-1]))) for course in auvs)
    rows, discarded = sort_ranges(log, frame, auvs, beacons)
    tape, held = to_tape(log, auvs, beacons, rows, truths, grid, frame.start)
    tape = with_headings(log, tape, auvs, held.heading, frame.start)
    merged = Merged(
        log=log, frame=frame, auvs=auvs, beacons=beacons, truths=truths, rows=rows, held=held
    )
    scenario = merged.scenario(tape, step)
    table = log.settings.table
    return Recording(
        tape=replace(tape, sensors={scenario.ranging_kind: scenario.range_sensor}),
        scenario=scenario,
        notes=tuple(log.notes),
        discarded=tuple(discarded),
        start=_date(frame.start),
        source=table.source,
        licence=table.licence,
        attribution=table.attribution,
        citation=table.citation,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Merged:
    """A log in one frame, of which the scenario is still to be made."""

    log: Log
    frame: Frame
    auvs: tuple[Course, ...]
    beacons: dict[str, Fixes]
    truths: dict[str, Fixes]
    rows: Candidates
    held: Held

    def scenario(self, tape: Tape, step: float) -> Scenario:
        """Say where filters begin, what was surveyed, and which headings look wrong."""
        firsts = [self._first(j) for j in range(len(self.auvs))]
        tables = [self._auv(j, first, tape) for j, first in enumerate(firsts)]
        duration = float(tape.time[-1])
        made = make_scenario(self.log, tables, self.beacons, self.rows, self.frame, duration, step)
        spread = np.sqrt(np.diagonal(first_covariance(made, made.truth_states), axis1=1, axis2=2))
        for j, first in enumerate(firsts):
            sentences = [
                *self._doubts_of_ranges(j, tape, made.range_sensor),
                self._doubt(j, first, tape, spread[j], made.range_sensor),
            ]
            for sentence in filter(None, sentences):
                self.log.note(sentence)
        return made

    def _doubts_of_ranges(self, j: int, tape: Tape, sensor: object) -> list[str]:
        """Sentences on ranges that look like no metres, or too long."""
        if not isinstance(sensor, Range):
            return []
        course = self.auvs[j]
        moved = np.abs(np.diff(course.reckoned.place_at(tape.time) @ [1, 1j], prepend=0.0))
        slant = sensor.geometry == "slant"
        return [
            distances.impossible_changes(course.name, tape, j, np.cumsum(moved), sensor.sigma),
            distances.off_by_truth(course.name, tape, j, slant=slant),
        ]

    def _first(self, j: int) -> First:
        """What a vehicle's filter begins with."""
        log, course = self.log, self.auvs[j]
        near = Near.of(self.rows, j, self.beacons, self.frame.start)
        told = told_of(log, course.name, j).get("first_estimate", {})
        return first_estimate(log, course, told, self.truths.get(course.name), near)

    def _auv(self, j: int, first: First, tape: Tape) -> dict[str, Any]:
        """Keys of an AUV."""
        course, log = self.auvs[j], self.log
        truth = self.truths.get(course.name)
        time = course.reckoned.time
        places = first.placed(course.reckoned.place @ [1, 1j])
        track = flat(places)
        if truth is not None and truth.time.size > 1:
            time, track = truth.time, truth.place
        told = told_of(log, course.name, j), log.settings.scenario.get("estimator", {})
        if not any("process_noise" in table for table in told):
            said = ", ".join(f"{key} {value:g}" for key, value in NOISE.items())
            log.note(f'process noise of "{course.name}" is not told: {said} per root second')
        # the tape's first heading is that of the first displacement
        heading = np.rad2deg(first.heading + self.held.heading[j, 0])
        begins = {"speed": float(self.held.speed[j]), **first.given, "heading_deg": float(heading)}
        return {
            "name": course.name,
            "depth": float(tape.depth[j].mean()),
            "first_estimate": begins,
            "process_noise": dict(NOISE),
            **as_survey(time, track),
        }

    def _doubt(
        self, j: int, first: First, tape: Tape, spread: Float[np.ndarray, " n"], sensor: object
    ) -> str:
        """A sentence on headings that look wrong, by the truth or else by the ranges."""
        course, told = self.auvs[j], tape.measurements
        places: Complex[np.ndarray, " samples"] = course.reckoned.place_at(tape.time) @ [1, 1j]
        moved = first.placed(places) - complex(first.x, first.y)
        track = Reckoned(course.name, tape.time, moved, first.heading)
        if tape.truth is not None and np.isfinite(tape.truth[j, :, 0]).any():
            return conventions.against_truth(track, tape.truth[j])
        if np.rad2deg(spread[2]) > conventions.VAGUE:
            return ""
        own = np.flatnonzero((told.auv == j) & (told.beacon < len(self.beacons)))
        at = told.told[own]
        value = told.value[own]
        if isinstance(sensor, Range) and sensor.geometry == "slant":
            height = at[:, BEACON.index("depth")] - at[:, BEACON.index("auv_depth")]
            value = np.sqrt(np.maximum(value**2 - height**2, 0.0))
        heard = Heard(
            sample=np.searchsorted(tape.time, told.received[own]),
            beacon=at[:, 0] + 1j * at[:, 1],
            value=value,
            sigma=sensor.sigma if isinstance(sensor, Range) else 1.0,
        )
        here = complex(first.x, first.y)
        return conventions.against_ranges(track, heard, here, float(spread[0]))


def told_of(log: Log, name: str, number: int) -> dict[str, Any]:
    """What ``recording.toml`` says of a vehicle: by its name, or in its place if nameless."""
    tables = log.settings.scenario.get("auv", [])
    if not isinstance(tables, list):
        return {}
    entries = [one for one in tables if isinstance(one, dict)]
    named = next((one for one in entries if one.get("name") == name), None)
    if named is not None:
        return named
    nameless = number < len(entries) and "name" not in entries[number]
    return entries[number] if nameless else {}


def _check_names(log: Log, key: str, names: Sequence[str]) -> None:
    """Refuse tables of ``recording.toml`` for what is not recorded."""
    tables = log.settings.scenario.get(key, [])
    if not isinstance(tables, list):
        return
    for i, one in enumerate(tables):
        name = one.get("name") if isinstance(one, dict) else None
        if name is None and i >= len(names):
            raise ObsplanError(
                f"{log.settings.source}: {key}.{i} is one more than the {len(names)} that are "
                "recorded: remove it"
            )
        if name is not None and name not in names:
            raise ObsplanError(
                f'{log.settings.source}: {key}.{i}.name = "{name}" is not recorded; '
                f"{nearest(str(name), names)}"
            )


def _origin(log: Log) -> tuple[float, float]:
    """Latitude and longitude of local (0, 0): as told, or the first place in degrees."""
    told = log.settings.scenario.get("origin")
    if isinstance(told, dict) and all(isinstance(told.get(k), int | float) for k in ("lat", "lon")):
        return float(told["lat"]), float(told["lon"])
    fixes = [*log.beacons.values(), *log.truths.values()]
    geographic = [one for one in fixes if one.geographic]
    if geographic and len(geographic) < len(fixes):
        raise ObsplanError(
            f"{log.path} has places in degrees and in metres, and no origin of the metres: give "
            "origin = { lat = ..., lon = ... } in recording.toml"
        )
    if geographic:
        lat, lon = geographic[0].place[0].tolist()
        log.note(f"no origin is told: local (0, 0) is at latitude {lat}, longitude {lon}")
        return lat, lon
    log.note("no origin is told: local (0, 0) is put at latitude 0, longitude 0")
    return 0.0, 0.0


def _check_places(log: Log, fixes: dict[str, Fixes]) -> None:
    """Refuse places that are off the map."""
    for name, one in fixes.items():
        farthest = float(np.abs(one.place).max(initial=0.0))
        if not farthest <= FARTHEST:
            raise ObsplanError(
                f'{log.path}: "{name}" is {farthest / 1e3:.0f} km from the origin, and the map '
                f"ends at {FARTHEST / 1e3:.0f} km: correct its places, or the origin"
            )


def _grid(log: Log, auvs: Sequence[Course]) -> tuple[float, Float[np.ndarray, " samples"]]:
    """The time step and the samples of the run: from the first motion to the last."""
    end = max(course.end for course in auvs)
    told = log.settings.scenario.get("duration")
    if isinstance(told, int | float) and 0 < told < end:
        log.note(f"the first {told:g} s of {end:.0f} s are read, as recording.toml asks for")
        end = float(told)
    if not 0 < end <= DURATION.greatest:
        raise ObsplanError(
            f"{log.path} is {end:g} s long, and must be more than 0 s and at most "
            f"{DURATION.greatest:.0f} s, a month: look for a time that is wrong"
        )
    usual = [np.diff(course.reckoned.time) for course in auvs]
    apart = float(np.median(np.concatenate(usual)))
    fitting = [step for step in STEPS if step <= min(ABOUT * apart, LONGEST_STEP)]
    step = max(fitting, default=STEPS[0])
    step = next((s for s in STEPS if s >= step and end / s <= MOST_SAMPLES), STEPS[-1])
    chosen = log.settings.scenario.get("time_step")
    if isinstance(chosen, int | float) and 1e-3 <= chosen <= STEPS[-1]:
        step = float(chosen)
    return step, np.arange(int(np.ceil(end / step - 1e-9)) + 1) * step


def _date(start: float) -> datetime.datetime | None:
    """Time 0 in UTC, if the clock counts from 1970."""
    return datetime.datetime.fromtimestamp(start, datetime.UTC) if start > EPOCH else None
