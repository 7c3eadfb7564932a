"""Claims about the map, judged as what it is for: each thing is found in the picture by what it shows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import same_color, to_hex
from matplotlib.patches import Circle
from matplotlib.patches import Polygon as Outline
from oracles import scenario
from scipy.stats import chi2
from shapely.geometry import Point, Polygon

from obsplan.constraints import Disc
from obsplan.report import map_figure
from obsplan.report.map import degrees, extent
from obsplan.report.map_limits import boundary
from obsplan.report.marks import ROUND, mark_interval
from obsplan.report.style import AID, BROKEN, COLOURS, png
from obsplan.simulation import simulate

pytestmark = pytest.mark.xdist_group("report-map")  # they share runs
L_SHAPE = [[-60.0, 0.0], [-20.0, 0.0], [-20.0, 60.0], [-50.0, 60.0], [-50.0, 30.0], [-60.0, 30.0]]
BAY = [[-70.0, -25.0], [60.0, -20.0], [55.0, 70.0], [-60.0, 75.0]]
LIMITS = {
    "keep_out": [{"x": 12.0, "y": 30.0, "radius": 15.0}, {"points": L_SHAPE}],
    "geofence": BAY,
    "min_separation": 12.0,
    "max_separation": 55.0,
}


def fly(**change):
    """Two AUVs for 150 s, the aid vehicle on a circle that breaks some of the limits."""
    return simulate(
        scenario(
            duration=150.0,
            planner={"kind": "circle", "interval": 1.0, "knowledge": "truth"},
            **change,
        )
    )


@pytest.fixture(scope="module")
def free():
    return fly()


@pytest.fixture(scope="module")
def broken(free):
    """The same mission, judged by limits that nobody kept it within."""
    return replace(free, scenario=scenario(duration=150.0, constraints=LIMITS))


def axes_of(run):
    (axes,) = map_figure(run).axes
    return axes


def texts(axes):
    return [text.get_text() for text in axes.texts]


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def pixels(axes, points):
    """Where places [m] are in the picture."""
    axes.figure.draw_without_rendering()
    return axes.transData.transform(points)


# --- frame -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lat", "lon", "north", "east"),
    [
        (47.629, -122.337, "North of 47.629° N [m]", "East of 122.337° W [m]"),
        (-33.8568005, 151.2153, "North of 33.8568° S [m]", "East of 151.2153° E [m]"),
        (59.123456, 10.5, "North of 59.123456° N [m]", "East of 10.5° E [m]"),
        (-0.5, -0.25, "North of 0.5° S [m]", "East of 0.25° W [m]"),
    ],
)
def test_axes_are_named_by_the_origin_and_its_hemispheres(free, lat, lon, north, east):
    moved = replace(free, scenario=scenario(duration=150.0, origin={"lat": lat, "lon": lon}))
    axes = axes_of(moved)
    assert axes.get_xlabel() == east
    assert axes.get_ylabel() == north


def test_origin_is_told_to_the_tenth_of_a_metre():
    assert degrees(12.3456789, "N", "S") == "12.345679° N"  # 1e-6 degrees are 0.11 m


def test_east_is_to_the_right_and_north_is_up(free):
    axes = axes_of(free)
    start = free.scenario.table.cna.start
    marks = [line for line in axes.lines if line.get_marker() == "o" and line.get_markersize() == 7]
    (at,) = [line.get_xydata()[0] for line in marks if same_color(line.get_mec(), AID)]
    assert tuple(at) == tuple(free.cna[0, :2])
    assert abs(at[0] - start.x) < 100  # the planner starts on its circle
    origin, east, north = pixels(axes, [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    assert east[0] - origin[0] == pytest.approx(north[1] - origin[1], rel=1e-9)
    assert east[0] > origin[0]
    assert north[1] > origin[1]
    (letter,) = [text for text in axes.texts if text.get_text() == "N"]
    tip, tail = (letter.xycoords.transform(end) for end in (letter.xy, letter.get_position()))
    assert tip[1] > tail[1]
    assert tip[0] == tail[0]


@pytest.mark.parametrize("size", [0.02, 1.0, 37.0])
def test_scale_bar_is_as_long_as_it_says(free, size):
    still = {name: getattr(free, name).copy() for name in ("cna", "truth", "mean")}
    for track in still.values():
        track[..., :2] *= size
    axes = axes_of(replace(free, **still))
    (bar,) = [artist for artist in axes.get_children() if artist.get_gid() == "scale bar"]
    ends = bar.get_transform().transform(np.array(bar.get_data()).T)
    (label,) = [t for t in texts(axes) if t.endswith(" m") and t[:-2].replace(".", "").isdigit()]
    length = float(label[:-2])
    one, other = pixels(axes, [[0.0, 0.0], [length, 0.0]])
    assert ends[1, 0] - ends[0, 0] == pytest.approx(other[0] - one[0], rel=1e-9)
    assert length / 10 ** math.floor(math.log10(length)) == pytest.approx(
        round(length / 10 ** math.floor(math.log10(length)))
    )


@pytest.mark.slow
def test_title_is_a_name_and_says_how_well_it_went(free):
    named = free.scenario.table.model_copy(update={"name": "harbor-survey_2024-05"})
    told = texts(axes_of(replace(free, scenario=replace(free.scenario, table=named))))
    assert told.count("Harbor survey 2024-05, planner circle") == 1
    assert any(f"RMS position error {free.rms_error:.2f} m" in line for line in told)


def test_legend_and_scale_are_beside_the_map(broken):
    axes = axes_of(broken)
    figure = axes.figure
    figure.draw_without_rendering()
    right = axes.get_window_extent().x1
    assert axes.get_legend().get_window_extent().x0 >= right
    (bar,) = [artist for artist in axes.get_children() if artist.get_gid() == "scale bar"]
    assert bar.get_window_extent().x0 > right
    assert bar.get_window_extent().y0 > axes.get_legend().get_window_extent().y1


def test_saved_as_it_is_nothing_is_cut(broken):
    """A user saves `Run.plot()` without asking for a tight box."""
    figure = broken.plot()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    things = [*axes.texts, axes.get_legend(), axes.xaxis.label, axes.yaxis.label]
    for thing in things:
        box = thing.get_window_extent()
        assert 0 <= box.x0 < box.x1 <= figure.bbox.x1, thing
        assert 0 <= box.y0 < box.y1 <= figure.bbox.y1, thing
    wide = figure.get_tightbbox()
    assert wide.width > 0.9 * figure.get_figwidth()  # nor is there an empty margin
    assert wide.height > 0.9 * figure.get_figheight()


# --- tracks and ellipses -------------------------------------------------------------------------------


def test_ellipses_are_about_the_estimates_and_of_their_covariances(free):
    offset = np.zeros(4)
    offset[:2] = [23.0, -17.0]  # so that the truth is far from every estimate
    biased = replace(free, mean=free.truth + offset)
    drawn = [c for c in axes_of(biased).collections if type(c) is PolyCollection]
    assert len(drawn) == 2
    for i, ellipses in enumerate(drawn):
        assert same_color(ellipses.get_edgecolor()[0], COLOURS[i])
        assert len(ellipses.get_paths()) >= 3
        for path in ellipses.get_paths():
            edge = path.vertices[:48]
            center = edge.mean(axis=0)
            k = int(np.argmin(np.hypot(*(biased.mean[i, :, :2] - center).T)))
            np.testing.assert_allclose(center, biased.mean[i, k, :2], atol=1e-6)
            assert np.hypot(*(center - biased.truth[i, k, :2])) > 20
            d = edge - center
            inverse = np.linalg.inv(biased.covariance[i, k, :2, :2])
            np.testing.assert_allclose(
                np.einsum("ki,ij,kj->k", d, inverse, d), chi2.ppf(0.95, 2), rtol=1e-6
            )


def time_marks(axes, paint):
    """Filled round marks of a vehicle's colour."""
    marks = [line for line in axes.lines if line.get_markersize() == 5 and line.get_marker() == "o"]
    return [m.get_xydata()[0] for m in marks if same_color(m.get_mfc(), paint)]


