"""The files of a run: all of them, or no folder."""

import csv
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float

from obsplan.files import write_atomically
from obsplan.planners import name_of
from obsplan.recording import write_netcdf
from obsplan.report.export import Export, make_exports, summaries
from obsplan.report.path_files import write_paths
from obsplan.report.sea import summary_of
from obsplan.run import Run
from obsplan.spelling import inert
from obsplan.types import ObsplanError

REPORT = "report.html"
DECIMALS = 6  # in tables: micrometres, microradians
BLOCK = 4096  # samples of a table that are made at once

TRACK_COLUMNS = (
    *("time_s", "cna_x_m", "cna_y_m", "cna_heading_rad", "cna_turn_rate_radps"),
    *("auv", "auv_x_m", "auv_y_m", "auv_heading_rad", "est_x_m", "est_y_m"),
    *("sigma_x_m", "sigma_y_m", "error_m", "range_m"),
)


def free_folder(out: Path | None, name: str) -> Path:
    """Find where results can go: the folder asked for, else ``name``, ``name-2``, ... here.

    Raises
    ------
    FolderExistsError
        The folder asked for exists.
    ObsplanError
        Nothing can be made where it should be.
    """
    folder = out or next(path for path in numbered(name) if not os.path.lexists(path))
    check_free(folder)
    return folder


def numbered(name: str) -> Iterator[Path]:
    """Folders ``name``, ``name-2``, ``name-3`` and so on."""
    yield Path(name)
    for number in count(2):
        yield Path(f"{name}-{number}")


def write_free(out: Path | None, name: str, write: Callable[[Path], None]) -> Path:
    """Write into a `free_folder` and return it.

    Where another program took the name meanwhile, the next name is tried.

    Raises
    ------
    ObsplanError
        As `free_folder` and ``write``.
    """
    while True:
        folder = free_folder(out, name)
        try:
            write(folder)
        except FolderExistsError:
            if out is not None:
                raise
        else:
            return folder


class FolderExistsError(ObsplanError):
    """A folder of that name exists."""


