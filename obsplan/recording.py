"""A run as a labelled dataset by the CF conventions, and as a NetCDF file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int8

from formulations.solution import Status
from obsplan import geo
from obsplan.cf import Variables, latitude, longitude, quantity
from obsplan.files import open_atomically
from obsplan.run import AidTrack, Run
from obsplan.scenario.states import BASIC, own

if TYPE_CHECKING:
    import xarray as xr

# CF wants a date; a simulated mission has none, and begins at zero
EPOCH = "seconds since 1970-01-01T00:00:00Z"
UNITS = "component_units"  # attribute of the states
NO_DECISION = -1  # fill value of the status flag
CCW = "counter-clockwise from east"


def to_dataset(run: Run) -> "xr.Dataset":
    """Label a run: names, units and, by the scenario's origin, latitudes and longitudes.

    Axes are AUV and time. Names are as in ``tracks.csv``, units and standard names by the CF
    conventions.
    """
    import xarray as xr

    variables = {**_cna(run), **_auvs(run), **_decisions(run), **_derived(run)}
    return xr.Dataset(variables, coords=_coordinates(run), attrs=_attributes(run))


def write_netcdf(run: Run, path: Path | str) -> None:
    """Write a run as CF NetCDF: classic format (64-bit offset), one trajectory per AUV.

    The same run gives the same bytes.

    Raises
    ------
    ObsplanError
        The file cannot be written; nothing is left behind.
    """
    # scipy without xarray and pandas, which take longer to import
    from scipy.io import netcdf_file

    names = np.array([name.encode() for name in run.names])
    letters = f"string{names.itemsize}"
    identity = {**_identity(), "_Encoding": "utf-8"}
    with open_atomically(path) as content:
        file = netcdf_file(content, "w", version=2)
        _set_attributes(file, _attributes(run))
        file.createDimension("auv", len(names))
        file.createDimension("obs", run.time.size)
        file.createDimension(letters, names.itemsize)
        for name, (dimensions, values, attributes) in as_trajectories(run).items():
            _add_variable(file, name, dimensions, values, attributes)
        _add_variable(file, "auv", ("auv", letters), names[:, None].view("S1"), identity)
        file.close()


@dataclass(frozen=True, eq=False)
class Unconverted:
    """Values that are laid out as the file wants them when they are written, and not kept so.

    What scipy asks of a variable's data is all there is.
    """

    values: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the values."""
        return self.values.shape

    @property
    def size(self) -> int:
        """Number of values."""
        return self.values.size

    @property
    def dtype(self) -> np.dtype:
        """Type of the file's values: the most significant byte first."""
        return self.values.dtype.newbyteorder(">")

    @property
    def itemsize(self) -> int:
        """Bytes of a value."""
        return self.values.itemsize

    def tobytes(self) -> bytes:
        """The file's values."""
        return self.values.astype(self.dtype).tobytes()


def _add_variable(
    file: Any, name: str, along: tuple[str, ...], values: np.ndarray, attributes: dict[str, Any]
) -> None:
    """Add a variable that is converted when the file is closed."""
    from scipy.io import netcdf_variable

    kind = "c" if values.dtype.kind == "S" else values.dtype.char
    written = netcdf_variable(Unconverted(values), kind, values.itemsize, values.shape, along)
    _set_attributes(written, attributes)
    file.variables[name] = written


def _set_attributes(of: Any, attributes: dict[str, Any]) -> None:
    for name, value in attributes.items():
        if isinstance(value, str):
            setattr(of, name, value.encode())
        elif isinstance(value, float):
            setattr(of, name, np.float64(value))  # else scipy keeps half of the digits
        else:
            setattr(of, name, value)


def as_trajectories(run: Run) -> Variables:
    """Lay a run out as CF wants trajectories (CF-1.11, H.4.1).

    Everything, time too, is by AUV and observation. So the aid vehicle's path is repeated for each
    AUV, as in ``tracks.csv``; the covariance becomes one variable, with its unit, for each entry
    of its lower triangle.
    """
    along = ("auv", "obs")
    shape = (len(run.names), run.time.size)
    coordinates = _coordinates(run)
    data = {**_cna(run), **_auvs(run), **_decisions(run), **_derived(run)}
    del data["covariance"]
    flat: Variables = {}
    for name, (_, values, attributes) in data.items():
        laid = np.broadcast_to(values, shape)
        located = {**attributes, "coordinates": "lat lon time"}
        flat[name] = (along, laid, located | _missing(laid))
    for name in ("lat", "lon", "time"):
        _, values, attributes = coordinates[name]
        flat[name] = (along, np.broadcast_to(values, shape), attributes)
    return flat | _covariances(run)