def test_time_marks_are_at_the_same_round_instants_on_every_track(free):
    axes = axes_of(free)
    instants = [20.0 * k for k in range(1, 8)]  # of 150 s; every 10 s would be more than ten
    at = [int(t / 0.5) for t in instants]
    for track, paint in zip([free.cna, *free.truth], [AID, *COLOURS], strict=False):
        marks = np.array(time_marks(axes, paint))
        np.testing.assert_array_equal(marks, track[at, :2][: len(marks)])
        assert len(marks) >= 2
    assert len(time_marks(axes, AID)) == 7
    assert "after 20, 40, … s" in legend(axes)


@pytest.mark.slow
def test_each_number_beside_a_track_is_when_its_vehicle_was_there(free):
    axes = axes_of(free)
    tracks = {AID: free.cna[:, :2]} | {
        paint: truth[:, :2] for paint, truth in zip(COLOURS, free.truth, strict=False)
    }
    darkened = {
        to_hex(0.75 * np.array([int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)])): c for c in tracks
    }
    read = {paint: set() for paint in tracks}
    for text in axes.texts:
        if text.get_text().isdigit():
            paint = darkened[to_hex(text.get_color())]
            seconds = float(text.get_text())
            there = tracks[paint][round(seconds / 0.5)]
            one, other = pixels(axes, [there, text.get_position()])
            assert np.hypot(*(one - other)) < 25 * axes.figure.dpi / 72
            read[paint].add(seconds)
    assert read[AID] >= {20.0, 40.0, 60.0, 80.0, 100.0}
    for paint in COLOURS[:2]:
        assert {20.0, 40.0} <= read[paint] <= read[AID]


