"""Read a recording, whatever its format."""

from pathlib import Path

from obsplan.replay.assemble import assemble
from obsplan.replay.folder import read_folder
from obsplan.replay.log import Log
from obsplan.replay.pyfg import read_pyfg
from obsplan.replay.recorded import Recording
from obsplan.replay.ros import BAGS, is_bag, read_bag
from obsplan.types import ObsplanError

FORMATS = (
    f"a folder of CSV tables, a .pyfg, a CSV of ranges beside such tables, or a {', '.join(BAGS)}"
)


def read(path: Path | str) -> Recording:
    """Read a recording: a folder of CSV tables (`docs/replay.md`), a factor graph, or a rosbag.

    A CSV file is the ranges of the folder that it is in.

    Raises
    ------
    ObsplanError
        What cannot be read; one sentence with file, line, column, value and remedy.
    """
    return assemble(read_log(Path(path)))


def read_log(path: Path) -> Log:
    """Read a recording as it is, before it is merged.

    Raises
    ------
    ObsplanError
        As `read`.
    """
    try:
        if not path.exists():
            raise ObsplanError(f"{path} does not exist: give {FORMATS}")
        return _read(path)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ObsplanError(f"{path} cannot be read ({why}): check its name") from error


def _read(path: Path) -> Log:
    suffix = path.suffix.lower()
    if is_bag(path):
        return read_bag(path)
    if path.is_dir():
        return read_folder(path)
    if suffix == ".pyfg":
        return read_pyfg(path)
    if suffix == ".csv":
        return read_folder(path.parent, ranges=path)
    raise ObsplanError(f"{path} is no recording that can be read: give {FORMATS}")
