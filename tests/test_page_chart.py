"""Rasters under the map of a page: where they are drawn, in which colours, and what is refused."""

import sqlite3
import sys

import numpy as np
import pymap3d
import pytest
from charts import SEATTLE, decoded, frame, geotiff, grid, mbtiles, place_of
from PIL import Image

from obsplan.report.page.chart import chart_of
from obsplan.types import ObsplanError

rasterio = pytest.importorskip("rasterio")
from rasterio.transform import Affine  # noqa: E402
from rasterio.warp import transform  # noqa: E402

NODATA = -9999.0


def drawn(path, where=None):
    """The one picture of a chart, and its note."""
    chart = chart_of([path], [where or frame()])
    (picture,), (note,) = chart.pictures, chart.notes
    assert path.name in note
    assert "Planners know nothing of it." in note
    return picture, note


def utm():
    """East and north of Seattle in UTM zone 10 [m]."""
    return (one[0] for one in transform("EPSG:4326", "EPSG:32610", [SEATTLE[1]], [SEATTLE[0]]))


def in_utm(step=2.0, size=1200):
    """A grid about Seattle."""
    east, north = utm()
    return grid(east - step * size / 2, north + step * size / 2, step)


def turned():
    """The same by 30 degrees, about its middle."""
    about = Affine.translation(*utm()) @ Affine.rotation(30)
    return about @ Affine.scale(2, -2) @ Affine.translation(-600, -600)


AROUND = np.pi * 6_378_137.0
WEB = 2 * AROUND / 4_000_000  # about 10 m
WIDE = 360 / 3_600_000  # degrees, about 11 m
PLACED = {
    "UTM": ("EPSG:32610", in_utm(), (1200, 1200), (500, 700), SEATTLE),
    "UTM, turned": ("EPSG:32610", turned(), (1200, 1200), (500, 700), SEATTLE),
    "degrees": (
        "EPSG:4326",
        grid(-122.32, 47.62, 2e-5),
        (2000, 2000),
        (1100, 900),
        SEATTLE,
    ),
    "south up": (
        "EPSG:4326",
        Affine(2e-5, 0, -122.32, 0, 2e-5, 47.58),
        (2000, 2000),
        (1100, 900),
        SEATTLE,
    ),
    "-180 to 180, its first column": (
        "EPSG:4326",
        grid(-180, 0.01, WIDE),
        (200, 3_600_000),
        (101, 9),
        (0.0, 179.9999),
    ),
    "-180 to 180, its last column": (
        "EPSG:4326",
        grid(-180, 0.01, WIDE),
        (200, 3_600_000),
        (101, 3_599_990),
        (0.0, -179.9999),
    ),
    "0 to 360": (
        "EPSG:4326",
        grid(0, 0.01, WIDE),
        (200, 3_600_000),
        (101, 2_380_020),
        (0.0, -122.0),
    ),
    "179.9 to 180.1": (
        "EPSG:4326",
        grid(179.9, 0.01, WIDE),
        (200, 2000),
        (101, 1010),
        (0.0, -179.9999),
    ),
    "Web Mercator at 180": (
        "EPSG:3857",
        grid(-AROUND, 100 * WEB, WEB),
        (200, 4_000_000),
        (99, 20),
        (0.0, 180.0),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLACED)
def test_a_marked_pixel_is_drawn_where_it_is_on_earth(name, tmp_path):
    crs, there, shape, (row, column), origin = PLACED[name]
    values = np.zeros((1, *shape), dtype="uint8")
    values[0, row - 4 : row + 5, column - 4 : column + 5] = 255
    path = geotiff(tmp_path / "mark.tif", values, crs, there, compress="deflate", tiled=True)
    east, north = there @ (column + 0.5, row + 0.5)
    lon, lat = (one[0] for one in transform(crs, "EPSG:4326", [east], [north]))
    picture, _ = drawn(path, frame(origin))
    light = decoded(picture)
    found = place_of(picture, light[..., 0] * (light[..., 3] > 0))
    pixel = picture["w"] / light.shape[1]
    want = pymap3d.geodetic2enu(lat, lon, 0.0, *origin, 0.0)[:2]
    np.testing.assert_allclose(found, want, atol=max(0.5 * pixel, 1.0))
    plane = f"+proj=ortho +lat_0={origin[0]} +lon_0={origin[1]} +datum=WGS84"  # PROJ's own
    proj = [one[0] for one in transform(crs, plane, [east], [north])]
    np.testing.assert_allclose(found, proj, atol=max(0.5 * pixel, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("origin", [SEATTLE, (0.0, 179.999)])
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_a_tile_is_drawn_where_it_is_on_earth(kind, origin, tmp_path):
    zoom = 17
    n = 2**zoom
    lat, lon = np.radians(origin)
    column = int((lon / np.pi + 1) / 2 * n)
    row = int((1 - np.log(np.tan(lat) + 1 / np.cos(lat)) / np.pi) / 2 * n)
    places = [(column + i, row + j) for i in range(-3, 4) for j in range(-3, 4)]
    tiles = {(zoom, i % n, j): Image.new("RGB", (256, 256), "black") for i, j in places}
    tiles[zoom, (column + 1) % n, row - 1] = Image.new("RGB", (256, 256), "white")
    picture, note = drawn(mbtiles(tmp_path / "c.mbtiles", tiles, kind=kind), frame(origin, 300.0))
    assert "zoom 17" in note
    seen = decoded(picture)
    angle = np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * (row - 0.5) / n))))
    want = pymap3d.geodetic2enu(angle, (column + 1.5) / n * 360 - 180, 0.0, *origin, 0.0)[:2]
    np.testing.assert_allclose(place_of(picture, seen[..., 0] * (seen[..., 3] > 0)), want, atol=1.0)