@pytest.mark.parametrize("most", [4, 10])
@pytest.mark.parametrize("duration", [0.5, 7.0, 60.0, 601.0, 1665.0, 86400.0, 3e6])
def test_time_marks_are_round_and_few(duration, most):
    interval = mark_interval(duration, most)
    assert interval in ROUND or interval % 21600 == 0
    assert duration / interval <= most
    assert duration / interval > most / 3 or duration < 1.0  # and not too few


def test_a_vehicle_that_keeps_still_has_no_time_marks(free):
    still = np.broadcast_to(free.truth[:1, :1], (2, 301, 4)).copy()
    axes = axes_of(replace(free, truth=still, mean=still))
    assert len(time_marks(axes, AID)) == 7
    assert not time_marks(axes, COLOURS[0])


def test_every_range_is_marked_on_both_ends_of_it(free):
    assert np.isfinite(free.range[0]).sum() == 75
    axes = axes_of(free)
    small = [line for line in axes.lines if 2 < line.get_markersize() < 3]
    ends = {to_hex(line.get_mec()): line.get_xydata() for line in small}
    for track, paint in zip([free.cna, *free.truth], [AID, *COLOURS], strict=False):
        np.testing.assert_array_equal(ends[paint.lower()], track[4::4, :2])  # every 2 s
    assert "range, every 2 s" in legend(axes)


def test_of_very_many_ranges_a_round_share_is_marked_and_told():
    often = fly(ranging__interval=0.5)
    axes = axes_of(often)
    assert "range, every 0.5 s,\none in 2 shown" in legend(axes)
    (aid,) = [
        line
        for line in axes.lines
        if 2 < line.get_markersize() < 3 and same_color(line.get_mec(), AID)
    ]
    np.testing.assert_array_equal(aid.get_xydata(), often.cna[1::2, :2])


