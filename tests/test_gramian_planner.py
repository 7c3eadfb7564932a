"""The Gramian horizon beyond the thesis: moving AUVs, pings, noise, the position's own information, weights and limits, by brute force."""

import cmath
import math

import numpy as np
import pytest
from oracles import AGGREGATES, METRICS, arc, scenario, told
from scipy.integrate import quad_vec

import obsplan as op
from formulations.gramian.pings import ping_moments
from formulations.gramian.range import displacement_moments
from formulations.model.ranging import Ranging
from formulations.solution import Status
from obsplan.constraints import Constraints, Disc

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
RATES = np.linspace(0.4, -0.4, 9)
POSE = (4.0, -3.0, 0.6)


def integrand(x, v, heading, u, t, variant):
    """The squared range's part of J'J, and the squared distance; in complex numbers, the displacement turning with the heading."""
    along = 2.0 * t if u == 0 else 2.0 / (1j * u) * (cmath.exp(1j * u * t) - 1)
    moved = along * cmath.exp(1j * heading)
    p = complex(*x) + moved - complex(*v) * t
    by_heading = 0.0 if variant == "thesis" else 2 * (p.conjugate() * 1j * moved).real
    J = np.array([2 * p.real, 2 * p.imag, by_heading])
    return np.append(np.outer(J, J).ravel(), abs(p) ** 2)


def information(auv, u, *, times=None, horizon, options):
    """Gramian of one AUV under the planner's options."""
    x = np.array(POSE[:2]) - auv.mean[:2]
    v = np.zeros(2)
    if options.get("motion") == "constant-velocity":
        v = auv.mean[3] * np.array([math.cos(auv.mean[2]), math.sin(auv.mean[2])]) + auv.current
    at = lambda t: integrand(x, v, POSE[2], u, t, options.get("gramian", "exact"))  # noqa: E731
    tau = options["ping_interval"]
    total = (
        quad_vec(at, 0, horizon, epsabs=1e-12, epsrel=1e-12)[0]
        if times is None
        else tau * sum(at(t) for t in times)
    )
    W, square = total[:9].reshape(3, 3), total[9] / horizon
    seen = np.diag([0, 0, horizon])
    if options.get("noise") == "sensor":
        scale = 4 * square if options["ranging_kind"] == "range" else 1.0
        W, seen = (
            W / (scale * options["sigma"] ** 2 * tau),
            seen / (options["heading_sigma"] ** 2 * tau),
        )
    W = W + seen
    return W if options.get("block", "pose") == "pose" else np.linalg.inv(np.linalg.inv(W)[:2, :2])


def brute_force(auvs, options, *, time=0.0, metric="condition-number", aggregate="mean"):
    """Total of every candidate."""
    horizon, tau, times = options["horizon"], options["ping_interval"], None
    if options.get("sampling") == "pings":
        count = max(3, round(horizon / tau))
        horizon, times = (
            count * tau,
            [(math.floor(time / tau) + 1 + k) * tau - time for k in range(count)],
        )
    share = np.array([auv.weight for auv in auvs])
    if options.get("weighting") == "covariance":
        share = share * [np.trace(auv.covariance[:2, :2]) for auv in auvs]
    totals = []
    for u in RATES:
        spectra = [
            np.linalg.eigvalsh(information(auv, u, times=times, horizon=horizon, options=options))
            for auv in auvs
        ]
        totals.append(
            AGGREGATES[aggregate](
                np.array([METRICS[metric](e) for e in spectra]), share / share.sum()
            )
        )
    return np.array(totals)


def auvs(rng):
    """Three AUVs under way, as sure of their places as may be, the second without a say."""
    for weight in (1.0, 0.0, 2.5):
        mean = np.array([*rng.uniform(-15, 15, 2), rng.uniform(-3, 3), rng.uniform(0.5, 1.5)])
        yield op.Belief(
            mean=mean,
            covariance=np.diag([*10 ** rng.uniform(-1, 2, 2), 0.01, 0.01]),
            weight=weight,
            current=(0.2, -0.1),
        )