def test_where_a_level_has_no_tile_the_coarser_one_is_seen(tmp_path):
    tiles = {}
    for zoom, colour in ((15, "red"), (17, "blue")):
        n = 2**zoom
        lat, lon = np.radians(SEATTLE)
        column = int((lon / np.pi + 1) / 2 * n)
        row = int((1 - np.arcsinh(np.tan(lat)) / np.pi) / 2 * n)
        reach = range(-1, 2) if zoom == 15 else range(1)
        tiles |= {
            (zoom, column + i, row + j): Image.new("RGB", (512, 512), colour)
            for i in reach
            for j in reach
        }
    picture, note = drawn(mbtiles(tmp_path / "c.mbtiles", tiles), frame(half=400.0))
    red, _, blue, alpha = np.moveaxis(decoded(picture), -1, 0)
    assert alpha.min() == 255
    tile = 2 * AROUND * np.cos(np.radians(SEATTLE[0])) / 2**17  # [m]
    assert (blue > 200).mean() == pytest.approx((tile / 1600) ** 2, rel=0.03)
    assert (red > 200).mean() > 0.5
    assert "zoom 15 to 17" in note


def depths(path, values, **more):
    """A square of numbers about Seattle, 24 m a pixel."""
    values = np.asarray(values, dtype="float32")
    there = in_utm(step=2400 / values.shape[1], size=values.shape[1])
    return geotiff(path, values[None], "EPSG:32610", there, **more)


def test_numbers_are_coloured_in_order_and_what_is_not_known_is_left_out(tmp_path):
    values = np.tile(np.linspace(-30.0, -10.0, 100), (100, 1))
    values[:50] = NODATA
    picture, note = drawn(depths(tmp_path / "d.tif", values, nodata=NODATA, units="metre"))
    seen = decoded(picture)
    alpha = seen[..., 3]
    rows = alpha.shape[0]
    assert alpha[: int(0.48 * rows)].max() == 0
    assert alpha[int(0.52 * rows) :].min() == 255
    light = seen[int(0.75 * rows), :, :3] @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(light[::40]) > 0)  # lighter with every step
    low, high = (
        float(one.replace("−", "-")) for one in note.split("Colours go from ")[1].split(" ")[:3:2]
    )
    assert -29 < low < -27  # of what is drawn: ±1000 m of ±1200, without 1 % at either end
    assert -13 < high < -11
    assert f"{picture['key']['text']}".endswith(" m")
    assert len(set(picture["key"]["colours"])) > 8
    assert "does not say" not in note


