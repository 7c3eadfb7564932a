"""What a reader has found in a mission file so far, and the mission it makes."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from obsplan.missions.mission import Area, Draft, Mission, count_of, named_tracks
from obsplan.missions.timing import follow_times, seconds_of
from obsplan.types import ObsplanError

# what a name says of an area, however it is spelt (KEEP_OUT, NoGo, op area); a keep-out first:
# an "exclusion fence" is one
_KEEP_OUT = re.compile(
    r"keep[\s_-]*out|exclusion|(?<![a-z])no[\s_-]*go(?![a-z])|nogo(?=zone|area)"
    r"|obstacle|wreck|restricted",
    re.IGNORECASE,
)
_GEOFENCE = re.compile(
    r"(?<![a-z])fence|geo[\s_-]*fence|inclusion|boundary|operating[\s_-]*area"
    r"|(?<![a-z])op[\s_-]*area",
    re.IGNORECASE,
)
NAMED_SO = 'name it "keep-out ..." or "geofence ..." to make it a limit'
MOST_VERTICES = 200_000  # two days of fixes, one a second
_CUT = 1e-6  # [degrees]; two ends at ±180 are nearer than that if a line was cut there

Vertex = tuple[float, float, float]  # a point as the mission has it, and its altitude [m] or nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """A closed shape as a reader finds it: its parts, their holes, and texts on what it is for."""

    name: str = ""
    texts: Sequence[str] = ()  # the surest first
    parts: Sequence[Area]
    holes: Sequence[Area] = ()

    @property
    def limit(self) -> str:
        """What the first text that says so makes of it: `keep-out`, `geofence`, or nothing."""
        for text in self.texts:
            if _KEEP_OUT.search(text):
                return "keep-out"
            if _GEOFENCE.search(text):
                return "geofence"
        return ""


@dataclass(slots=True, kw_only=True)
class Findings:
    """Lines, closed shapes and things passed over, collected while a file is read."""

    path: Path
    geographic: bool = True
    count: int = 0  # of vertices
    drafts: list[Draft] = field(default_factory=list)
    outlines: list[Outline] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    passed: dict[tuple[str, str], list[str]] = field(default_factory=dict)

    def line(
        self,
        name: str | None,
        vertices: Sequence[Vertex],
        *,
        speed: list[float] | None = None,
        hold: list[float] | None = None,
        time: list[float] | None = None,
    ) -> None:
        """Add a line, with what the file says of its vertices (`Draft`); speed 0 says nothing."""
        self.count += len(vertices)
        check_count(self.count, str(self.path))
        altitude: list[float] | None = [vertex[2] for vertex in vertices]
        known = [not math.isnan(value) for value in altitude]
        if not all(known):
            altitude = None
            if any(known):
                why = "with a height at only some vertices: heights passed over"
                self.passed_over("track", why, name)
        draft = Draft(
            name=name,
            points=[vertex[:2] for vertex in vertices],
            altitude=altitude,
            speed=None if speed is None else [value or math.nan for value in speed],
            hold=None if hold is None else [0.0 if math.isnan(value) else value for value in hold],
            time=time,
        )
        self.drafts.append(draft)

    def times(self, name: str | None, texts: Sequence[str | None]) -> list[float] | None:
        """Read ISO 8601 times as seconds [s], nan where there is none.

        None, and a remark, if one cannot be read.
        """
        times = [seconds_of(text) if text else math.nan for text in texts]
        if any(text and math.isnan(time) for text, time in zip(texts, times, strict=True)):
            self.passed_over("track", "with times that are not ISO 8601: times passed over", name)
            return None
        return times

    def passed_over(self, kind: str, why: str, name: str | None = None) -> None:
        """Count one thing of a kind that is not read, and why."""
        self.passed.setdefault((kind, why), []).append(name or "")

    def mission(self) -> Mission:
        """The mission that the findings make.

        Raises
        ------
        ObsplanError
            A name that cannot be printed, or a limit that is no area.
        """
        drafts = [self._timed(draft) for draft in self.drafts]
        tracks, stubs = named_tracks(self.path, drafts, geographic=self.geographic)
        keep_outs, geofences, areas = self._limits()
        passed = [f"{count_of(names, kind)} {why}" for (kind, why), names in self.passed.items()]
        return Mission(
            tracks=tracks,
            geographic=self.geographic,
            keep_outs=tuple(keep_outs),
            geofences=tuple(geofences),
            areas=tuple(areas),
            remarks=(*self.remarks, *stubs, *passed),
        )

    def _timed(self, draft: Draft) -> Draft:
        """The draft with what follows from its times."""
        timed, wrong = follow_times(draft, geographic=self.geographic)
        if wrong:
            self.passed_over("track", wrong, draft.name)
        return timed

    def _limits(self) -> tuple[list[Area], list[Area], list[Area]]:
        """Keep-outs, geofences, and the areas that no name calls either."""
        keep_outs: list[Area] = []
        geofences: list[Area] = []
        others: list[Area] = []
        for outline in self.outlines:
            name, limit = outline.name, outline.limit
            parts = [part for part in outline.parts if _is_area(part)]
            if limit and len(parts) < max(len(outline.parts), 1):
                raise ObsplanError(
                    f'{self.path}: {limit} "{name}" has fewer than three corners: '
                    "draw it again, or delete it"
                )
            if limit == "keep-out":
                keep_outs += parts
            elif limit == "geofence":
                if len(parts) > 1:
                    raise ObsplanError(
                        f'{self.path}: geofence "{name}" has {len(parts)} parts, '
                        "and a vehicle cannot be in all: draw one polygon"
                    )
                geofences += parts
                keep_outs += [hole for hole in outline.holes if _is_area(hole)]
            else:
                others += parts
                self.passed_over("polygon", f"passed over: {NAMED_SO}", name)
            if outline.holes and limit == "keep-out":
                self.passed_over("keep-out", "with holes: the holes are kept out of, too", name)
            if outline.holes and limit == "geofence":
                self.passed_over("geofence", "with holes: the holes are keep-outs", name)
        return keep_outs, geofences, others


def _is_area(area: Area) -> bool:
    """Whether an area is a circle, or has three corners apart."""
    return area.radius is not None or len({tuple(point) for point in area.points.tolist()}) >= 3


def check_count(count: int, where: str) -> None:
    """Refuse more vertices than a mission has.

    Raises
    ------
    ObsplanError
        More than `MOST_VERTICES`; names the place.
    """
    if count > MOST_VERTICES:
        raise ObsplanError(
            f"{where} has {count} vertices, more than {MOST_VERTICES}: export the mission, not "
            "the log of one"
        )


def join_at_180(lines: Sequence[Sequence[Vertex]]) -> list[list[Vertex]]:
    """Join lines that were cut at ±180 degrees of longitude, as RFC 7946 asks for.

    One ends there where the next begins.
    """
    joined: list[list[Vertex]] = []
    for line in lines:
        if joined and joined[-1] and line and _is_cut(joined[-1][-1], line[0]):
            joined[-1] += line
        else:
            joined.append(list(line))
    return joined


def _is_cut(end: Vertex, start: Vertex) -> bool:
    """Whether two vertices are one place on the line of ±180 degrees."""
    at_180 = min(abs(end[1]), abs(start[1])) >= 180 - _CUT
    return at_180 and abs(end[0] - start[0]) <= _CUT


def ring_area(ring: Sequence[Vertex]) -> Area:
    """The area within a ring, whose last vertex may repeat the first."""
    corners = [vertex[:2] for vertex in ring]
    if len(corners) > 1 and corners[0] == corners[-1]:
        del corners[-1]
    return Area(points=np.array(corners, dtype=float).reshape(-1, 2))
