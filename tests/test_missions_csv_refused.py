"""Claims about tables that are refused, and about damaged ones."""

import csv

import numpy as np
import pytest
import shapely
from mission_files import (
    LAWN_LATLON,
    check_refused,
    check_survives_damage,
    read,
)
from table_files import (
    LAWN_WKT,
    LETTERED,
    comma,
    table,
)

DEGREES_AS_XY = r"columns 'X' and 'Y' look like degrees, \(10.4, 63.44\) first, not metres: head the longitudes \"lon\""
BAD = {
    "no coordinates": ("time,height\n1,2\n", r"line 1 must name the columns \"lat,lon\" or \"x,y\", got 'time,height'"),
    "blank cells": (",,\n,,\n", "line 1 must name the columns"),
    "half a pair": ("lat,y\n1,2\n", "must name the columns"),
    "heading only": ("lat,lon\n", "has a heading but no points"),
    "comments only": ("# lat,lon\n", "has a heading but no points"),
    "short row": ("lat,lon\n1,2\n3\n", "line 3 has too few columns, 1 of the heading's 2"),
    "row without its name": ("lat,lon,name\n1,2,a\n3,4,a\n5,6\n", "line 4 has too few columns, 2 of the heading's 3"),
    "decimal commas between commas": ("lat,lon\n63,44,10,40\n", "line 2 has too many columns, 4 for the heading's 2: quote"),
    "not a number": ("x,y\n1,2\n\n3,north\n", "line 4, column 'y', must be a number, got 'north'"),
    "underscore": ("lat,lon\n1_0,2\n10,2.001\n", "line 2, column 'lat', must be a number, got '1_0'"),
    "thousands": ("x;y\n1,200.5;3\n", "column 'x', must be a number, got '1,200.5'"),
    "nan": ("x,y\n1,nan\n", "line 2, column 'y', must be a finite number, got nan"),
    "huge": ("x,y\n1," + "2" * 200_000, "line 2, column 'y', must be a finite number, got inf"),
    "half a place": ("lat,lon\n1,\n", "column 'lon', must be a number, got ''"),
    "swapped": ("lat,lon\n-122.3,47.6\n", "line 2 has latitude -122.3 .*look swapped: exchange the headings"),
    "letters swapped": ("lat,lon\n10E,63N\n", "column 'lat', must be north or south, got the letter 'E': exchange"),
    "letter and sign": ("lat,ns,lon,ew\n-63,S,10,E\n", "column 'lat', is negative and S: leave one of them out"),
    "sixty minutes": ("lat,lat_min,lon,lon_min\n63,61,10,0\n", "column 'lat_min', must be 0 to 60 beside whole degrees, got 61.0"),
    "west positive": ("Latitude,Longitude (W)\n63,10\n", r"line 1 has 'Longitude \(W\)' in a unit that is not read: give degrees"),
    "utm": ("x,y\n550000,5275000\n", r"line 2 has \(550000.0, 5275000.0\) m, more than 100 km .*UTM"),
    "degrees in metres": ("Y;X;Z\n63.44;10.4;0\n63.448;10.4;0\n63.448;10.406;0\n", DEGREES_AS_XY),
    "degrees near zero": ("x,y\n0.001,0.002\n0.003,0.002\n", "columns 'x' and 'y' look like degrees"),
    "unclear numbers": ("0,0\n0,3\n2,3\n", "has no heading, and its numbers may be degrees or metres: add a heading"),
    "many numbers": ("1.5,2.5,3.5,4.5\n", "has no heading and 4 columns of numbers: add a heading"),
    "identical rows": ("x,y\n1,2\n1,2\n", "holds no line to follow .track \"a\" has a single place"),
    "open quote": ('lat,lon,name\n1,2,"a\n3,4,b\n', "line 2 is not CSV .unexpected end of data.: export"),
    "no wkt": ("id,geometry\n1,0102000020E6\n", "line 1 has a column 'geometry' without WKT: export it as WKT"),
    "bad wkt": ("wkt\nLINESTRING (1 2)\nLINESTRING (\n", "line 2, column 'wkt', is no WKT, got 'LINESTRING .1 2.'"),
    "wkt of utm": ('wkt\n"SRID=32632;LINESTRING (1 2, 3 4)"\n', "is in EPSG:32632, not WGS 84"),
    "wkt far": ('wkt\n"LINESTRING (550000 5275000, 3 4)"\n', "more than 100 km .*UTM"),
    "picture": (b"\x89PNG\r\n\x1a\n\x00\x01", r"not UTF-8 text \(byte 0x89 at position 0\): it is not what its extension says"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_table_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(
    tmp_path, case
):
    check_refused(tmp_path, "a.csv", *BAD[case])


def test_a_small_survey_in_metres_about_its_origin_is_not_taken_for_degrees(tmp_path):
    pool = [(0, 0), (0, 3), (2, 3)]
    np.testing.assert_array_equal(
        read(tmp_path, "a.csv", table("x,y", pool)).tracks["a"].points, pool
    )


@pytest.mark.parametrize(
    "content",
    [
        table("name,lat,lon,depth,time", [("q", *p, 5, i) for i, p in enumerate(LAWN_LATLON)]),
        table("nr;lat;lon", [(i, comma(a), comma(b)) for i, (a, b) in enumerate(LAWN_LATLON)], ";"),
        table("lat|lon", LETTERED, "|"),
        table(
            "name;WKT",
            [("q", LAWN_WKT), ("fence", shapely.box(10.4, 63.44, 10.402, 63.441).wkt)],
            ";",
        ),
        table(None),
    ],
)
def test_a_damaged_table_gives_a_mission_or_our_error(tmp_path, content):
    limit = csv.field_size_limit()
    check_survives_damage(tmp_path, "a.csv", content.encode())
    assert csv.field_size_limit() == limit


def test_more_lines_than_a_mission_has_are_refused_at_once(tmp_path):
    check_refused(
        tmp_path,
        "a.csv",
        "x,y\n" + "1,2\n" * 400_001,
        "has more than 400000 lines: export the mission",
    )