def _missing(values: np.ndarray) -> dict[str, Any]:
    """The attribute that says what stands for a missing value; none where nothing is missing."""
    if not np.issubdtype(values.dtype, np.floating):
        return {"_FillValue": np.int8(NO_DECISION)}
    return {"_FillValue": np.nan} if np.isnan(values).any() else {}


def _covariances(run: Run) -> Variables:
    """Entries of the lower triangle of each covariance."""
    along = ("auv", "obs")
    units = {name: state.unit for name, state in run.scenario.filter_states.items()}
    found: Variables = {}
    for i, row in enumerate(units):
        for j, column in enumerate([*units][: i + 1]):
            values = run.covariance[..., i, j]
            about = {
                "long_name": f"covariance of the estimated {row} and {column}",
                "units": f"{units[row]} {units[column]}",
                "coordinates": "lat lon time",
            }
            found[f"cov_{row}_{column}"] = (along, values, about | _missing(values))
    return found


def _attributes(run: Run) -> dict[str, Any]:
    """What the file says of itself; no date, so that the same run gives the same bytes."""
    from obsplan import __version__

    table = run.scenario.table
    return {
        "Conventions": "CF-1.11",
        "featureType": "trajectory",
        "title": _title(run),
        "source": run.source,
        "history": f"written by obsplan {__version__}",
        "comment": "x and y are local east and north about the origin on WGS 84; "
        "time is the mission's, its epoch nominal",
        "scenario": table.name,
        "planner": run.planner,
        "seed": np.int32(run.seed) if run.seed < 2**31 else str(run.seed),
        "version": __version__,
        "condition_label": run.condition_label or "none",
        "origin_latitude": table.origin.lat,
        "origin_longitude": table.origin.lon,
    }


def _title(run: Run) -> str:
    name = run.scenario.table.name
    return (
        f"AUVs in {name}, replayed"
        if run.is_replay
        else (f"Aid vehicle and AUVs in {name} under {run.planner}")
    )


def _coordinates(run: Run) -> Variables:
    lat, lon = _latlon(run, run.places)
    which = "true" if run.truth is not None else "best known"
    time = {
        "standard_name": "time",
        "long_name": "mission time",
        "units": EPOCH if run.began is None else f"seconds since {run.began.isoformat()}",
        "calendar": "standard",
        "axis": "T",
        "units_metadata": "leap_seconds: none",
    }
    along = ("auv", "time")
    return {
        "time": (("time",), run.time, time),
        "auv": (
            ("auv",),
            np.array(run.names),
            _identity(),
        ),
        "state": (
            ("state",),
            np.array([*run.scenario.filter_states]),
            {
                "long_name": "component of the estimated state",
                UNITS: [state.unit for state in run.scenario.filter_states.values()],
            },
        ),
        "lat": (along, lat, {**latitude(f"{which} latitude of the AUV"), "axis": "Y"}),
        "lon": (along, lon, {**longitude(f"{which} longitude of the AUV"), "axis": "X"}),
    }


def _identity() -> dict[str, Any]:
    return {"cf_role": "trajectory_id", "long_name": "name of the AUV"}


def _cna(run: Run) -> Variables:
    """The aid vehicle's; of others ``cna_2_x`` and so on."""
    if not run.has_aid:
        return {}
    found = _of_aid(run, run.aids[0], "cna", "the aid vehicle")
    for aid, name in zip(run.others, run.aid_names[1:], strict=True):
        found |= _of_aid(run, aid, name.replace("-", "_"), f"aid vehicle {name}")
    return found


def _of_aid(run: Run, aid: AidTrack, name: str, whose: str) -> Variables:
    along, (east, north, heading) = ("time",), aid.pose.T
    lat, lon = _latlon(run, aid.pose[:, :2])
    turning = f"turn rate of {whose}, positive to the left"
    speed = quantity("m s-1", f"speed of {whose}", "platform_speed_wrt_ground")
    return {
        f"{name}_x": (along, east, quantity("m", f"east of {whose}")),
        f"{name}_y": (along, north, quantity("m", f"north of {whose}")),
        f"{name}_heading": (along, heading, quantity("rad", f"heading of {whose}, {CCW}")),
        f"{name}_turn_rate": (along, aid.turn_rate, quantity("rad s-1", turning)),
        f"{name}_speed": (along, aid.speed, speed),
        f"{name}_lat": (along, lat, latitude(f"latitude of {whose}")),
        f"{name}_lon": (along, lon, longitude(f"longitude of {whose}")),
    }