def write_run(
    run: Run,
    folder: Path | str,
    exports: Sequence[Export] | None = None,
    *,
    hindsight: dict[str, Any] | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write all files of a run into a new folder.

    They are its scenario, recording, tracks, paths for vehicles, figures and figures of merit.
    They are made in a hidden folder beside it, which gets its name when they are complete.
    Whatever happens before, nothing is left behind. The same run gives the same bytes in every
    file but ``timing.json``.

    Parameters
    ----------
    exports
        The missions made of the run, if they have been made already (`make_exports`); empty where
        they could not be made, and no file of them is written.
    hindsight
        What the recorded path was worth (`Hindsight.summary`), for ``summary.json``.
    notes
        Sentences on the run, for ``report.html``.

    Raises
    ------
    ObsplanError
        The folder exists or cannot be written.
    """
    from obsplan.report.errors import errors_figure
    from obsplan.report.innovations import innovations_figure, shows_innovations
    from obsplan.report.map import map_figure
    from obsplan.report.page.run import run_page
    from obsplan.report.style import png

    summary = summary_of(run)
    if exports is None:  # what was sailed is not sailed again
        exports = () if run.is_replay else make_exports(run)
    if exports:
        summary["export"] = summaries(exports)
    if hindsight is not None:
        summary["hindsight"] = hindsight
    with new_folder(Path(folder)) as made:
        write_atomically(made / "scenario.toml", scenario_toml(run))
        write_netcdf(run, made / "tracks.nc")
        for name, table in tables(run).items():
            write_atomically(made / name, table)
        for export in exports:
            write_paths(run, export, made)
        write_atomically(made / "map.png", png(partial(map_figure, run)))
        write_atomically(made / "errors.png", png(partial(errors_figure, run)))
        if shows_innovations(run):
            write_atomically(made / "nis.png", png(partial(innovations_figure, run)))
        write_atomically(made / REPORT, run_page(run, notes))
        write_atomically(made / "summary.json", as_json(summary))
        write_atomically(made / "timing.json", as_json(timing(run)))


def tables(run: Run) -> dict[str, Iterator[str]]:
    """The tables of a run by their file names, in pieces."""
    from obsplan.report.measurements import has_more_measured, measurements_csv
    from obsplan.report.planned import planned_csv
    from obsplan.report.ranged import ranges_csv, smoothed_csv

    found = {"tracks.csv": tracks_csv(run)}
    if run.others:
        found["aids.csv"] = aids_csv(run)
    if not run.is_replay and has_more_measured(run.scenario):
        found["measurements.csv"] = measurements_csv(run)
    if any(run.planned):
        found["planned.csv"] = planned_csv(run)
    if run.ranged is not None:
        found["ranges.csv"] = ranges_csv(run, run.ranged)
    if run.smoothed is not None:
        found["smoothed.csv"] = smoothed_csv(run, run.smoothed)
    return found


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Give a hidden folder to fill, and the folder's name to it when that is done.

    On any exception it is removed.

    Raises
    ------
    ObsplanError
        The folder exists or cannot be written.
    """
    check_free(folder)
    made = hidden(folder)
    try:
        made.mkdir()
        yield made
        check_free(folder)
        made.rename(folder)
    except (OSError, ObsplanError) as error:
        reason = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(reason, OSError):
            raise
        raise ObsplanError(
            f"{folder} cannot be written ({reason.strerror}): choose another folder, or make room"
        ) from error
    finally:
        shutil.rmtree(made, ignore_errors=True)  # renamed, unless something went wrong


def hidden(folder: Path) -> Path:
    """Where a folder is made before it gets its name."""
    return folder.parent / f".{folder.name}.{os.getpid()}.part"


def check_free(folder: Path) -> None:
    """Refuse a folder that cannot be made."""
    if os.path.lexists(folder):
        raise FolderExistsError(
            f"{folder} exists and is not overwritten: give another folder, or remove it first"
        )
    if not folder.parent.is_dir():
        raise ObsplanError(
            f"{folder} cannot be made, because {folder.parent} is not a folder: make that first, "
            "or give another"
        )
    try:
        os.lstat(hidden(folder))
    except FileNotFoundError:
        pass
    except OSError as error:
        raise ObsplanError(
            f"{folder} cannot be made ({error.strerror}): give another name"
        ) from error
    if not os.access(folder.parent, os.W_OK | os.X_OK):
        raise ObsplanError(
            f"{folder} cannot be made, because {folder.parent} cannot be written to: give another "
            "folder"
        )


def scenario_toml(run: Run) -> str:
    """The scenario as a file that gives this run again, with nothing left to a default."""
    data: dict[str, Any] = run.scenario.resolved() | {"seed": run.seed}
    how = "replayed" if run.is_replay else "run"
    lines = [
        f"# {data['name']} as it was {how}: every key, mission files replaced by their waypoints"
    ]
    if not run.is_replay and name_of(run.scenario.planner()) != run.planner:
        lines.append(
            f"# but steered by {run.planner}, a planner given from code, which this file cannot "
            "name"
        )
    return "\n".join([*lines, *toml_lines(data), ""])


def toml_lines(data: dict[str, Any]) -> list[str]:
    """A scenario's keys in TOML, tables last."""
    tables = {key: value for key, value in data.items() if key == "auv" or isinstance(value, dict)}
    lines = key_lines({key: value for key, value in data.items() if key not in tables})
    for key, value in tables.items():
        if isinstance(value, dict):
            lines += table_lines(f"[{key}]", key, value)
        else:
            lines += array_lines(key, value)
    return lines


def table_lines(heading: str, name: str, table: dict[str, Any]) -> list[str]:
    """A table in TOML: lists of tables in it follow, other tables in it are on one line each."""
    arrays = {
        key: value
        for key, value in table.items()
        if isinstance(value, list | tuple) and value and isinstance(value[0], dict)
    }
    lines = ["", heading]
    lines += key_lines({key: value for key, value in table.items() if key not in arrays})
    for key, value in arrays.items():
        lines += array_lines(f"{name}.{key}", value)
    return lines


def array_lines(name: str, items: Sequence[dict[str, Any]]) -> list[str]:
    """A list of tables in TOML."""
    return [line for item in items for line in table_lines(f"[[{name}]]", name, item)]


def key_lines(table: dict[str, Any]) -> list[str]:
    """Keys and values in TOML, one a line."""
    return [f"{key} = {toml_value(value)}" for key, value in table.items()]


def toml_value(value: Any) -> str:
    """A value in TOML, on one line.

    tomlkit's own arrays take a time that grows with the square of their length.
    """
    if isinstance(value, dict):
        return "{" + ", ".join(key_lines(value)) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return tomlkit.item(value).as_string()


def tracks_csv(run: Run) -> Iterator[str]:
    """The recording as a table, one row per time and AUV; lengths to a micrometre.

    Columns of the truth, and of an aid vehicle, are empty where there is none.

    It comes in pieces of some thousand rows: as a whole it would take much more memory than the
    recording. ``range_m`` is empty between pings. Of a squared range it is the root, and 0 where
    noise made the square negative.
    """
    yield table_csv([TRACK_COLUMNS])
    for begin in range(0, run.time.size, BLOCK):
        yield table_csv(_track_rows(run, slice(begin, begin + BLOCK)))


AID_COLUMNS = ("time_s", "cna", "x_m", "y_m", "heading_rad", "turn_rate_radps", "speed_mps")


def aids_csv(run: Run) -> Iterator[str]:
    """Several aid vehicles as a table, one row per time and vehicle, in pieces."""
    yield table_csv([AID_COLUMNS])
    for begin in range(0, run.time.size, BLOCK):
        some = slice(begin, begin + BLOCK)
        per_aid = []
        for name, aid in zip(run.aid_names, run.aids, strict=True):
            time = rounded(run.time[some])
            figures = (*aid.pose[some].T, aid.turn_rate[some], aid.speed[some])
            per_aid.append(zip(time, [name] * len(time), *map(rounded, figures), strict=True))
        yield table_csv(row for at_once in zip(*per_aid, strict=True) for row in at_once)


def _track_rows(run: Run, some: slice) -> Iterator[tuple[str, ...]]:
    """Rows of some samples."""
    aid = np.column_stack([run.cna[some], run.turn_rate[some]])
    aid = aid if run.has_aid else np.full_like(aid, np.nan)
    common = [rounded(column) for column in (run.time[some], *aid.T)]
    measured = ranges(run.scenario.ranging_kind, run.range[:, some])
    true = np.full((*measured.shape, 3), np.nan) if run.truth is None else run.truth[:, some, :3]
    error = true[..., 0] if run.truth is None else run.error[:, some]
    per_auv = []
    for i, name in enumerate(run.names):
        variance = np.diagonal(run.covariance[i, some, :2, :2], axis1=1, axis2=2)
        figures = (
            *true[i].T,
            *run.mean[i, some, :2].T,
            *np.sqrt(np.maximum(variance, 0.0)).T,
            error[i],
            measured[i],
        )
        names = [inert(name)] * len(common[0])
        rows = zip(*common, names, *(rounded(figure) for figure in figures), strict=True)
        per_auv.append(rows)
    for at_once in zip(*per_auv, strict=True):
        yield from at_once


def ranges(kind: str, measured: Float[np.ndarray, "auvs _"]) -> Float[np.ndarray, "auvs _"]:
    """Measured ranges [m]; nan without one."""
    if kind == "range":
        return measured
    return np.sqrt(np.maximum(measured, 0.0))


def rounded(values: Any) -> Any:
    """Numbers as text to `DECIMALS`, nan as nothing; names and whole numbers as they are."""
    if isinstance(values, np.ndarray):
        # no -0.000000
        return [
            "" if value != value else f"{value:.{DECIMALS}f}"
            for value in (values.round(DECIMALS) + 0.0).tolist()
        ]
    return f"{round(values, DECIMALS) + 0.0:.{DECIMALS}f}" if isinstance(values, float) else values


def table_csv(rows: Any) -> str:
    """Rows as comma-separated values."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def timing(run: Run) -> dict[str, float | None]:
    """How long it took [s].

    Decisions that are part of the compiled step have no time of their own, and are null.
    """
    steps, decisions = run.time.size - 1, run.timing.decision_seconds
    if not run.timing.seconds > 0:  # it was not looked at
        return {}
    return {
        "decision_median_s": float(np.median(decisions)) if decisions else None,
        "decision_max_s": max(decisions) if decisions else None,
        "step_mean_s": run.timing.seconds / steps,
        "steps_per_second": steps / run.timing.seconds,
    }


def as_json(data: dict[str, Any]) -> str:
    """Strict JSON, readable."""
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
