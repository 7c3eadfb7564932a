"""Claims about figures."""

import io
import struct
import warnings
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import same_color, to_hex
from scipy.stats import chi2

from obsplan.planners import PLANNERS
from obsplan.report import compare_figure, errors_figure, map_figure
from obsplan.report.errors import NEES_BAND
from obsplan.report.map import apart, ellipses, extent
from obsplan.report.panels import BEYOND
from obsplan.report.style import BROKEN, COLOURS, MOST_POINTS, outline, planner_style, png
from obsplan.simulation import simulate

pytestmark = pytest.mark.xdist_group("report-figures")  # they share runs


@pytest.fixture(scope="module")
def formation():
    return simulate("fixed-formation", seed=2)


@pytest.fixture(scope="module")
def anchored():
    return simulate("survey-slow", planner="stationary", seed=3)


def lines(axes):
    return [np.array(line.get_xydata()) for line in axes.lines]


def holds(axes, points):
    """Whether a line of these points is in the axes."""
    return any(line.shape == points.shape and np.array_equal(line, points) for line in lines(axes))


def texts(figure):
    """Everything a figure says in words."""
    said = [figure.get_suptitle(), figure.get_supxlabel()]
    for axes in figure.axes:
        said += [axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left"), axes.get_title()]
        said += [
            text.get_text()
            for text in (*axes.texts, *(axes.get_legend().get_texts() if axes.get_legend() else ()))
        ]
    return [text for text in said if text]


def test_map_shows_every_track_to_scale_inside_its_frame(formation):
    figure = map_figure(formation)
    (axes,) = figure.axes
    assert axes.get_aspect() == 1.0
    assert holds(axes, formation.cna[:, :2])
    for i in range(3):
        assert holds(axes, formation.truth[i, :, :2])
        assert holds(axes, formation.mean[i, :, :2])
    low, high = extent(formation)
    for points in (formation.cna[:, :2], *formation.truth[..., :2], *formation.mean[..., :2]):
        assert (points > low).all()
        assert (points < high).all()
    assert (axes.get_xlim(), axes.get_ylim()) == ((low[0], high[0]), (low[1], high[1]))
    said = " ".join(texts(figure))
    for word in (
        "[m]",
        "Fixed formation",
        "path-inertia",
        f"{formation.rms_error:.2f} m",
        "95 % ellipse",
        "top",
        "left",
        "right",
    ):
        assert word in said, word


def test_map_has_no_course_where_the_aid_vehicle_stays(anchored):
    said = texts(map_figure(anchored))
    assert "aid vehicle, start" in said
    assert "aid vehicle, course" not in said


def test_map_of_vehicles_that_keep_still_is_still_a_map():
    run = simulate("fixed-auv", planner="stationary")
    still = replace(run, mean=run.truth, cna=np.zeros_like(run.cna))
    low, high = extent(still)
    assert (high - low >= 0.1).all()
    assert png(lambda: map_figure(still))


def test_map_of_a_straight_line_is_not_a_line():
    run = simulate("fixed-auv", planner="stationary")
    east = np.linspace(0.0, 1000.0, run.time.size)
    straight = replace(run, cna=np.stack([east, 0 * east, 0 * east], axis=-1))
    low, high = extent(straight)
    assert (high - low)[1] > 0.25 * 1000


def test_ellipse_is_where_the_squared_mahalanobis_distance_is_95_percent_of_chi_square():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(5, 2, 2))
    P, center = A @ A.transpose(0, 2, 1), rng.normal(size=(5, 2))
    for outline_, S, c in zip(ellipses(P, center), P, center, strict=True):
        d = outline_ - c
        np.testing.assert_allclose(
            np.einsum("ki,ij,kj->k", d, np.linalg.inv(S), d), chi2.ppf(0.95, 2), rtol=1e-9
        )


