"""report.html in a real browser, without a network: one mission with hostile names, played back."""

import io
import re
from dataclasses import replace

import numpy as np
import pymap3d
import pytest
from browser import chromium, complaints, opened, requests, wait
from charts import geotiff, grid
from oracles import scenario
from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from obsplan.report.page.chart import chart_of, surroundings
from obsplan.report.page.run import run_page
from obsplan.simulation import simulate

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("page")]  # they share a browser
HOSTILE = "<script>window.hurt = 1</script>\"'$x$</title>&amp;🐟 "
LONG = HOSTILE + "w" * (120 - len(HOSTILE))  # no name is longer
SEA = {
    "ranging__loss": 0.3,
    "constraints": {"max_separation": 90.0, "keep_out": [{"x": 40, "y": 40, "radius": 9}]},
}


@pytest.fixture(scope="module")
def run():
    return simulate(scenario(auv__0__name=HOSTILE.strip(), auv__1__name=LONG, **SEA), seed=2)


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(run_page(run, [f"A note on {LONG}{'w' * 300}."]), encoding="utf-8")
    browser = chromium()
    try:
        opened(browser, path)
        yield browser
    finally:
        browser.quit()


def seek(page, t):
    page.execute_script("player.seek(arguments[0])", t)


def press(page, *keys):
    ActionChains(page).send_keys(*keys).perform()


PAUSED = """
if (player.state.t <= 5) return null;
if (player.state.playing) document.getElementById("play").click();
return [player.state.t, player.panels.map((one) => one.cursor.location)];
"""  # at once: on a loaded machine the mission is over before a click arrives


def at(page):
    return page.execute_script("return player.state.t")


def shown(page, source):
    """Columns of what is drawn on the map now."""
    script = (
        "const found = player.maps[0][arguments[0]].data;"
        "return Object.fromEntries(Object.entries(found).map(([k, v]) => [k, [...v]]))"
    )
    return page.execute_script(script, source)


def test_page_opens_from_disk_without_a_request_or_a_complaint(page):
    asked = {url.split(":")[0] for url in requests(page)}
    assert asked <= {"file", "data", "blob"}
    assert complaints(page) == []


def test_play_moves_vehicles_and_every_cursor_to_the_same_time(page, run):
    seek(page, 0.0)
    before = shown(page, "vehicles")
    page.find_element("id", "play").click()
    t, cursors = wait(page, PAUSED)  # told in seconds, as so short a mission is
    after = shown(page, "vehicles")
    assert after["x"] != before["x"]
    np.testing.assert_allclose(cursors, t, rtol=1e-12)
    k = np.searchsorted(run.time, t + 1e-4) - 1
    places = [*run.truth[:, k, :2], run.cna[k, :2]]
    np.testing.assert_allclose(np.transpose([after["x"], after["y"]]), places, atol=1e-4)
    assert float(page.find_element("id", "scrub").get_property("value")) == pytest.approx(t)


def test_scrubbing_to_a_range_shows_that_range_and_a_lost_one_its_reason(page, run):
    came = np.isfinite(run.ranges[0])
    due = np.arange(1, 11) * 4  # samples: every 2 s
    both = next(k for k in due if came[:, k].any() and not came[:, k].all())
    seek(page, float(run.time[both]))
    drawn = dict(zip(shown(page, "pings")["who"], shown(page, "labels")["text"], strict=True))
    for i, name in enumerate(run.names):
        value = run.ranges[0, i, both]
        expected = f"{value:.1f} m" if came[i, both] else "✗ lost on its way"
        assert drawn[f"{name} to cna"] == expected
    seek(page, float(run.time[both]) - 0.5)
    assert shown(page, "pings")["who"] == []


def test_path_that_the_planner_has_in_mind_is_drawn_from_the_vehicle_on(tmp_path):
    run = simulate(scenario(planner={"kind": "information", "interval": 4.0}), seed=2)
    (planned,) = run.planned
    places = slice(planned.ends[0], planned.ends[1])  # of the second path
    t = planned.decided[1] + 3.0
    left = planned.time[places] > t
    assert t < planned.decided[2]
    assert 0 < left.sum() < left.size
    (tmp_path / "report.html").write_text(run_page(run), encoding="utf-8")
    browser = chromium()
    try:
        opened(browser, tmp_path / "report.html")
        seek(browser, t)
        drawn = shown(browser, "ahead")
        key = browser.find_element("id", "key").text
    finally:
        browser.quit()
    here = run.cna[np.searchsorted(run.time, t), :2]
    expected = np.vstack([here, planned.place[places][left]])
    found = np.array([drawn["x"][:-1], drawn["y"][:-1]], dtype=float).T  # the last is a gap
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert "path planned" in key
    assert "present command" not in key


TRUE_TO_SCALE = """
const seen = player.maps[0].view.frame.bbox, { x, y } = player.view;
const east = (x.end - x.start) / seen.width, north = (y.end - y.start) / seen.height;
return Math.abs(east / north - 1) < 1e-6;
"""
SETTLED = "const done = arguments[0]; setTimeout(done, 500)"


@pytest.mark.parametrize("size", [(1440, 1000), (400, 800)])
def test_map_has_as_many_metres_a_pixel_east_as_north(page, size):
    before = page.get_window_size()
    page.set_window_size(*size)
    page.execute_async_script(SETTLED)
    assert wait(page, TRUE_TO_SCALE)
    page.set_window_size(before["width"], before["height"])
    page.execute_async_script(SETTLED)