def test_land_is_grey_and_water_is_not(tmp_path):
    values = np.tile(np.linspace(-30.0, 10.0, 100), (100, 1))
    picture, note = drawn(depths(tmp_path / "d.tif", values))
    seen = decoded(picture)[100]
    grey = np.ptp(seen[:, :3], axis=1) == 0
    east = picture["x"] + picture["w"] * (np.arange(grey.size) + 0.5) / grey.size
    shore = -1200 + 2400 * (30.0 / 40.0)  # where 0 is
    assert grey[east > shore + 30].all()
    assert not grey[east < shore - 30].any()
    assert "grey" in note
    assert "in a unit that the file does not say" in note
    assert "names no value that stands for nothing measured" in note


def test_numbers_are_scaled_as_the_file_says(tmp_path):
    path = depths(tmp_path / "d.tif", np.tile(np.arange(100.0), (100, 1)))
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (0.1,), (-50.0,)
    _, note = drawn(path)
    assert "drawn values are between −49" in note


def test_one_wild_number_does_not_set_the_colours(tmp_path):
    values = np.tile(np.linspace(-30.0, -10.0, 100), (100, 1))
    values[50, 50] = -1e30
    values[52, 50] = np.nan
    picture, note = drawn(depths(tmp_path / "d.tif", values))
    assert "-1e+30" in note.replace("−", "-") or "e+" in note
    assert "Colours go from −2" in note
    assert (decoded(picture)[..., 3] == 0).any()  # nan is nothing


def test_a_palette_and_transparent_bands_keep_their_colours(tmp_path):
    index = np.tile(np.repeat([0, 1], 50), (100, 1)).astype("uint8")
    palette = {0: (10, 200, 30, 255), 1: (250, 20, 60, 255), 2: (0, 0, 0, 0)}
    there = in_utm(step=24.0, size=100)
    seen = decoded(
        drawn(geotiff(tmp_path / "p.tif", index[None], "EPSG:32610", there, palette=palette))[0]
    )
    np.testing.assert_array_equal(seen[100, 20], palette[0])
    np.testing.assert_array_equal(seen[100, -20], palette[1])
    bands = np.stack([index * 100 + 50, index * 0 + 7, index * 0 + 90, 255 * index])
    path = geotiff(
        tmp_path / "c.tif",
        bands.astype("uint8"),
        "EPSG:32610",
        there,
        photometric="RGB",
        alpha="YES",
    )
    seen = decoded(drawn(path)[0])
    assert seen[100, 20, 3] == 0
    np.testing.assert_array_equal(seen[100, -20], [150, 7, 90, 255])


@pytest.mark.slow
def test_pictures_of_noise_are_made_small_and_that_is_said(tmp_path):
    noise = np.random.default_rng(1).integers(0, 256, (3, 2000, 2000), dtype="uint8")
    paths = [
        geotiff(tmp_path / f"{k}.tif", noise, "EPSG:32610", in_utm(1.0, 2000)) for k in range(2)
    ]
    chart = chart_of(paths, [frame()])
    for picture, note in zip(chart.pictures, chart.notes, strict=True):
        assert len(picture["url"]) < 1_500_000 / 2 + 100
        pixel = float(note.split("a pixel every ")[1].split(" ")[0])
        assert pixel == pytest.approx(picture["w"] / decoded(picture).shape[1], rel=0.02)
        assert pixel > 1.3
        assert "in 255 colours; the file has one every 1 m" in note


