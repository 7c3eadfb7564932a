"""Pages as files: their size, what is read back, and what `obsplan report` refuses."""

import base64
import json
import re

import numpy as np
import pytest
from oracles import scenario

import obsplan as op
from obsplan.cli.reports import page_of, report, side_by_side, written
from obsplan.report import write_run
from obsplan.report.page.folder import read_run
from obsplan.report.page.missions import campaign_page, scenario_of
from obsplan.report.page.pack import as_script
from obsplan.report.page.run import run_page
from obsplan.simulation import simulate
from obsplan.types import ObsplanError

pytestmark = pytest.mark.xdist_group("page_files")  # they share a run's folder
SEA = {"ranging__loss": 0.3, "auv__0__name": "=sum('<b>')"}


@pytest.fixture(scope="module")
def run():
    return simulate(scenario(**SEA), seed=4)


@pytest.fixture(scope="module")
def folder(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("page_files") / "run"
    write_run(run, path, exports=(), notes=["A sentence."])
    return path


def data_of(page):
    """What the page's scripts read, by a JSON reader."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, flags=re.DOTALL).group(1))


def numbers(packed):
    return np.frombuffer(base64.b64decode(packed["f4"]), dtype="<f4")


def test_run_is_read_back_from_its_folder(run, folder):
    read = read_run(folder)
    for name in ("time", "cna", "truth", "mean", "covariance", "ranges", "status", "score"):
        np.testing.assert_array_equal(getattr(read, name), getattr(run, name))
    assert read.names == run.names
    np.testing.assert_array_equal(read.ranged.fate, run.ranged.fate)
    np.testing.assert_allclose(read.ranged.innovation, run.ranged.innovation, atol=2e-6)


def test_page_of_a_folder_plays_what_that_of_the_run_plays(run, folder):
    one, other = data_of(run_page(run)), data_of(page_of(folder))
    assert one["panels"][:3] == other["panels"][:3]
    assert one["scenes"][0]["auvs"] == other["scenes"][0]["auvs"]
    pings = one["scenes"][0]["pings"]
    came = np.isfinite(run.ranges).sum()
    assert np.isfinite(numbers(pings["columns"]["value"])).sum() == came
    assert numbers(pings["columns"]["t"]).size == 2 * 10  # two AUVs, every 2 s of 20 s, lost or not


def coast(path, geometries):
    """A chart, by hand."""
    features = [{"type": "Feature", "properties": {}, "geometry": one} for one in geometries]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_chart_is_drawn_where_it_is_near_and_cut_where_it_is_not(tmp_path):
    equator = simulate(scenario(origin={"lat": 0.0, "lon": 1.0}, duration=4.0), seed=4)
    folder = tmp_path / "run"
    write_run(equator, folder, exports=())
    north = [[1.0, -1.0], [1.0, 1.0]]  # straight through the origin
    elsewhere = [[[[50.0, 50.0], [51.0, 50.0], [51.0, 51.0], [50.0, 50.0]]]]
    given = [
        {"type": "LineString", "coordinates": [[1.0, k / 1000] for k in range(-400, 401)]},
        {"type": "MultiPolygon", "coordinates": elsewhere},
        {"type": "Point", "coordinates": [1.0, 0.0]},
    ]
    data = data_of(page_of(folder, [coast(tmp_path / "coast.geojson", given)]))
    (drawn,) = data["chart"]
    x, y = numbers(drawn["x"]), numbers(drawn["y"])
    np.testing.assert_allclose(x, 0.0, atol=1e-3)
    assert y.min() < data["scenes"][0]["low"][1] < data["scenes"][0]["high"][1] < y.max()
    assert np.ptp(y) < 8 * np.ptp([*data["scenes"][0]["low"], *data["scenes"][0]["high"]])
    assert any("coast.geojson" in note for note in data["notes"])
    far = coast(tmp_path / "far.geojson", [{"type": "LineString", "coordinates": north}])
    data = data_of(page_of(folder, [far]))  # its only vertices are 111 km away
    assert data["chart"] == []
    assert any("Nothing of far.geojson" in note for note in data["notes"])


def test_chart_without_a_place_on_earth_or_of_a_campaign_is_refused(tmp_path):
    there = coast(tmp_path / "coast.geojson", [])
    nowhere = simulate(scenario(origin={"lat": 0.0, "lon": 0.0}, duration=2.0), seed=4)
    write_run(nowhere, tmp_path / "run", exports=())
    with pytest.raises(ObsplanError, match="no origin"):
        page_of(tmp_path / "run", [there])
    (tmp_path / "campaign.sqlite").touch()
    with pytest.raises(ObsplanError, match="leave --chart out"):
        written(tmp_path, [there])


def test_runs_side_by_side_are_read_once_each_and_share_a_chart(folder, tmp_path, monkeypatch):
    read = []
    monkeypatch.setattr(
        "obsplan.report.page.folder.read_run", lambda path: read.append(path) or read_run(path)
    )
    line = {"type": "LineString", "coordinates": [[-122.301, 47.6], [-122.299, 47.6]]}
    charts = [coast(tmp_path / f"{name}.geojson", [line]) for name in ("coast", "depths")]
    side_by_side([folder, folder], tmp_path / "page.html", charts)
    assert read == [folder, folder]
    data = data_of((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert len(data["chart"]) == 2
    assert [note.split(",")[0] for note in data["notes"] if "The chart is" in note] == [
        "The chart is coast.geojson",
        "The chart is depths.geojson",
    ]


def test_a_mission_flown_again_takes_no_chart_and_no_file_for_its_page(folder, tmp_path):
    for beside in ({"charts": [tmp_path / "c.geojson"]}, {"out": tmp_path / "page.html"}):
        with pytest.raises(ObsplanError, match="leave --out and --chart out"):
            report([folder], mission="1/4", **beside)


def test_no_text_ends_the_element_that_holds_the_data():
    text = "</script><script>alert(1)</script><!--&\u2028"
    assert not set("<>&\u2028") & set(as_script({"name": text}))
    assert json.loads(as_script({"name": text})) == {"name": text}


@pytest.mark.slow
@pytest.mark.parametrize(("hours", "most"), [(0.5, 8e6), (24, 15e6)])
def test_page_stays_small_and_says_what_is_thinned(hours, most):
    there_and_back = [[0.0, 0.0], [900.0, 0.0], [900.0, 20.0], [0.0, 20.0]] * 100
    keys = {"kind": "waypoints", "points": there_and_back}
    change = {f"auv__{i}__survey": keys for i in range(2)}
    long = scenario(
        duration=hours * 3600.0, planner__kind="circle", ranging__interval=15.0, **change
    )
    flown = simulate(long, seed=1)
    page = run_page(flown)
    assert len(page.encode()) < most
    assert ("one sample in" in page) == (hours > 1)
    scene = data_of(page)["scenes"][0]
    track = np.column_stack([numbers(scene["aids"][0]["track"][axis]) for axis in "xy"])
    for axis in range(2):  # thinning keeps where it was, to half a pixel
        assert np.ptp(track[:, axis]) == pytest.approx(np.ptp(flown.cna[:, axis]), abs=1.0)


def test_what_is_no_run_is_refused_with_a_remedy(folder, tmp_path):
    with pytest.raises(ObsplanError, match=r"has no scenario.toml: give the folder of a run"):
        written(tmp_path)
    (tmp_path / "compare.csv").write_text("planner\n")
    with pytest.raises(ObsplanError, match="run `obsplan compare` again"):
        written(tmp_path)
    with pytest.raises(ObsplanError, match=r"a page ends in \.html"):
        side_by_side([folder], tmp_path / "page")
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "scenario.toml").write_bytes((folder / "scenario.toml").read_bytes())
    (broken / "tracks.nc").write_bytes((folder / "tracks.nc").read_bytes()[:999])
    with pytest.raises(ObsplanError, match=r"tracks.nc cannot be read"):
        written(broken)


@pytest.mark.slow
def test_campaign_page_has_each_mission_and_names_it_so_that_it_flies_again(tmp_path):
    from obsplan.campaign import fly_campaign, plan_cells

    cells = plan_cells(["survey-slow"], planners=["circle", "trail"], runs=2, seed=5)
    fly_campaign(cells, tmp_path, workers=1)
    data = data_of(campaign_page(tmp_path))
    assert data["seeds"] == [5, 6, 5, 6]
    errors, cell = numbers(data["figures"][0]), numbers(data["cells"]).astype(int)
    again, seed = scenario_of(tmp_path, f"{cell[1]}/6")
    assert simulate(again, seed=seed).rms_error == pytest.approx(errors[1], rel=1e-6)
    with pytest.raises(ObsplanError, match="has no such mission"):
        scenario_of(tmp_path, f"{cell[1]}/99")
    with pytest.raises(ObsplanError, match="CELL/SEED"):
        scenario_of(tmp_path, "x")


def test_notebook_shows_the_page_in_a_frame_that_reaches_nothing_else(run):
    shown = run.animate()._repr_html_()
    assert shown.startswith('<iframe sandbox="allow-scripts"')
    assert "<script" not in shown
    assert "<script" in op.Run.animate(run).page
