"""A run read back from its folder, as far as its files tell it."""

import csv
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.fates import WORDS, Fate
from obsplan.planned import AS_FLOWN, Planned
from obsplan.ranged import Ranged
from obsplan.run import AidTrack, Run, Timing
from obsplan.scenario import Scenario, load
from obsplan.scenario.beacons import aid_names
from obsplan.scenario.states import BASIC
from obsplan.types import ObsplanError

SCENARIO, TRACKS, RANGES = "scenario.toml", "tracks.nc", "ranges.csv"
PLANNED = "planned.csv"
POSE, STATES = ("x", "y", "heading"), ("x", "y", "heading", "speed")

Values = dict[str, np.ndarray]  # of each variable, by AUV and sample


def read_run(folder: Path | str) -> Run:
    """Read a run from the files that `obsplan.write_run` made; bearings and reports are not there.

    Raises
    ------
    ObsplanError
        The folder is not that of a run, or a file in it cannot be read or is not of this scenario.
    """
    folder = Path(folder)
    for name in (SCENARIO, TRACKS):
        if not (folder / name).is_file():
            raise ObsplanError(
                f"{folder} has no {name}: give the folder of a run or a replay, or of a campaign"
            )
    scenario = load(folder / SCENARIO)
    try:
        about, values = _variables(folder / TRACKS)
        return _run(scenario, folder, about, values)
    except (OSError, KeyError, ValueError, TypeError, IndexError) as error:
        what = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ObsplanError(
            f"{folder / TRACKS} cannot be read as the tracks of {SCENARIO} beside it ({what}): "
            "run the scenario again"
        ) from error


