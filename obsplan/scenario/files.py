"""Scenario files, shipped or a user's."""

import os
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from obsplan.scenario.contents import parse_toml
from obsplan.scenario.scenario import Scenario, from_dict
from obsplan.scenario.settings import with_planner, with_setting
from obsplan.spelling import nearest
from obsplan.types import ObsplanError

SHIPPED = Path(str(files("obsplan") / "scenarios"))
SUITES = {  # folders of scenarios on which planners are compared, and their world
    "suite": "every range is horizontal, of one instant and of constant error, and none is lost",
    "field": "ranges, losses and currents are as at sea: each number has its source in the file",
    "systems": "one survey is flown under each system of Appendix A, and nothing else differs",
    "thesis": "noise and filter are such that the thesis's section 5.3 comes out; it has neither",
}
MOST_BYTES = 20_000_000  # some 500 000 waypoints


def shipped() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def suite(folder: str = "suite") -> list[str]:
    """Names of the scenarios of one of the `SUITES`, on which planners are compared."""
    return sorted(f"{folder}/{path.stem}" for path in (SHIPPED / folder).glob("*.toml"))


def all_shipped() -> list[str]:
    """Names of all scenarios that come with the package, those of the suites last."""
    return [*shipped(), *(name for folder in SUITES for name in suite(folder))]


def load(name: str | Path, *, planner: str | None = None, settings: Sequence[str] = ()) -> Scenario:
    """Read a shipped scenario by name, or a scenario file, and check all of it.

    Parameters
    ----------
    name
        Name of a shipped scenario, or path of a TOML file. A name that is shipped always means the
        shipped scenario: a file of that name is ``"./NAME"``, a folder of that name is never looked
        at.
    planner
        Replaces the kind of planner and its own options. The time between decisions and the
        planner's knowledge stay.
    settings
        ``table.key=value`` each, applied after ``planner``; tables in a list by number:
        ``auv.0.speed=0.5``.

    Raises
    ------
    ObsplanError
        What the user gave is wrong; one sentence with the place, the value and the remedy.
    """
    path = find(name)
    source = path.name
    data = with_planner(read(path), planner)
    for setting in settings:
        data = with_setting(data, setting)
    return from_dict(data, source=source, folder=path.parent)


def find(name: str | Path) -> Path:
    """Path of a scenario file by its shipped name, or by its path.

    A shipped name means nothing else, whatever lies in the working directory.
    """
    if str(name) in all_shipped():
        return SHIPPED / f"{name}.toml"
    path = Path(name)
    if path.suffix != ".toml" and not os.path.exists(path):
        raise ObsplanError(
            f'no scenario "{name}" is shipped and no such file exists; {meant(path)}'
        )
    return path


def meant(path: Path) -> str:
    """The remedy for a path that is no scenario file: the file beside or inside it, if any."""
    candidates = (Path(f"{path}.toml"), path / "scenario.toml")
    there = [str(file) for file in candidates if os.path.isfile(file)]
    return f'did you mean "{there[0]}"?' if there else nearest(str(path), shipped())


def read(path: Path) -> dict[str, Any]:
    """Parse a TOML file of at most `MOST_BYTES`."""
    if os.path.isdir(path):
        raise ObsplanError(f"{path}: is a folder and no scenario file; {meant(path)}")
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ObsplanError(
                f"{path}: is larger than {MOST_BYTES / 1e6:.0f} MB, and scenarios are not; keep "
                "long surveys in mission files"
            )
        return parse_toml(content.decode("utf-8-sig"))
    except FileNotFoundError:
        raise ObsplanError(
            f"{path}: no such file; `obsplan scenarios` lists those that are shipped"
        ) from None
    except OSError as error:
        raise ObsplanError(f"{path}: cannot be read: {error.strerror}; check its name") from None
    except UnicodeDecodeError as error:
        raise ObsplanError(
            f"{path}: is not text in UTF-8 (byte {error.start}); give a scenario file in TOML"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise ObsplanError(
            f"{path}: is not valid TOML: {error}; for a mission file use `obsplan new {path.name}`"
        ) from None
    except ValueError as error:  # bounds of the parser, or a null character in the name
        raise ObsplanError(f"{path}: {error}") from None
