"""What each column of a table that is written means; which columns there are the code says."""

from collections.abc import Sequence

from obsplan.campaign import layout
from obsplan.campaign import table as campaign
from obsplan.missions.writers import table as path
from obsplan.report import files, measurements, planned, ranged

TABLES: dict[str, Sequence[str]] = {
    "tracks": files.TRACK_COLUMNS,
    "aids": files.AID_COLUMNS,
    "planned": planned.PLANNED_COLUMNS,
    "ranges": ranged.RANGE_COLUMNS,
    "smoothed": ranged.SMOOTHED_COLUMNS,
    "measurements": measurements.COLUMNS,
    "path": path.COLUMNS,
    "campaign": (*campaign.LABELS, *campaign.REST),
    "figures": layout.FIGURES,
}

CNA = {
    "cna": "name of the aid vehicle",
    "cna_x_m": "aid vehicle: east of the origin [m]",
    "cna_y_m": "aid vehicle: north of the origin [m]",
    "cna_heading_rad": "aid vehicle: heading [rad], counter-clockwise from east",
    "cna_turn_rate_radps": "aid vehicle: turn rate until the next row [rad/s], left positive",
    "heading_rad": "heading [rad], counter-clockwise from east",
    "turn_rate_radps": "turn rate until the next row [rad/s], left positive",
    "speed_mps": "speed [m/s]; of a leg in the row where it ends",
}
AUV = {
    "auv": "name of the AUV",
    "auv_x_m": "where the AUV truly is, east [m]",
    "auv_y_m": "where the AUV truly is, north [m]",
    "auv_heading_rad": "its true heading [rad], counter-clockwise from east",
    "est_x_m": "where its filter believes it is, east [m]",
    "est_y_m": "where its filter believes it is, north [m]",
    "sigma_x_m": "standard deviation of the estimate, east [m]",
    "sigma_y_m": "standard deviation of the estimate, north [m]",
    "error_m": "distance from the true place to the estimate [m]",
    "range_m": "range measured at this instant [m]; empty between pings",
    "x_m": "east of the origin [m]",
    "y_m": "north of the origin [m]",
}
MEASURED = {
    "decided_s": "when the planner decided, seconds since the mission began",
    "time_s": "seconds since the mission began",
    "sent_s": "when the signal was sent, seconds since the mission began",
    "received_s": "when it was received, seconds since the mission began",
    "received": "when it was received, in UTC (ISO 8601), where the start is known",
    "beacon": "name of the aid vehicle or beacon; empty where none took part",
    "sensor": "what measured: range, bearing, speed",
    "value": "what was measured, in `unit`",
    "unit": "unit of `value`, `expected`, `innovation` and `sigma`",
    "expected": "what the filter expected, before it took this measurement",
    "innovation": "`value` less `expected`",
    "sigma": "standard deviation of the innovation, as the filter believes it",
    "nis": "innovation squared over its variance [-]; 1 on average if the filter is consistent",
    "fate": "what became of it, in the words below",
    "name": "name of the vehicle",
    "lat": "latitude [deg], WGS 84",
    "lon": "longitude [deg], WGS 84",
}
FIGURES = {
    "scenario": "name of the scenario",
    "planner": "name of the planner",
    "seed": "of all random numbers of the mission",
    "status": "`done` or `failed`",
    "error": "why a mission failed; empty if it did not",
    "status_counts": "how many decisions came about in which way, as JSON",
    "rms_error_m": "root mean square position error over the mission and all AUVs [m]",
    "rms_error_late_m": "the same after the first tenth of the mission [m]",
    "max_error_m": "greatest position error [m]",
    "mean_nees": "mean normalised estimation error squared [-]; 2 if the filter is consistent",
    "pcrb_rms_m": "posterior Cramér-Rao bound of the path flown, root mean square [m]",
    "pcrb_rms_late_m": "the same after the first tenth of the mission [m]",
    "separation_mean_m": "mean distance between aid vehicle and AUV [m]",
    "separation_max_m": "greatest distance between aid vehicle and AUV [m]",
    "violation_max_m": "by how much a limit was broken at most [m]; empty without limits",
}
MEANINGS = CNA | AUV | MEASURED | FIGURES
ELSEWHERE = {("campaign", "auv"): "the figures of each AUV, as JSON"}  # by table and column
