"""Several beacons and aid vehicles: filters, joint plans, limits between vehicles, results."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

import obsplan as op
from formulations.model.ranging import Ranging
from formulations.model.schedule import Schedule, Stages
from obsplan.planners.information import InformationHorizon
from obsplan.planning.answers import Answer
from obsplan.planning.companion import Companion, Moored, Turns, told
from obsplan.planning.situation import Situation
from obsplan.planning.team import Team
from obsplan.report import make_exports, write_run
from obsplan.scenario import load, suite
from obsplan.simulation.taped import to_tape

SPEED, RADIUS = 2.0, 10.0
CNA = op.Unicycle(speed=SPEED, min_turn_radius=RADIUS)


# --- the systems of Appendix A --------------------------------------------------------------------


def plain_ekf(run):
    """Means and covariances of the first AUV's filter, by textbook formulas in numpy."""
    tape, table = to_tape(run), run.scenario.table
    dt, ranging = table.time_step, table.ranging
    noise = table.auv[0].process_noise
    walk = [noise.position, noise.position, np.deg2rad(noise.heading_deg), noise.speed]
    Q = np.diag(np.square(walk)) * dt
    x, P = run.mean[0, 0].copy(), run.covariance[0, 0].copy()
    means, covariances = [x], [P]

    def update(x, P, innovation, H, R):
        K = P @ H / (H @ P @ H + R)
        return x + K * innovation, P - np.outer(K, H @ P)

    def wrapped(angle):
        return np.remainder(angle + np.pi, 2 * np.pi) - np.pi

    rows = list(zip(*tape.measurements[:6], strict=True))
    for k, now in enumerate(tape.time[1:], start=1):
        heading, speed = x[2:]
        F = np.eye(4)
        F[:2, 2] = speed * dt * np.array([-np.sin(heading), np.cos(heading)])
        F[:2, 3] = dt * np.array([np.cos(heading), np.sin(heading)])
        move = speed * dt * np.array([np.cos(heading), np.sin(heading)])
        x = x + np.array([*move, tape.turn[0, k - 1], tape.change_of_speed[0, k - 1]])
        P = F @ P @ F.T + Q
        R = np.deg2rad(ranging.heading_sigma_deg) ** 2
        x, P = update(x, P, wrapped(tape.heading[0, k - 1] - x[2]), np.eye(4)[2], R)
        for _, received, _, beacon, sensor, value in rows:
            if received != now:
                continue
            d = x[:2] - tape.pose[beacon, k, :2]
            height = tape.depth[0, k] - tape.beacon_depth[beacon]
            flat2 = d @ d
            if sensor == 0:
                r = np.sqrt(flat2 + height**2)
                H = np.array([*d / r, 0.0, 0.0])
                R = ranging.sigma**2 + (ranging.growth * r) ** 2
                x, P = update(x, P, value - r, H, R)
                continue
            inverted = ranging.bearing_from == "auv"
            seen = np.arctan2(-d[1], -d[0]) - x[2] if inverted else np.arctan2(d[1], d[0])
            H = np.array([-d[1] / flat2, d[0] / flat2, -1.0 if inverted else 0.0, 0.0])
            R = np.deg2rad(ranging.bearing_sigma_deg) ** 2
            x, P = update(x, P, wrapped(value - seen), H, R)
        means.append(x)
        covariances.append(P)
    return np.stack(means), np.stack(covariances)


@pytest.mark.parametrize("name", suite("systems"))
def test_every_system_estimates_as_a_textbook_filter_does(name):
    scenario = load(name, planner="circle", settings=["duration=100"])
    run = op.simulate(scenario)
    mean, covariance = plain_ekf(run)
    assert np.abs(run.mean[0] - mean).max() < 1e-6
    assert np.abs(run.covariance[0] - covariance).max() < 1e-6


# --- what planners know of others -----------------------------------------------------------------