def test_ellipse_without_extent_is_drawn_nowhere_and_equal_ones_once():
    center = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [50.0, 0.0], [50.0, 0.1], [80.0, 0.0]])
    P = np.array([1.0, 1.0, 25.0, 1.0, 1.0, 1e-9])[:, None, None] * np.eye(2)
    assert apart(ellipses(P, center), center, 0.1) == [
        0,
        2,
        3,
    ]  # the same again, one five times as large, one elsewhere


def test_consistency_band_is_the_central_95_percent_of_chi_square():
    np.testing.assert_allclose(NEES_BAND, chi2.ppf([0.025, 0.975], 2), rtol=1e-3)


@pytest.mark.slow
@given(st.integers(MOST_POINTS + 1, 4 * MOST_POINTS), st.integers(0, 2**32 - 1))
def test_thinned_line_keeps_its_ends_and_every_spike(n, seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=n)
    spikes = rng.choice(n, 2, replace=False)
    values[spikes] = [100.0, -100.0]
    kept = outline(values)
    assert len(kept) <= MOST_POINTS + 2
    assert (np.diff(kept) > 0).all()
    assert {0, n - 1, *spikes} <= set(kept.tolist())


def test_short_line_is_kept_whole():
    np.testing.assert_array_equal(outline(np.zeros(MOST_POINTS)), np.arange(MOST_POINTS))


def test_errors_have_a_row_per_auv_and_one_of_separation_consistency_and_condition(formation):
    figure = errors_figure(formation)
    assert len(figure.axes) == 3 * 3 + 3
    for i in range(3):
        east, north, distance = figure.axes[3 * i : 3 * i + 3]
        time = formation.time
        for axis, axes in enumerate((east, north)):
            error = (formation.mean - formation.truth)[i, :, axis]
            assert holds(axes, np.stack([time, error], axis=-1))
            band = axes.collections[0].get_paths()[0].vertices
            np.testing.assert_allclose(
                band[:, 1].max(), 3 * np.sqrt(formation.covariance[i, :, axis, axis]).max()
            )
            assert axes.get_ylim()[1] > np.abs(error).max()
        assert holds(distance, np.stack([time, formation.error[i]], axis=-1))
        bound = np.sqrt(np.trace(formation.cramer_rao[i, :, :2, :2], axis1=1, axis2=2))
        np.testing.assert_allclose(lines(distance)[1][:, 1], bound)
    separation, nees, condition = figure.axes[-3:]
    assert holds(separation, np.stack([formation.time, formation.separation[1]], axis=-1))
    assert nees.get_yscale() == condition.get_yscale() == "log"
    assert condition.get_ylabel() == "κ(J) [-]"
    decided = np.isfinite(formation.condition[2])
    assert holds(condition, np.stack([formation.time, formation.condition[2]], axis=-1)[decided])


def test_errors_have_no_condition_number_where_the_planner_has_none(anchored):
    figure = errors_figure(replace(anchored, hypotheses=None))
    assert len(figure.axes) == 3 + 2
    assert not any("κ" in text for text in texts(figure))


def test_errors_have_a_panel_of_the_positions_that_fit_where_there_were_several(anchored):
    fitting = np.ones((1, anchored.time.size))
    assert not any("Positions" in text for text in texts(errors_figure(told(anchored, fitting))))
    fitting[0, 3:9] = 2
    figure = errors_figure(told(anchored, fitting))
    assert any("Positions that fit" in text for text in texts(figure))
    np.testing.assert_array_equal(figure.axes[-1].lines[0].get_ydata(), fitting[0])


def told(run, fitting):
    return replace(run, hypotheses=fitting)


def test_long_missions_are_told_in_minutes(formation):
    assert errors_figure(formation).axes[-1].get_xlabel() == "Time [s]"
    longer = errors_figure(replace(formation, time=60.0 * formation.time))
    assert longer.axes[-1].get_xlabel() == "Time [min]"
    assert longer.axes[-1].get_xlim() == (0.0, formation.time[-1])


