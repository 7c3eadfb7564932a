"""Tables of points for tests."""

import shapely
from mission_files import LAWN_LATLON


def table(heading, rows=LAWN_LATLON, delimiter=",", end="\n"):
    """A table of rows."""
    lines = [delimiter.join(str(cell) for cell in row) for row in rows]
    return end.join(([heading] if heading else []) + lines) + end


def rows_with(*columns):
    """The lawnmower's places with further columns."""
    return [(*place, *more) for place, *more in zip(LAWN_LATLON, *columns, strict=True)]


def comma(number):
    """A number with a decimal comma."""
    return f"{number:.8f}".replace(".", ",")


def minutes(angle, letters, form="{}°{:.6f}'{}"):
    """An angle in degrees, minutes and a letter."""
    degrees = int(abs(angle))
    return form.format(degrees, (abs(angle) - degrees) * 60, letters[angle < 0])


LETTERED = [(minutes(lat, "NS"), minutes(lon, "EW")) for lat, lon in LAWN_LATLON]
BLANKS = "{} {:.6f} {}"
BLANKED = [(minutes(lat, "NS", BLANKS), minutes(lon, "EW", BLANKS)) for lat, lon in LAWN_LATLON]
LONLAT = [(lon, lat) for lat, lon in LAWN_LATLON]
EAST = [(lat, lon + 110) for lat, lon in LAWN_LATLON]
LAWN_WKT = shapely.LineString(LONLAT).wkt
WITH_UNITS = "\ufeffLatitude_deg, Longitude (deg)\r\n\r\n , \r\n"