PINGED = {"sampling": "pings", "motion": "constant-velocity"}
SENSED = {"noise": "sensor", "ranging_kind": "range"}
OPTIONS = [
    {"motion": "constant-velocity"},
    {"sampling": "pings"},
    PINGED,
    {**PINGED, "horizon": 2.0},  # lengthened to three pings
    {**PINGED, "gramian": "thesis"},
    {"block": "position"},
    SENSED,
    {"noise": "sensor", "ranging_kind": "squared-range"},
    {**SENSED, "gramian": "thesis"},
    {"weighting": "covariance"},
    {**PINGED, **SENSED, "block": "position", "weighting": "covariance"},
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda o: "-".join(map(str, o.values())))
@pytest.mark.parametrize(
    ("metric", "aggregate"),
    [("condition-number", "mean"), ("trace-inverse", "rms"), ("smallest-eigenvalue", "max")],
)
def test_takes_the_best_candidate_of_brute_force_whatever_it_takes_into_account(
    options, metric, aggregate
):
    rng = np.random.default_rng(1)
    options = {
        "horizon": 11.0,
        "ping_interval": 3.0,
        "sigma": 0.7,
        "ranging_kind": "range",
        "heading_sigma": 0.05,
    } | options
    planner = told(
        op.GramianHorizon, CNA, turn_rates=9, metric=metric, aggregate=aggregate, **options
    )
    for time in (0.0, 7.4, 9.0):
        believed = list(auvs(rng))
        totals = brute_force(believed, options, time=time, metric=metric, aggregate=aggregate)
        decision = planner.plan(op.Pose(*POSE), believed, time=time)
        assert decision.score == pytest.approx(totals.min(), rel=1e-6)
        assert decision.turn_rate == RATES[totals.argmin()]


def test_each_of_the_options_changes_what_is_decided():
    rng, changed = np.random.default_rng(2), {i: 0 for i in range(len(OPTIONS))}
    common = {"horizon": 11.0, "ping_interval": 3.0}
    for _ in range(15):
        believed, (x, y, heading) = list(auvs(rng)), POSE
        plain = told(op.GramianHorizon, CNA, **common).plan(op.Pose(x, y, heading), believed)
        for i, options in enumerate(OPTIONS):
            decision = told(op.GramianHorizon, CNA, **common | options).plan(
                op.Pose(x, y, heading), believed
            )
            changed[i] += decision.turn_rate != plain.turn_rate
    assert min(changed.values()) > 0


def test_moments_at_pings_are_their_sums_on_arcs_in_complex_numbers():
    rates, interval, first = np.array([0.4, 1e-3, 1e-9, 0.0, -1e-6, -0.4]), 3.0, 1.7
    moments = ping_moments(2.0, rates, first=first, interval=interval, count=5)
    for i, u in enumerate(rates):
        times = first + interval * np.arange(5)
        d1, d2, _ = np.array([arc((0.0, 0.0, 0.0), u, 2.0, t) for t in times]).T
        if (
            abs(u) < 1e-5
        ):  # where that loses digits; the next terms are (u t)^2 / 6 = 4e-11 of these
            d1, d2 = 2.0 * times, u * times**2
        for moment, product in zip(
            moments, (d1**0, d1, d2, d1 * d1, d1 * d2, d2 * d2), strict=True
        ):
            computed = [float(column[i]) for column in moment]
            expected = [interval * np.sum(times**j * product) for j in range(3)]
            np.testing.assert_allclose(computed, expected, rtol=1e-9)
    with pytest.raises(
        ValueError, match=r"time between pings must be finite and positive \[s\], got 0.0"
    ):
        ping_moments(2.0, rates, first=1.0, interval=0.0, count=3)
    with pytest.raises(ValueError, match="number of pings must be at least 1, got 0"):
        ping_moments(2.0, rates, first=1.0, interval=1.0, count=0)


def test_moments_at_ever_more_pings_become_integrals():
    rates, horizon = np.array([0.4, 0.1, 0.0, -0.2]), 9.0
    integrals = displacement_moments(2.0, rates, horizon)
    errors = []
    for count in (300, 600):
        tau = horizon / count
        sums = ping_moments(
            2.0, rates, first=tau / 2, interval=tau, count=count
        )  # the midpoint rule: of second order
        difference = [
            abs(float(s[j][i]) - exact[j, i])
            for s, exact in zip(sums, integrals, strict=True)
            for j in range(3)
            for i in range(4)
        ]
        errors.append(max(difference))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("distance", [3.0, 40.0, 600.0])