@pytest.mark.slow
def test_errors_of_a_filter_without_uncertainty_are_drawn(formation):
    certain = replace(
        formation, covariance=np.zeros_like(formation.covariance), mean=formation.truth
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # of numpy
        certain.__dict__["cramer_rao"] = (
            certain.covariance
        )  # no information matrix has an inverse here
        assert png(lambda: errors_figure(certain))


def test_png_says_nothing_but_its_picture(formation):
    content = png(lambda: map_figure(formation))
    kinds, at = [], 8  # chunks: length, kind, data, checksum
    while at < len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        kinds.append(content[at + 4 : at + 8])
        at += 12 + length
    assert set(kinds) <= {b"IHDR", b"pHYs", b"IDAT", b"IEND"}


@pytest.mark.slow
def test_style_of_the_user_neither_changes_nor_matters(formation):
    plain = png(lambda: errors_figure(formation))
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 20.0, "axes.facecolor": "red"}):
        before = dict(mpl.rcParams)
        assert png(lambda: errors_figure(formation)) == plain
        assert dict(mpl.rcParams) == before


def test_colours_are_eight_and_dark_enough_for_white_paper():
    assert len({to_hex(c) for c in COLOURS}) == 8
    image = mpl.colors.to_rgba_array(COLOURS)[:, :3]
    linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    contrast = 1.05 / (linear @ [0.2126, 0.7152, 0.0722] + 0.05)  # WCAG 2.1
    assert contrast.min() > 2.0


# --- scale and limits of errors -------------------------------------------------------------------


def test_panels_are_named_by_the_direction_they_show(formation):
    for axes in errors_figure(formation).axes[:9]:
        name, _, what = axes.get_title().partition(": ")
        i = formation.names.index(name)
        d = formation.mean[i, :, :2] - formation.truth[i, :, :2]
        shown = {
            "east error": d @ [1.0, 0.0],
            "north error": d @ [0.0, 1.0],
            "distance from the truth": np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2),
        }[what]
        (line,) = [line for line in axes.lines if same_color(line.get_color(), COLOURS[i])]
        np.testing.assert_allclose(line.get_ydata(), shown, atol=1e-12)
        direction = what.split()[0].capitalize()
        expected = "Error [m]" if direction == "Distance" else f"{direction} error [m]"
        assert axes.get_ylabel() == expected


@pytest.fixture
def unsure(formation):
    """A first estimate 40 m off and unsure by 60 m for the first tenth, then errors of centimetres."""
    mean, covariance = formation.truth.copy(), formation.covariance.copy()
    k = np.arange(formation.time.size)
    late = 0.05 * np.sin(0.1 * k)
    mean[..., 0] += np.where(k < 60, 40.0, late)
    mean[..., 1] += np.where(k < 60, -30.0, -late)
    covariance[..., :2, :2] = np.where(k < 60, 400.0, 0.0025)[:, None, None] * np.eye(2)
    return replace(formation, mean=mean, covariance=covariance)


@pytest.mark.slow
def test_a_bad_start_neither_flattens_the_rest_nor_is_cut_off(unsure):
    figure = errors_figure(unsure)
    figure.draw_without_rendering()
    for axes in figure.axes[:2]:
        low, high = axes.get_ylim()
        assert low < -60.0
        assert high > 60.0  # three standard deviations of the start
        span = axes.get_window_extent()
        zero, settled = axes.transData.transform([[0.0, 0.0], [0.0, 0.15]])[:, 1]
        assert settled - zero > 0.2 * span.height  # three standard deviations of the rest
        shaded = [p for p in axes.patches if same_color(p.get_facecolor(), BEYOND)]
        assert {tuple(sorted(p.get_extents().intervaly.round(6))) for p in shaded} == {
            tuple(sorted(interval))
            for interval in (
                span_of(axes, axes.yaxis.get_transform().linthresh, high),
                span_of(axes, low, -axes.yaxis.get_transform().linthresh),
            )
        }
    assert any("logarithmic" in text.get_text() for text in figure.legends[0].get_texts())