def test_turns_are_where_small_steps_lead_and_the_last_is_held():
    pose, current = op.Pose(3.0, -2.0, 0.4), (0.3, -0.1)
    rates, lasting = (0.1, -0.2, 0.05), (4.0, 3.0, 2.0)
    route = Turns(pose, rates, SPEED, lasting, current)
    dt, x = 1e-3, np.array([pose.x, pose.y, pose.heading])
    walked = [x[:2]]
    for k in range(12_000):
        turn = rates[0] if k < 4000 else rates[1] if k < 7000 else rates[2]
        middle = x[2] + 0.5 * turn * dt
        move = SPEED * np.array([np.cos(middle), np.sin(middle)]) + current
        x = np.array([*x[:2] + dt * move, x[2] + turn * dt])
        walked.append(x[:2])
    times = np.array([0.0, 1.0, 4.0, 6.5, 9.0, 12.0])
    assert np.allclose(route(times), np.array(walked)[(times / dt).round().astype(int)], atol=1e-4)


def test_a_moored_beacon_tells_along_its_line_of_sight_in_the_stage_of_its_slot():
    beacon = Companion(
        route=Moored(30.0, 40.0),
        ranging=Ranging(2.0, loss=0.25),
        schedule=Schedule(interval=10.0, offsets=(3.0,)),
    )
    auv = op.Belief.at(0.0, 0.0)
    known = told([beacon], [auv], 5.0, Stages(np.array([5.0, 5.0]), np.ones(2)))
    u = np.array([0.6, 0.8])
    assert np.abs(known[0]).max() == 0  # from 5 s to 10 s
    assert np.allclose(known[1, 0], 0.75 * np.outer(u, u) / 4.0)  # at 13 s


def test_nothing_known_of_others_changes_nothing():
    planner = InformationHorizon(Situation(CNA))
    auv = op.Belief.at(50.0, 10.0, speed=1.0, covariance=np.diag([9.0, 4.0, 0.01, 0.01]))
    others = [Companion(route=Moored(0.0, 0.0), ranging=None, schedule=Schedule())]
    pose = op.Pose(0.0, 0.0, 0.3)
    one, other = planner.plan(pose, [auv]), planner.plan_among(pose, [auv], others)
    assert (one.turn_rate, one.score) == (other.turn_rate, other.score)


# --- joint plans ----------------------------------------------------------------------------------


def two_at_a_still_auv():
    """Two vehicles near each other that range a still AUV once, and the brute-force values."""
    situation = Situation(CNA, ranging=Ranging(1.0), ping_interval=20.0)
    planner = InformationHorizon(situation, horizon=20.0, stages=1)
    auv = op.Belief.at(0.0, 0.0, covariance=np.diag([1.0, 1.0, 1e-6, 1e-6]))
    poses = [op.Pose(-60.0, 0.0, np.pi / 2), op.Pose(-60.0, -2.0, np.pi / 2)]
    ends = np.empty((2, 7, 2))
    for k, pose in enumerate(poses):
        for j, rate in enumerate(planner._candidates):
            x = np.array([pose.x, pose.y, pose.heading])
            for _ in range(2000):
                middle = x[2] + 0.005 * rate
                x += 0.01 * np.array([SPEED * np.cos(middle), SPEED * np.sin(middle), rate])
            ends[k, j] = x[:2]
    return situation, planner, auv, poses, ends


def trace(*ends):
    """Of the position covariance after a range from each place."""
    J = np.eye(2)
    for end in ends:
        u = end / np.hypot(*end)
        J = J + np.outer(u, u)
    return np.trace(np.linalg.inv(J))


def decided(team, situation, auv, poses):
    """Where each member of a team is at the ping."""

    def ask(k, companions):
        return Answer(team.members[k].plan_among(poses[k], [auv], companions, time=0.0))

    answers = team.decide(poses, [SPEED, SPEED], [situation] * 2, ask)
    return [answer.decision.path[-1, :2] for answer in answers]


def test_of_a_joint_pair_neither_can_do_better_and_no_pair_does_much_better():
    situation, planner, auv, poses, ends = two_at_a_still_auv()
    one, other = decided(Team((planner, planner)), situation, auv, poses)
    joint = trace(one, other)
    rounding = 1e-3  # the second-order error of a range is left out here, and moves it less
    assert joint <= min(trace(end, other) for end in ends[0]) * (1 + rounding)
    assert joint <= min(trace(one, end) for end in ends[1]) * (1 + rounding)
    best = min(trace(a, b) for a in ends[0] for b in ends[1])
    alone = trace(*decided(Team((planner, planner), joint=False), situation, auv, poses))
    assert joint < 1.05 * best < 1.1 * best < alone