def test_with_the_range_sensors_noise_distance_alone_earns_nothing(distance):
    options = {
        "horizon": 12.0,
        "ping_interval": 2.0,
        "sigma": 0.5,
        "sampling": "pings",
        "noise": "sensor",
        "gramian": "thesis",
    }
    auv = op.Belief.at(distance, 0.3 * distance)
    planner = told(
        op.GramianHorizon, CNA, metric="log-det", block="position", turn_rates=9, **options
    )
    decision = planner.plan(op.Pose(0.0, 0.0, 0.2), [auv])
    total = 6 / 0.5**2  # six pings, each 1 / sigma^2 on some line
    assert -decision.score <= 2 * math.log(total / 2) + 1e-9  # split evenly at best
    raw = told(
        op.GramianHorizon,
        CNA,
        metric="log-det",
        block="position",
        turn_rates=9,
        **options | {"noise": "unit"},
    )
    far, near = raw.plan(op.Pose(-600.0, 0.0, 0.2), [auv]), raw.plan(op.Pose(0.0, 0.0, 0.2), [auv])
    assert (
        far.score < near.score
    )  # negative control: the raw Gramian of the squared range pays for distance


def test_covariances_that_are_zero_leave_the_weights_as_they_are():
    believed = [op.Belief.at(5.0, 1.0), op.Belief.at(-3.0, 8.0, weight=2.0)]
    plans = [
        op.GramianHorizon(op.Situation(CNA), weighting=w).plan(op.Pose(*POSE), believed)
        for w in ("fixed", "covariance")
    ]
    assert plans[0].score == plans[1].score


def test_horizon_is_given_in_seconds_or_circles():
    turn = 2 * np.pi * 5.0 / 2.0
    for options, seconds in [
        ({}, 2 / 3 * turn),
        ({"circles": 1.5}, 1.5 * turn),
        ({"circles": 1.5, "horizon": 7.0}, 7.0),
    ]:
        plans = [
            told(op.GramianHorizon, CNA, **given).plan(op.Pose(*POSE), [op.Belief.at(9.0, 2.0)])
            for given in (options, {"horizon": seconds})
        ]
        assert plans[0].score == pytest.approx(plans[1].score, rel=1e-12)
    assert (
        op.GramianHorizon(op.Situation(CNA, ping_interval=15.0), sampling="pings").look_ahead
        == 45.0
    )
    assert op.GramianHorizon(
        op.Situation(CNA, ping_interval=0.1), sampling="pings", horizon=2.0
    ).look_ahead == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"circles": 0.0}, r"circles must be from 0.01 to 1000 .*, got 0.0"),
        ({"ping_interval": math.nan}, r"ping_interval must be positive and finite \[s\], got nan"),
        ({"sigma": -1.0}, r"sigma must be positive and finite \[m\], got -1.0"),
        ({"heading_sigma": 0.0}, r"heading_sigma must be positive and finite \[rad\], got 0.0"),
        (
            {"decision_interval": math.inf},
            r"decision_interval must be positive and finite \[s\], got inf",
        ),
        (
            {"gramian": "empirical", "sampling": "pings"},
            'gramian "empirical" takes AUVs at rest .*choose "exact"',
        ),
        (
            {"gramian": "empirical", "motion": "constant-velocity"},
            'gramian "empirical" takes AUVs at rest .*choose "exact"',
        ),
    ],
)
def test_options_that_make_no_sense_are_refused_by_name_and_value(options, message):
    with pytest.raises(ValueError, match=message):
        told(op.GramianHorizon, CNA, **options)


def test_scenario_tells_its_sensors():
    mission = scenario(
        planner={"kind": "gramian"},
        ranging={"interval": 3.0, "kind": "squared-range", "sigma": 4.0, "heading_sigma_deg": 2.0},
    )
    known = mission.planner().situation
    assert (known.ping_interval, known.ranging) == (3.0, Ranging(4.0, squared=True))
    assert known.heading_sigma == pytest.approx(math.radians(2.0))


# Limits


