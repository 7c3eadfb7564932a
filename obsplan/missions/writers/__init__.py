"""Mission files out, one format a file."""

from obsplan.missions.writers.geojson import write_geojson
from obsplan.missions.writers.gpx import write_gpx
from obsplan.missions.writers.kml import write_kml
from obsplan.missions.writers.moos import write_moos
from obsplan.missions.writers.plan import write_plan
from obsplan.missions.writers.table import write_csv
from obsplan.missions.writers.waypoints import write_waypoints

__all__ = [
    "write_csv",
    "write_geojson",
    "write_gpx",
    "write_kml",
    "write_moos",
    "write_plan",
    "write_waypoints",
]