@pytest.mark.slow
def test_labels_hide_neither_each_other_nor_stand_out_of_the_frame():
    eight = [
        {
            "name": f"auv-{k}",
            "speed": 1.5,
            "survey": {"kind": "waypoints", "points": [[6.0 * k, 0.0], [6.0 * k, 300.0]]},
        }
        for k in range(8)
    ]
    axes = axes_of(fly(auv=eight))
    axes.figure.draw_without_rendering()
    frame = axes.get_window_extent()
    placed = [t for t in axes.texts if t.get_transform() == axes.transData]
    assert len(placed) > 30
    boxes = [text.get_window_extent() for text in placed]
    for k, box in enumerate(boxes):
        assert frame.x0 <= box.x0 < box.x1 <= frame.x1
        assert frame.y0 <= box.y0 < box.y1 <= frame.y1
        for other in boxes[:k]:
            across = min(box.x1, other.x1) - max(box.x0, other.x0)
            down = min(box.y1, other.y1) - max(box.y0, other.y0)
            assert across <= 1 or down <= 2, (placed[k].get_text(), across, down)  # pixels


# --- limits --------------------------------------------------------------------------------------------


def test_keep_outs_are_hatched_where_they_are_and_bear_their_numbers(broken):
    axes = axes_of(broken)
    discs = [p for p in axes.patches if isinstance(p, Circle)]
    (outline,) = [p for p in axes.patches if isinstance(p, Outline)]
    (disc,) = discs
    assert (disc.center, disc.radius) == ((12.0, 30.0), 15.0)
    np.testing.assert_array_equal(outline.get_xy()[:-1], L_SHAPE)
    assert disc.get_hatch()
    assert outline.get_hatch()
    named = {t.get_text(): t.get_position() for t in axes.texts if "keep-out" in t.get_text()}
    assert math.dist(named["keep-out 1"], (12.0, 30.0)) < 15
    assert Polygon(L_SHAPE).contains(Point(named["keep-out 2"]))


def test_geofence_is_a_closed_line_about_what_is_allowed(broken):
    axes = axes_of(broken)
    closed = [line.get_xydata() for line in axes.lines if len(line.get_xydata()) == 5]
    assert any(np.array_equal(line, [*BAY, BAY[0]]) for line in closed)
    assert "geofence" in legend(axes)


def test_boundary_of_a_disc_is_its_circle():
    edge = boundary(Disc(x=3.0, y=-4.0, radius=2.5))
    np.testing.assert_allclose(np.hypot(*(edge - [3.0, -4.0]).T), 2.5, rtol=1e-12)
    turned = np.unwrap(np.arctan2(edge[:, 1] + 4.0, edge[:, 0] - 3.0))
    assert turned[-1] - turned[0] == pytest.approx(2 * math.pi)


def distances(run):
    return np.array(
        [
            [math.dist(a, b) for a, b in zip(run.cna[:, :2], auv[:, :2], strict=True)]
            for auv in run.truth
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "limit"), [("least", 12.0), ("greatest", 55.0)])
def test_ring_is_about_the_auv_when_its_separation_was_worst(broken, kind, limit):
    axes = axes_of(broken)
    apart = distances(broken)
    worst = apart.argmin() if kind == "least" else apart.argmax()
    i, k = np.unravel_index(worst, apart.shape)
    dotted = [
        line.get_xydata()
        for line in axes.lines
        if line.get_linestyle() == "--" or len(line.get_xydata()) > 100
    ]
    rings = [
        ring
        for ring in dotted
        if np.allclose(np.hypot(*(ring - broken.truth[i, k, :2]).T), limit, rtol=1e-9)
    ]
    assert len(rings) == 1
    (said,) = [text for text in legend(axes) if text.startswith(f"{kind} separation")]
    assert f"{limit:g} m" in said
    assert broken.names[i] in said
    assert f"{broken.time[k]:.0f} s" in said or (k == 0 and "at the start" in said)


def test_separation_that_was_never_near_has_no_ring(free):
    wide = scenario(duration=150.0, constraints={"max_separation": 5000.0})
    assert not any("separation" in text for text in legend(axes_of(replace(free, scenario=wide))))