def test_keys_step_seek_play_and_go_from_range_to_range(page, run):
    press(page, Keys.HOME)
    press(page, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    assert at(page) == pytest.approx(1.0)
    press(page, "n")
    assert at(page) == pytest.approx(2.0)
    press(page, "n", "p")
    assert at(page) == pytest.approx(2.0)
    press(page, Keys.END)
    assert at(page) == pytest.approx(run.time[-1])
    press(page, Keys.ARROW_LEFT)
    assert at(page) == pytest.approx(run.time[-2])
    press(page, Keys.HOME, " ")
    assert wait(page, "return player.state.t > 0")
    press(page, " ")
    assert page.execute_script("return player.state.playing") is False


def test_values_are_told_in_words(page, run):
    k = 21
    seek(page, float(run.time[k]))
    rows = page.execute_script(
        "return [...document.querySelectorAll('#values tbody tr')].map((row) => [...row.cells].map((c) => c.textContent))"
    )
    for i, row in enumerate(rows):
        assert row[0] == run.names[i]
        assert row[1] == f"{run.error[i, k]:.2f} m"
        assert row[3].startswith(f"{run.separation[i, k]:.1f}"[:3])
    said = page.find_element("id", "status").text
    assert "Planner: " in said
    assert ("broken by" in said) == bool(run.violation[:, k].max() > 0)


def test_pointer_tells_latitude_and_longitude(page):
    places = np.array([[0.0, 0.0], [1500.0, -3000.0], [-20_000.0, 15_000.0]])
    found = [
        page.execute_script("return player.geographic(...arguments)", *p) for p in places.tolist()
    ]
    up = (places**2).sum(axis=1) / (2 * 6.371e6)
    lat, lon, _ = pymap3d.enu2geodetic(places[:, 0], places[:, 1], -up, 47.6, -122.3, 0.0)
    np.testing.assert_allclose(found, np.transpose([lat, lon]), atol=2e-6)  # 0.2 m


def test_hostile_names_are_shown_and_do_nothing(page, run):
    assert page.execute_script("return window.hurt") is None
    assert page.execute_script("return document.title").startswith("Scenario, planner")
    options = [one.text for one in page.find_elements("css selector", "#auv option")]
    assert [re.sub(r"\s+", " ", name) for name in options] == [
        re.sub(r"\s+", " ", name) for name in run.names
    ]
    wide = page.execute_script("return document.documentElement.scrollWidth - innerWidth")
    assert wide <= 0  # a word of 300 letters makes nothing wider than the window


def test_nothing_is_claimed_of_errors_without_the_truth(run, page, tmp_path):
    path = tmp_path / "blind.html"
    path.write_text(run_page(replace(run, truth=None)), encoding="utf-8")
    own = page.current_window_handle
    page.switch_to.new_window("tab")
    try:
        opened(page, path)
        cells = [one.text for one in page.find_elements("css selector", "#values tbody td")]
        assert cells.count("not known") == len(run.names)
        titles = [one.text for one in page.find_elements("css selector", ".panel h3")]
        assert not any("error" in title or "NEES" in title for title in titles)
    finally:
        page.close()
        page.switch_to.window(own)


FRAME = """
const { left, top } = player.maps[0].target.getBoundingClientRect(), box = player.maps[0].view.frame.bbox;
return [left + box.left, top + box.top, box.width, box.height];
"""
PIXEL = """
const { x, y } = player.view, box = player.maps[0].view.frame.bbox;
return [(box.width * (arguments[0] - x.start)) / (x.end - x.start) - 2,
  (box.height * (y.end - arguments[1])) / (y.end - y.start) - 2];
"""


def test_a_chart_is_drawn_under_the_tracks(run, page, tmp_path):
    pytest.importorskip("rasterio")
    values = np.full((3, 400, 400), 0, dtype="uint8")
    values[0] = 255  # red everywhere
    lon, lat = -122.3, 47.6
    chart = geotiff(tmp_path / "red.tif", values, "EPSG:4326", grid(lon - 0.02, lat + 0.02, 1e-4))
    path = tmp_path / "charted.html"
    drawn = chart_of([chart], [surroundings(run)])
    path.write_text(run_page(run, chart=drawn), encoding="utf-8")
    own = page.current_window_handle
    page.switch_to.new_window("tab")
    try:
        opened(page, path)
        page.execute_async_script(SETTLED)
        seen = np.asarray(Image.open(io.BytesIO(page.get_screenshot_as_png())).convert("RGB"))
        left, top, width, height = page.execute_script(FRAME)
        seen = seen[
            round(top) + 2 : round(top + height) - 2, round(left) + 2 : round(left + width) - 2
        ]
        red, green, blue = np.moveaxis(seen.astype(int), -1, 0)
        faint = (red > 250) & (abs(green - 128) < 4) & (abs(blue - 128) < 4)  # half of it, on white
        assert faint.mean() > 0.8
        left, lower = page.execute_script(PIXEL, 30.0, 30.0)  # about the keep-out
        right, upper = page.execute_script(PIXEL, 50.0, 50.0)
        about = seen[round(upper) : round(lower), round(left) : round(right)]
        dark = about.max(axis=2) < 90  # its black outline is over the red, which would lighten it
        assert dark.sum() > 20
        assert complaints(page) == []
    finally:
        page.close()
        page.switch_to.window(own)


def test_same_run_gives_the_same_page(run):
    again = simulate(run.scenario, seed=2)
    assert run_page(run) == run_page(again)