def _variables(path: Path) -> tuple[dict[str, Any], Values]:
    """Attributes and variables of a NetCDF file; missing values are nan."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "r", mmap=False) as file:
        about = {name: _text(value) for name, value in file._attributes.items()}
        about["time_units"] = _text(file.variables["time"].units)
        values = {
            name: np.array(variable.data, dtype=float)
            for name, variable in file.variables.items()
            if variable.data.dtype.kind in "fi"
        }
    return about, values


def _text(value: Any) -> Any:
    return value.decode() if isinstance(value, bytes) else value


def _run(scenario: Scenario, folder: Path, about: dict[str, Any], values: Values) -> Run:
    time = values["time"][0]
    auvs, samples = values["time"].shape
    nothing = np.full((auvs, samples), np.nan)
    if auvs != len(scenario.table.auv) or samples != scenario.time.size:
        raise ValueError(f"{auvs} AUVs and {samples} samples are not the scenario's")
    first, *others = _aids(values, scenario, samples)
    names = [f"range_{b + 1}" if b else "range" for b in range(len(scenario.beacons))]
    ranges = np.stack([values[name] for name in names])
    label = str(about["condition_label"])
    truth = _states(values, "auv", [*scenario.truth_states]) if "auv_x" in values else None
    run = Run(
        scenario=scenario,
        source=str(about["source"]),
        planner=str(about["planner"]),
        condition_label="" if label == "none" else label,
        seed=int(about["seed"]),
        time=time,
        cna=first.pose,
        turn_rate=first.turn_rate,
        speed=first.speed,
        score=first.score,
        status=first.status,
        truth=truth,
        mean=_states(values, "est", [*scenario.filter_states]),
        covariance=_covariance(values, [*scenario.filter_states]),
        ranges=ranges,
        bearings=np.empty((0, auvs, samples)),
        reports=np.zeros((auvs, samples), dtype=bool),
        condition=values.get("condition", nothing),
        timing=Timing(seconds=np.nan, decision_seconds=[]),
    )
    return _with_findings(replace(run, others=tuple(others)), scenario, folder, about, values)


def _with_findings(
    run: Run, scenario: Scenario, folder: Path, about: dict[str, Any], values: Values
) -> Run:
    """The run with what was found of it when it was written."""
    run = replace(
        run,
        bounded=False,
        began=_began(about["time_units"]),
        log=_ranged(folder / RANGES, scenario),
        planned=_planned(folder / PLANNED, run.aid_names),
        hypotheses=values.get("hypotheses"),
        smoothed=_smoothed(values),
    )
    if "pcrb" in values:  # as it was found then: of a recording it depends on more than is here
        vars(run)["cramer_rao_variance"] = values["pcrb"] ** 2
    return run


def _aids(values: Values, scenario: Scenario, samples: int) -> list[AidTrack]:
    keys = [name.replace("-", "_") for name in _aid_keys(len(scenario.aids))]
    return [_aid(values, key, samples, first=k == 0) for k, key in enumerate(keys)]


def _aid_keys(aids: int) -> Sequence[str]:
    """How the file names aid vehicles: the first is cna, however many there are."""
    return ["cna", *aid_names(aids)[1:]] if aids > 1 else ["cna"]


def _aid(values: Values, name: str, samples: int, *, first: bool) -> AidTrack:
    """A track; at the origin where there is no vehicle. Decisions are recorded of the first."""
    zero, nothing = np.zeros(samples), np.full(samples, np.nan)
    columns = [values[f"{name}_{part}"][0] if f"{name}_x" in values else zero for part in POSE]
    turn, speed = (values.get(f"{name}_{part}", zero[None])[0] for part in ("turn_rate", "speed"))
    status, score = nothing, nothing
    if first and "status" in values:
        status = np.where(values["status"][0] < 0, np.nan, values["status"][0])
        score = values["score"][0]
    return AidTrack(np.column_stack(columns), turn, speed, score, status)


def _states(
    values: Values, prefix: str, states: Sequence[str]
) -> Float[np.ndarray, "auvs samples n"]:
    names = [*STATES, *states[BASIC:]]
    return np.stack([values[f"{prefix}_{name}"] for name in names], axis=-1)


def _covariance(values: Values, states: Sequence[str]) -> Float[np.ndarray, "auvs samples n n"]:
    P = np.empty((*values["time"].shape, len(states), len(states)))
    for i, row in enumerate(states):
        for j, column in enumerate(states[: i + 1]):
            P[..., i, j] = P[..., j, i] = values[f"cov_{row}_{column}"]
    return P


def _smoothed(values: Values) -> Float[np.ndarray, "auvs samples 2"] | None:
    if "smoothed_x" not in values:
        return None
    return np.stack([values["smoothed_x"], values["smoothed_y"]], axis=-1)


def _began(units: str) -> datetime | None:
    """When time was 0; a simulated mission has no date, and its file a nominal one."""
    began = datetime.fromisoformat(units.removeprefix("seconds since ").replace("Z", "+00:00"))
    return None if began.timestamp() == 0.0 else began


def _ranged(path: Path, scenario: Scenario) -> Ranged | None:
    """What became of each range; None of a run that did not record it."""
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    names = [auv.name for auv in scenario.table.auv]
    beacons = tuple(dict.fromkeys([one.name for one in scenario.beacons] + _all(rows, "beacon")))
    codes = {words: fate.value for fate, words in WORDS.items()}
    value, expected = _numbers(rows, "value"), _numbers(rows, "expected")
    return Ranged(
        auvs=tuple(names),
        beacons=beacons,
        unit=rows[0]["unit"] if rows else "m",
        sent=np.full(len(rows), np.nan),
        received=_numbers(rows, "received_s"),
        auv=np.array([names.index(name) for name in _all(rows, "auv")], dtype=int),
        beacon=np.array([beacons.index(name) for name in _all(rows, "beacon")], dtype=int),
        value=value,
        innovation=value - expected,
        variance=_numbers(rows, "sigma") ** 2,
        fate=np.array([codes.get(word, Fate.ACCEPTED) for word in _all(rows, "fate")], dtype=int),
    )


def _planned(path: Path, aids: Sequence[str]) -> tuple[Planned | None, ...]:
    """The paths that planners had in mind; none of a run that did not record any."""
    if not path.is_file():
        return ()
    with path.open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    return tuple(_paths([row for row in rows if row["cna"] == name]) for name in aids)


def _paths(rows: Sequence[dict[str, str]]) -> Planned | None:
    if not rows:
        return None
    if not rows[0]["time_s"]:
        return AS_FLOWN
    decided = _numbers(rows, "decided_s")
    first = np.flatnonzero(np.diff(decided, prepend=np.nan) != 0)
    place = np.column_stack([_numbers(rows, "x_m"), _numbers(rows, "y_m")])
    ends = np.append(first[1:], len(rows))
    return Planned(decided[first], ends, _numbers(rows, "time_s"), place)


def _all(rows: Sequence[dict[str, str]], column: str) -> list[str]:
    """A column of text; a quote that kept it from being a formula is left out."""
    return [_as_named(row[column]) for row in rows]


def _as_named(cell: str) -> str:
    from obsplan.spelling import FORMULA

    return cell[1:] if cell.startswith("'") and cell[1:].startswith(FORMULA) else cell


def _numbers(rows: Sequence[dict[str, str]], column: str) -> Float[np.ndarray, " rows"]:
    return np.array([float(row[column] or "nan") for row in rows])