def test_limits_that_bind_nothing_change_nothing():
    rng = np.random.default_rng(3)
    far = Constraints(keep_out=(Disc(x=500.0, y=0.0, radius=10.0),))
    for _ in range(5):
        believed, pose = (
            list(auvs(rng)),
            op.Pose(*rng.uniform([-20, -20, -3], [20, 20, 3]).tolist()),
        )
        free, limited = (
            op.GramianHorizon(op.Situation(CNA, constraints=limits)).plan(pose, believed)
            for limits in (Constraints(), far)
        )
        assert (limited.turn_rate, limited.score, limited.status) == (
            free.turn_rate,
            free.score,
            free.status,
        )
        np.testing.assert_array_equal(limited.condition, free.condition)
        np.testing.assert_array_equal(limited.path, free.path)


def test_candidate_that_breaks_a_limit_over_the_horizon_is_left_out_where_others_do_not():
    believed, pose = [op.Belief.at(-6.0, 9.0)], op.Pose(0.0, 0.0, 0.0)
    free = op.GramianHorizon(op.Situation(CNA), horizon=10.0).plan(pose, believed)
    there = arc((0.0, 0.0, 0.0), free.turn_rate, 2.0, 8.0)[:2]
    wall = Constraints(keep_out=(Disc(x=float(there[0]), y=float(there[1]), radius=2.5),))
    decision = op.GramianHorizon(op.Situation(CNA, constraints=wall), horizon=10.0).plan(
        pose, believed
    )
    assert decision.status == Status.OPTIMAL
    along = [
        arc((0.0, 0.0, 0.0), decision.turn_rate, 2.0, t)[:2] for t in np.linspace(0, 10, 17)[1:]
    ]
    assert min(math.dist(place, there) for place in along) >= 2.5


def test_where_no_allowed_candidate_is_regular_the_straightest_is_taken():
    far, ahead = [op.Belief.at(1e9, 0.0)], Constraints(keep_out=(Disc(x=12.0, y=0.0, radius=4.0),))
    decision = op.GramianHorizon(op.Situation(CNA, constraints=ahead), turn_rates=9).plan(
        op.Pose(0.0, 0.0, 0.0), far
    )
    assert decision.status == Status.UNOBSERVABLE
    assert abs(decision.turn_rate) in RATES[RATES > 0]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {
            "motion": "constant-velocity",
            "sampling": "pings",
            "noise": "sensor",
            "block": "position",
        },
    ],
)
def test_keeps_within_its_limits_also_between_decisions(options):
    planner = {"kind": "gramian", "interval": 1.0, "knowledge": "truth", **options}
    free = op.simulate(scenario(planner=planner, duration=80.0))
    (x, y), west = free.cna[80, :2], float(free.cna[:, 0].min()) + 5.0
    fence = [[west, -90.0], [95.0, -90.0], [95.0, 90.0], [west, 90.0]]
    keep_out = [{"x": float(x), "y": float(y), "radius": 8.0}]
    run = op.simulate(
        scenario(
            planner=planner, constraints={"keep_out": keep_out, "geofence": fence}, duration=80.0
        )
    )
    violation = lambda place: max(8.0 - math.dist(place, (x, y)), west - place[0])  # noqa: E731
    places = [
        [
            arc(pose, turn, 2.0, t)[:2]
            for pose, turn in zip(r.cna[:-1], r.turn_rate, strict=False)
            for t in np.linspace(0, 0.5, 11)
        ]
        for r in (run, free)
    ]
    worst, unlimited = (max(map(violation, at)) for at in places)
    assert worst < 1e-3
    assert unlimited > 3.0
    assert Status.VIOLATED not in run.status


def test_from_within_a_keep_out_it_says_so_and_leaves():
    mission = scenario(
        planner={"kind": "gramian", "interval": 1.0, "knowledge": "truth"},
        constraints={"keep_out": [{"x": 80.0, "y": -30.0, "radius": 12.0}]},
        duration=40.0,
    )
    run = op.simulate(mission)
    distance = np.hypot(run.cna[:, 0] - 80.0, run.cna[:, 1] + 30.0)
    assert run.status[0] == Status.VIOLATED
    left = np.flatnonzero(distance > 12.0)[0]
    assert (distance[left:] > 12.0 - 1e-3).all()
    assert Status.VIOLATED not in run.status[left + 20 :]