def test_a_joint_pair_comes_to_bearings_at_right_angles():
    situation, planner, auv, poses, _ = two_at_a_still_auv()
    rough = Ranging(10.0)  # all is near: what is to come decides nothing
    planner = replace(planner, situation=replace(situation, ping_interval=60.0, ranging=rough))
    auv = replace(auv, covariance=100 * auv.covariance)
    situation = planner.situation
    one, other = decided(Team((planner, planner)), situation, auv, poses)
    cosine = one @ other / np.hypot(*one) / np.hypot(*other)
    assert abs(cosine) < 0.35  # seven turns do not reach every bearing; alike ones have 1


def pair(*settings):
    return load("systems/moving-long-baseline", settings=["duration=90", *settings])


def test_an_object_steers_each_vehicle_in_its_own_situation():
    scenario = pair()
    run = op.simulate(scenario, planner=InformationHorizon(scenario.situation))
    own = op.simulate(scenario)
    assert all((a.pose == b.pose).all() for a, b in zip(run.aids, own.aids, strict=True))


def test_a_whole_mission_of_two_at_once_is_better_than_each_alone():
    settings = ("planner.starts=1", "duration=60")
    found = {}
    for team in ("joint", "alone"):
        scenario = load(
            "systems/moving-long-baseline",
            planner="whole-mission",
            settings=[*settings, f'planner.team="{team}"'],
        )
        found[team] = op.simulate(scenario).cramer_rao_variance.mean()
    assert found["joint"] < 0.99 * found["alone"]


# --- limits between vehicles ----------------------------------------------------------------------


def nearest(run):
    return np.hypot(*(run.aids[0].pose[:, :2] - run.aids[1].pose[:, :2]).T).min()


# One that is not told of the others' plans may be cornered by their turns.
@pytest.mark.parametrize(
    ("planner", "team", "short"),
    [("information", "joint", 0.0), ("information", "alone", 1.0), ("trail", "joint", 1.0)],
)
def test_aid_vehicles_keep_their_distance_from_each_other(planner, team, short):
    known = (f'planner.kind="{planner}"', f'planner.team="{team}"', "duration=150")
    free = op.simulate(pair(*known))
    kept = op.simulate(pair(*known, "constraints.min_separation_cna=15.0"))
    if short:  # joint plans keep them apart by themselves here
        assert nearest(free) < 14.0 - short
    assert nearest(kept) >= 15.0 - 1e-3 - short
    (limit,) = kept.limits
    assert limit.name == "least separation of cna-2 from cna-1"
    assert limit.violation.max() == pytest.approx(15.0 - nearest(kept))


def test_the_least_distance_of_aid_vehicles_is_checked():
    with pytest.raises(op.ObsplanError, match="min_separation_cna"):
        pair("constraints.min_separation_cna=-1.0")


# --- results --------------------------------------------------------------------------------------


def test_every_vehicle_has_its_files(tmp_path):
    run = op.simulate(pair("export.replays=1", 'export.formats=["waypoints", "geojson"]'))
    write_run(run, tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").glob("path*")}
    assert names == {f"path-cna-{k}.{kind}" for k in (1, 2) for kind in ("waypoints", "geojson")}
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out" / "aids.csv").read_text())))
    assert len(rows) == 2 * run.time.size
    for aid, name in zip(run.aids, ("cna-1", "cna-2"), strict=True):
        x = np.array([float(row["x_m"]) for row in rows if row["cna"] == name])
        assert np.abs(x - aid.pose[:, 0]).max() <= 0.5e-6 + 1e-9
    geojson = (tmp_path / "out" / "path-cna-2.geojson").read_text()
    assert '"cna-1"' in geojson
    assert '"cna-2"' in geojson


def test_each_vehicle_is_loaded_with_its_own_path():
    run = op.simulate(pair("export.replays=0"))
    for export, aid in zip(make_exports(run), run.aids, strict=True):
        start = export.simplified.track.points[0]
        assert np.hypot(*(start - aid.pose[0, :2])) < 0.01