@pytest.mark.parametrize(("origin", "values"), [((47.0, -122.3), 1.0), (SEATTLE, NODATA)])
def test_what_is_far_or_empty_is_said_to_be_so(origin, values, tmp_path):
    path = depths(tmp_path / "d.tif", np.full((50, 50), values), nodata=NODATA)
    chart = chart_of([path], [frame(origin)])
    assert chart.pictures == []
    assert chart.notes == ["Nothing of d.tif is near the mission: no chart is drawn."]


def test_of_a_huge_file_its_overviews_are_read_or_it_is_refused(tmp_path, monkeypatch):
    path = geotiff(
        tmp_path / "huge.tif",
        np.full((1, 2400, 2400), 9, dtype="uint8"),
        "EPSG:32610",
        in_utm(1.0, 2400),
        tiled=True,
    )
    monkeypatch.setattr("obsplan.report.page.geotiff.MOST_READ", 1e6)
    monkeypatch.setattr("obsplan.report.page.raster.MOST_PIXELS", 500)
    with pytest.raises(ObsplanError, match=r"4 million pixels about the mission.*gdaladdo"):
        drawn(path)
    with rasterio.open(path, "r+") as file:
        file.build_overviews([2, 4])
    assert decoded(drawn(path)[0])[..., 0].min() == 9


def blocks(path):
    values = np.zeros((1, 20_000, 20_000), dtype="uint8")
    return geotiff(
        path,
        values,
        "EPSG:32610",
        in_utm(),
        compress="deflate",
        tiled=True,
        blockxsize=20_000,
        blockysize=20_000,
    )


REFUSED = {
    "no CRS": (
        lambda p: geotiff(p, np.zeros((1, 9, 9), "uint8"), None, in_utm()),
        "where on Earth",
    ),
    "no grid": (
        lambda p: geotiff(p, np.zeros((1, 9, 9), "uint8"), "EPSG:32610", Affine.identity()),
        "where on Earth",
    ),
    "one block": (blocks, "blocks of 400 MB.*TILED=YES"),
    "16 bits": (
        lambda p: geotiff(
            p, np.zeros((3, 9, 9), "uint16"), "EPSG:32610", in_utm(), photometric="RGB"
        ),
        "bands of uint16 .red, green, blue.: export it as a picture of 8 bits",
    ),
    "complex": (
        lambda p: geotiff(p, np.zeros((1, 9, 9), "complex64"), "EPSG:32610", in_utm()),
        "bands of complex64",
    ),
}


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize("name", REFUSED)
def test_a_geotiff_that_cannot_be_drawn_is_refused_with_a_remedy(name, tmp_path):
    write, said = REFUSED[name]
    with pytest.raises(ObsplanError, match=f"d.tif.*{said}"):
        chart_of([write(tmp_path / "d.tif")], [frame()])


TILE = Image.new("RGB", (256, 256), "red")


@pytest.mark.parametrize(
    ("tiles", "told", "said"),
    [
        ({}, {}, "has no tiles"),
        ({(1, 0, 0): b"\x1f\x8b"}, {"format": "pbf"}, "vector tiles .pbf."),
        ({(0, 0, 0): b"GIF89a"}, {}, "the tile 0/0/0 is no picture"),
        ({(0, 0, 0): "text"}, {}, "the tile 0/0/0 cannot be read"),
        ({(0, 0, 0): Image.new("1", (4096, 4096))}, {}, "no tile is wider"),
        ({(40, 0, 0): TILE}, {}, "zoom is 0 to 30"),
    ],
)
def test_mbtiles_that_cannot_be_drawn_are_refused_with_a_remedy(tiles, told, said, tmp_path):
    with pytest.raises(ObsplanError, match=f"c.mbtiles.*{said}"):
        chart_of([mbtiles(tmp_path / "c.mbtiles", tiles, told=told)], [frame()])