def span_of(axes, low, high):
    """Heights [pixels] of two values."""
    return tuple(axes.transData.transform([[0.0, low], [0.0, high]])[:, 1].round(6))


def test_errors_that_settle_at_what_they_begin_with_are_on_a_linear_axis(formation):
    steady = replace(
        formation,
        mean=formation.truth + np.array([0.3, 0.2, 0.0, 0.0]),
        covariance=np.broadcast_to(np.eye(4), formation.covariance.shape).copy(),
    )
    scales = [axes.get_yscale() for axes in errors_figure(steady).axes[:9]]
    assert scales[0::3] == scales[1::3] == ["linear"] * 3


def test_late_loss_is_in_the_linear_part(formation):
    """What comes late sets the scale: a filter that diverges is seen to."""
    lost = formation.truth.copy()
    lost[..., 0] += np.linspace(0.0, 300.0, formation.time.size)
    axes = errors_figure(replace(formation, mean=lost)).axes[0]
    assert axes.get_yscale() == "linear"
    assert axes.get_ylim()[1] > 300


def test_separations_are_shown_with_their_limits_and_where_they_are_broken(formation):
    least, greatest = (float(np.quantile(formation.separation, q)) for q in (0.1, 0.9))
    limited = formation.scenario.table.constraints.model_copy(
        update={"min_separation": least, "max_separation": greatest}
    )
    table = formation.scenario.table.model_copy(update={"constraints": limited})
    run = replace(formation, scenario=replace(formation.scenario, table=table))
    figure = errors_figure(run)
    (axes,) = [a for a in figure.axes if a.get_ylabel() == "Separation [m]"]
    across = {line.get_ydata()[0] for line in axes.lines if len(line.get_xdata()) == 2}
    assert across == {least, greatest}
    for i in range(3):
        apart = np.hypot(*(run.truth[i, :, :2] - run.cna[:, :2]).T)
        outside = (apart < least - 1e-3) | (apart > greatest + 1e-3)
        marked = np.zeros(run.time.size, dtype=bool)
        for line in axes.lines:
            if same_color(line.get_color(), BROKEN):
                y = line.get_ydata()
                marked |= np.isfinite(y) & (np.abs(y - apart) < 1e-12)
        assert outside.any()
        np.testing.assert_array_equal(marked, outside)
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert f"separation limits: least {least:g} m, greatest {greatest:g} m" in said
    assert "limit broken" in said


def test_limits_that_no_separation_came_near_are_not_drawn(formation):
    limited = formation.scenario.table.constraints.model_copy(update={"max_separation": 9999.0})
    table = formation.scenario.table.model_copy(update={"constraints": limited})
    figure = errors_figure(replace(formation, scenario=replace(formation.scenario, table=table)))
    (axes,) = [a for a in figure.axes if a.get_ylabel() == "Separation [m]"]
    assert axes.get_ylim()[1] < 100
    assert not any("limit" in text.get_text() for text in figure.legends[0].get_texts())


@pytest.mark.slow
def test_legend_of_errors_hides_no_panel(formation):
    figure = errors_figure(formation)
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    for axes in figure.axes:
        assert axes.get_legend() is None
        assert axes.get_window_extent().y0 > legend.y1


def test_every_axis_has_a_unit(formation, anchored):
    for figure in (errors_figure(formation), errors_figure(anchored), map_figure(anchored)):
        for axes in figure.axes:
            assert "[" in axes.get_ylabel()
        for axes in figure.axes[-2:]:
            assert "[" in axes.get_xlabel()


# --- comparison -----------------------------------------------------------------------------------


def rows(**figures):
    return [
        {"planner": p, "seed": s, "rms_error_m": v, "max_error_m": 2 * v, "separation_mean_m": 5.0}
        for p, values in figures.items()
        for s, v in enumerate(values)
    ]


def judged(violations, **figures):
    """Rows of a scenario with limits: violation by planner, the same in every mission."""
    return [
        row | {"violation_max_m": v} for row, v in zip(rows(**figures), violations, strict=True)
    ]