def _auvs(run: Run) -> Variables:
    along = ("auv", "time")
    est_lat, est_lon = _latlon(run, run.mean[..., :2])
    squared = run.scenario.ranging_kind == "squared-range"
    found: Variables = {}
    for prefix, states, whose in (("auv", run.truth, "true"), ("est", run.mean, "estimated")):
        if states is None:
            continue
        found |= {
            f"{prefix}_x": (along, states[..., 0], quantity("m", f"{whose} east of the AUV")),
            f"{prefix}_y": (along, states[..., 1], quantity("m", f"{whose} north of the AUV")),
            f"{prefix}_heading": (
                along,
                states[..., 2],
                quantity("rad", f"{whose} heading of the AUV, {CCW}"),
            ),
            f"{prefix}_speed": (
                along,
                states[..., 3],
                quantity(
                    "m s-1",
                    f"{whose} speed of the AUV through the water",
                    "platform_speed_wrt_sea_water",
                ),
            ),
        }
    found |= _own_states(run)
    ranges: Variables = {}
    found |= _smoothed(run)
    for b, beacon in enumerate(run.scenario.beacons):
        alone = len(run.ranges) == 1 and beacon.carrier is not None
        whom = "the aid vehicle" if alone else beacon.name
        about = f"measured {'squared ' * squared}range to {whom}"
        name = "range" if b == 0 else f"range_{b + 1}"
        ranges[name] = (along, run.ranges[b], quantity("m2" if squared else "m", about))
    located: Variables = {
        "est_lat": (along, est_lat, latitude("estimated latitude of the AUV")),
        "est_lon": (along, est_lon, longitude("estimated longitude of the AUV")),
        "covariance": ((*along, "state", "state_2"), run.covariance, _of_covariance(run)),
    }
    return found | located | ranges


def _of_covariance(run: Run) -> dict[str, Any]:
    """What is said of the covariance: its entries have different units."""
    units = dict.fromkeys(state.unit for state in own(run.scenario.filter_states))
    others = "".join(f", {unit}" for unit in units if unit not in ("m", "rad", "m s-1"))
    return {
        "long_name": "covariance of the estimate",
        "comment": f"entries in products of m (east, north), rad and m s-1{others}",
    }


def _own_states(run: Run) -> Variables:
    """States besides east, north, heading and speed, under their own names."""
    scenario, found = run.scenario, {}
    sides = (
        ("auv", run.truth, scenario.truth_states, "true"),
        ("est", run.mean, scenario.filter_states, "estimated"),
    )
    for prefix, values, states, whose in sides:
        if values is None:
            continue
        for i, (name, state) in enumerate(states.items()):
            if i >= BASIC:
                about = quantity(state.unit, f"{whose} {name} of the AUV")
                found[f"{prefix}_{name}"] = (("auv", "time"), values[..., i], about)
    return found


def _decisions(run: Run) -> Variables:
    flags = {
        "long_name": "how the decision came about",
        "flag_values": np.array([s.value for s in Status], dtype=np.int8),
        "flag_meanings": " ".join(s.label for s in Status),
    }
    condition = {
        "long_name": f"predicted condition number {run.condition_label}".strip(),
        "units": "1",
    }
    return {
        "condition": (("auv", "time"), run.condition, condition),
        "score": (
            ("time",),
            run.score,
            {"long_name": "the planner's own objective, in its own unit"},
        ),
        "status": (("time",), _flags(run.status), flags),
    }


def _derived(run: Run) -> Variables:
    along = ("auv", "time")
    bound = "root mean square position error by the posterior Cramer-Rao bound"
    if run.truth is None:
        return {}
    found: Variables = {
        "error": (along, run.error, quantity("m", "distance between true and estimated position")),
        "nees": (
            along,
            run.nees,
            quantity(
                "1", "normalised estimation error squared of the position, 2 degrees of freedom"
            ),
        ),
    }
    if not run.unbounded_below:
        found["pcrb"] = (along, np.sqrt(run.cramer_rao_variance), quantity("m", bound))
    if run.has_aid:
        about = quantity("m", "true horizontal distance between aid vehicle and AUV")
        found["separation"] = (along, run.separation, about)
    return found


def _smoothed(run: Run) -> Variables:
    """Where AUVs were by all of their ranges, and how many positions fitted at the time."""
    along, found = ("auv", "time"), {}
    if run.smoothed is not None:
        for k, (name, word) in enumerate((("x", "east"), ("y", "north"))):
            about = quantity("m", f"{word} of the AUV by all of its ranges")
            found[f"smoothed_{name}"] = (along, run.smoothed[..., k], about)
    if run.hypotheses is not None:
        about = quantity("1", "number of positions that fit")
        found["hypotheses"] = (along, run.hypotheses, about)
    return found


def _flags(status: Float[np.ndarray, " samples"]) -> Int8[np.ndarray, " samples"]:
    return np.where(np.isfinite(status), status, NO_DECISION).astype(np.int8)


def _latlon(run: Run, xy: Float[np.ndarray, "*n 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude [degrees] about the scenario's origin."""
    origin = run.scenario.table.origin
    latlon = geo.to_geographic(xy, (origin.lat, origin.lon))
    return latlon[..., 0], latlon[..., 1]