ENDLESS = (
    "WITH RECURSIVE n(i) AS (VALUES (0) UNION ALL SELECT i + 1 FROM n) SELECT 1, i, 0, 0 FROM n"
)


def test_a_database_that_never_answers_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr("obsplan.report.page.mbtiles.PATIENCE", 0.5)
    path = tmp_path / "c.mbtiles"
    database = sqlite3.connect(path)
    database.execute(
        f"CREATE VIEW tiles (zoom_level, tile_column, tile_row, tile_data) AS {ENDLESS}"
    )
    database.close()
    with pytest.raises(ObsplanError, match=r"cannot be read as MBTiles \(interrupted\)"):
        chart_of([path], [frame()])


def test_nothing_beside_a_geotiff_is_read(tmp_path):
    path = geotiff(tmp_path / "d.tif", np.zeros((1, 50, 50), "uint8"), None, in_utm())
    said = "<PAMDataset><SRS>EPSG:32610</SRS></PAMDataset>"  # what gives it a place elsewhere
    (tmp_path / "d.tif.aux.xml").write_text(said)
    with rasterio.open(path) as file:
        assert file.crs is not None
    with pytest.raises(ObsplanError, match=r"files beside it \(.tfw, .aux.xml\) are not read"):
        chart_of([path], [frame()])
    assert sorted(one.name for one in tmp_path.iterdir()) == ["d.tif", "d.tif.aux.xml"]


def test_tables_of_other_files_are_not_opened(tmp_path):
    (tmp_path / "other.csv").write_text("zoom_level,tile_column,tile_row,tile_data\n1,0,0,x\n")
    path = tmp_path / "c.mbtiles"
    database = sqlite3.connect(path)
    database.execute("PRAGMA writable_schema = 1")
    table = f"CREATE VIRTUAL TABLE tiles USING VirtualOGR('{tmp_path}/other.csv', 0, 'other')"
    row = ("table", "tiles", "tiles", 0, table)
    database.execute("INSERT INTO sqlite_master VALUES (?, ?, ?, ?, ?)", row)
    database.commit()
    database.close()
    with pytest.raises(ObsplanError, match=r"cannot be read as MBTiles \(no such module"):
        chart_of([path], [frame()])


def test_what_is_no_chart_is_refused_by_what_it_is_and_not_by_its_name(tmp_path):
    path = tmp_path / "chart.vrt"
    path.write_text("<VRTDataset/>")
    with pytest.raises(ObsplanError, match=r"GeoTIFF \(.tif\), MBTiles \(.mbtiles\), lines of"):
        chart_of([path], [frame()])
    named = path.rename(tmp_path / "chart.tif")  # what would open other files
    with pytest.raises(ObsplanError, match="cannot be read as a GeoTIFF"):
        chart_of([named], [frame()])
    with pytest.raises(ObsplanError, match=r"is no file"):
        chart_of([tmp_path], [frame()])
    with pytest.raises(ObsplanError, match=r"does not exist"):
        chart_of([tmp_path / "none.tif"], [frame()])
    tiles = mbtiles(tmp_path / "t", {(0, 0, 0): TILE})
    assert drawn(tiles.rename(tmp_path / "tiles.json"))


def test_without_rasterio_tiles_are_drawn_and_a_geotiff_says_what_to_install(tmp_path, monkeypatch):
    path = depths(tmp_path / "d.tif", np.ones((50, 50)))
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(ObsplanError, match=r"install it by: pip install 'obsplan\[charts\]'"):
        chart_of([path], [frame()])
    assert drawn(mbtiles(tmp_path / "c.mbtiles", {(0, 0, 0): TILE}))


def test_runs_with_different_origins_take_no_chart(tmp_path):
    path = depths(tmp_path / "d.tif", np.ones((50, 50)))
    with pytest.raises(ObsplanError, match="different origins"):
        chart_of([path], [frame(), frame((47.6, -122.0))])
    assert chart_of([path, path], [frame(), frame(half=300.0)]).pictures[0]["w"] == 2000.0