def test_planner_that_breaks_a_limit_comes_last_and_is_marked_as_are_its_missions():
    figure = compare_figure(
        judged([-3.0, -1.0, 2.5, -4.0], good=[3.0, 4.0], trail=[1.0, 2.0]), "Pond"
    )
    first, *_, last = figure.axes
    assert [label.get_text() for label in first.get_yticklabels()] == ["good", "trail †"]
    assert same_color(first.get_yticklabels()[1].get_color(), BROKEN)
    assert last.get_xlabel() == "Limit broken by [m]"
    dots = {
        float(x): same_color(line.get_mfc(), "white")
        for line in first.lines
        if line.get_linestyle() == "None" and line.get_marker() != "|"
        for x in line.get_xdata()
    }
    assert dots == {3.0: False, 4.0: False, 1.0: True, 2.0: False}
    broken = [x for line in last.lines if line.get_marker() == "o" for x in line.get_xdata()]
    assert sorted(broken) == [0.0, 2.5]
    diamonds = [x for line in last.lines if line.get_marker() == "D" for x in line.get_xdata()]
    assert diamonds == [0.0, 0.0]
    assert "Open dot, †: broke a limit." in " ".join(texts(figure))


def test_comparison_without_limits_speaks_of_none():
    figure = compare_figure(rows(one=[1.0], two=[2.0]))
    assert len(figure.axes) == 3
    assert not any("limit" in text or "†" in text for text in texts(figure))


def test_planner_has_the_same_colour_whoever_it_is_compared_with():
    def colours(**figures):
        axes = compare_figure(rows(**figures)).axes[0]
        names = [label.get_text() for label in axes.get_yticklabels()]
        return dict(zip(names, [to_hex(line.get_mfc()) for line in axes.lines], strict=True))

    alone = colours(circle=[1.0])
    among = colours(circle=[3.0], trail=[2.0], mine=[1.0])
    assert among["circle"] == alone["circle"]
    assert len(set(among.values())) == 3


def test_every_planner_looks_different():
    assert len({planner_style(name) for name in PLANNERS}) == len(PLANNERS)
    assert planner_style("my-own") == planner_style("my-own")
    assert planner_style("my-own")[1] not in {planner_style(name)[1] for name in PLANNERS}


def test_comparison_draws_every_mission_with_median_and_quartiles_the_best_first():
    figure = compare_figure(rows(bad=[4.0, 8.0, 6.0, 5.0], good=[1.0, 3.0, 2.0, 9.0]), "title")
    panel = figure.axes[0]
    assert [label.get_text() for label in panel.get_yticklabels()] == ["good", "bad"]
    dots, bar, median = lines(panel)[:3]
    assert sorted(dots[:, 0]) == [1.0, 2.0, 3.0, 9.0]
    np.testing.assert_allclose(
        bar[:, 0], [1.75, 4.5]
    )  # by linear interpolation between the sorted values
    assert median[0, 0] == 2.5
    assert figure.get_suptitle() == "title"
    assert figure.get_supxlabel() == "Dot: one mission; bar: median and quartiles."


@pytest.mark.parametrize(
    ("values", "scale"), [([1.0, 9.0], "linear"), ([1.0, 11.0], "log"), ([0.0, 11.0], "linear")]
)
def test_comparison_is_logarithmic_only_beyond_a_decade_and_above_zero(values, scale):
    figure = compare_figure(rows(one=values))
    assert figure.axes[0].get_xscale() == scale
    assert figure.axes[2].get_xscale() == "linear"


def test_comparison_over_one_seed_has_dots_alone():
    figure = compare_figure(rows(one=[1.0], two=[2.0]))
    assert [line.shape for line in lines(figure.axes[0])] == [(1, 2), (1, 2)]
    assert io.BytesIO(png(lambda: figure)).read(8) == b"\x89PNG\r\n\x1a\n"