def breaches(run):
    """At which samples any limit is broken, by plane geometry."""
    apart = distances(run)
    shape, bay = Polygon(L_SHAPE), Polygon(BAY)
    return [
        math.dist(p, (12.0, 30.0)) < 15.0
        or shape.contains(Point(p))
        or not bay.contains(Point(p))
        or apart[:, k].min() < 12.0
        or apart[:, k].max() > 55.0
        for k, p in enumerate(run.cna[:, :2])
    ]


def test_path_is_marked_where_it_breaks_a_limit_and_nowhere_else(broken):
    expected = np.array(breaches(broken))
    assert 0.05 < expected.mean() < 0.95  # else the claim is empty
    axes = axes_of(broken)
    (marked,) = [c for c in axes.collections if isinstance(c, LineCollection)]
    assert same_color(marked.get_edgecolor()[0][:3], BROKEN)
    drawn = {tuple(point) for piece in marked.get_segments() for point in piece}
    assert drawn == {tuple(point) for point in broken.cna[expected, :2]}
    assert "limit broken" in legend(axes)


def test_map_without_breach_says_nothing_of_one(free):
    roomy = scenario(
        duration=150.0, constraints={"keep_out": [{"x": 999.0, "y": 0.0, "radius": 5.0}]}
    )
    axes = axes_of(replace(free, scenario=roomy))
    assert not any(isinstance(c, LineCollection) for c in axes.collections)
    assert not any("broken" in text for text in [*texts(axes), *legend(axes)])


def test_heading_names_the_limit_that_was_broken_most(broken):
    (said,) = [text for text in texts(axes_of(broken)) if "broken by" in text]
    apart = distances(broken)
    by = {
        "least separation from a (12 m)": 12.0 - apart[0].min(),
        "least separation from b (12 m)": 12.0 - apart[1].min(),
        "greatest separation from a (55 m)": apart[0].max() - 55.0,
        "greatest separation from b (55 m)": apart[1].max() - 55.0,
        "keep-out 1": max(15.0 - math.dist(p, (12.0, 30.0)) for p in broken.cna[:, :2]),
        "keep-out 2": max(
            Polygon(L_SHAPE).exterior.distance(Point(p)) * Polygon(L_SHAPE).contains(Point(p))
            for p in broken.cna[:, :2]
        ),
        "the geofence": max(Polygon(BAY).distance(Point(p)) for p in broken.cna[:, :2]),
    }
    worst = max(by, key=by.get)
    assert said.lower().startswith(worst)
    assert f"{by[worst]:.2f} m" in said or f"{by[worst]:.1f} m" in said


def test_limits_are_on_the_map_unless_they_would_dwarf_it(free):
    near = {"keep_out": [{"x": 60.0, "y": 0.0, "radius": 10.0}]}
    far = {"keep_out": [{"x": 9000.0, "y": 0.0, "radius": 10.0}]}
    _, high = extent(replace(free, scenario=scenario(duration=150.0, constraints=near)))
    assert high[0] > 70.0
    distant = replace(free, scenario=scenario(duration=150.0, constraints=far))
    np.testing.assert_array_equal(extent(distant), extent(free))
    assert "Beyond the map: keep-out 1." in texts(axes_of(distant))
    assert not any("Beyond" in text for text in texts(axes_of(free)))


def test_estimate_far_astray_is_told_and_leaves_the_map_its_scale(free):
    astray = free.mean.copy()
    astray[1, 50:, :2] += 5000.0
    lost = replace(free, mean=astray)
    np.testing.assert_array_equal(extent(lost), extent(free))
    assert "Beyond the map: estimate of b." in texts(axes_of(lost))


@pytest.mark.slow
def test_names_are_no_mathematics_and_no_name_is_left_out(free):
    odd = scenario(duration=150.0, auv__0__name="_under $score$", auv__1__name="$\\frac$")
    run = replace(free, scenario=odd)
    axes = axes_of(run)
    assert [text.strip() for text in legend(axes)[:2]] == ["_under $score$", "$\\frac$"]
    assert png(lambda: map_figure(run)) == png(lambda: map_figure(run))
