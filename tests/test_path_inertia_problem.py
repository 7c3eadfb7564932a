"""The convex problem: every solver the same answer, no better turn anywhere, certificates that tell the truth, failure as data."""

import math

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import formulations as fm
from formulations import PathInertiaProblem, Status
from formulations.path_inertia.printed import PrintedProgram
from formulations.path_inertia.program import Point, TurnProgram
from formulations.path_inertia.solvers import REDUCED, SOLVERS

DIRECT = ["closed-form", "osqp", "clarabel"]
TOLERANCE = 1e-6  # the stated one: of the turn, relative to its scale
ABEAM = np.array([[3.0, 0.0]])  # with heading north the AUV lies 3 m to the left
NORTH = math.pi / 2

VARIANTS = {
    "plain": {"gamma": 1.0},
    "no penalty": {"gamma": 0.0},
    "steady": {"gamma": 0.3, "change_weight": 2.0},
    "limited": {"gamma": 1.0, "change_weight": 0.5, "max_radius": 8.0, "max_center_distance": 9.0},
    "condition": {"objective": "condition-number"},
    "condition, steady": {"objective": "condition-number", "change_weight": 0.1},
    "condition, limited": {
        "objective": "condition-number",
        "change_weight": 5.0,
        "max_radius": 8.0,
        "max_center_distance": 9.0,
    },
}


@pytest.fixture(params=VARIANTS, scope="module")
def variant(request):
    return VARIANTS[request.param]


def decisions(seed, n):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        m = int(rng.integers(1, 4))
        positions = rng.normal(size=(m, 2)) * rng.choice([0.3, 3.0, 8.0])
        yield (
            positions,
            float(rng.uniform(-4, 4)),
            rng.uniform(0.1, 2, m),
            float(rng.choice([-3.0, 0.7, 6.0, np.inf])),
        )


def stated(variant, decision, radius):
    """Objective as the docstring states it, from centres and inertias, for an array of radii; infinite where a limit is violated."""
    positions, heading, weights, last = decision
    value, feasible = 0.0, np.abs(radius) <= variant.get("max_radius", np.inf) * (1 + 1e-9)
    for (x1, x2), w in zip(positions, weights / weights.sum(), strict=True):
        center = np.array([x1 - radius * math.sin(heading), x2 + radius * math.cos(heading)])
        square = (center**2).sum(axis=0)
        if "objective" in variant:
            value = value + w * (1 + square / (radius**2 / 2))  # ratio of the inertia's eigenvalues
        else:
            value = value + w * (
                square - x1**2 - x2**2 + variant["gamma"] * (square + np.abs(radius))
            )
        feasible &= np.sqrt(square) <= variant.get("max_center_distance", np.inf) * (1 + 1e-9)
    rho = variant.get("change_weight", 0.0)
    if "objective" in variant:
        value = value + rho * (1 / radius - 1 / last) ** 2
    elif math.isfinite(last):
        value = value + rho * (radius - last) ** 2
    return np.where(feasible, value, np.inf)


def test_no_turn_within_the_limits_is_better(variant):
    problem, outcomes = PathInertiaProblem(min_radius=0.5, **variant), set()
    size = np.geomspace(0.5, variant.get("max_radius", 1e5), 4000)
    for decision in decisions(1, 80):
        positions, heading, weights, last = decision
        solution = problem.solve(positions, heading, weights, last_radius=last)
        grid = stated(variant, decision, np.concatenate([size, -size]))
        outcomes.add(solution.status)
        if solution.status == Status.INFEASIBLE:
            assert np.isinf(grid).all()
            continue
        radius = (
            solution.x
            if "objective" not in variant
            else 1 / np.where(solution.x == 0, 1e-12, solution.x)
        )
        near = np.clip(np.abs(radius * (1 + np.array([-1e-3, 1e-3]))), 0.5, None) * np.sign(radius)
        value = stated(variant, decision, radius)[0]
        scale = 1e-9 * (1 + np.abs(value))
        assert value <= min(grid.min(), stated(variant, decision, near).min()) + scale
        assert solution.objective == pytest.approx(value, abs=scale)
        assert np.abs(radius[0]) >= 0.5 * (1 - 1e-15)
    assert outcomes >= (
        {Status.OPTIMAL, Status.INFEASIBLE}
        if "max_radius" in variant
        else {Status.OPTIMAL, Status.CLIPPED}
    )


def assert_same(problems, *decision, **options):
    solutions = {name: problem.solve(*decision, **options) for name, problem in problems.items()}
    expected = solutions["closed-form"]
    for name, solution in solutions.items():
        assert solution.status == expected.status, (name, decision)
        scale = max(0.5, abs(expected.x[0]), np.abs(decision[0]).max())
        np.testing.assert_allclose(
            solution.x, expected.x, atol=TOLERANCE * scale, err_msg=f"{name} {decision}"
        )


def test_all_direct_routes_take_the_same_decision(variant):
    problems = {name: PathInertiaProblem(min_radius=0.5, solver=name, **variant) for name in DIRECT}
    for positions, heading, weights, last in decisions(2, 150):
        assert_same(problems, positions, heading, weights, last_radius=last)


def test_cvxpy_routes_take_the_same_decision(variant):
    problems = {
        name: PathInertiaProblem(min_radius=0.5, solver=name, **variant) for name in SOLVERS
    }
    for positions, heading, weights, last in decisions(3, 12):
        assert_same(problems, positions, heading, weights, last_radius=last)


@pytest.mark.parametrize("gamma", [0.0, 1.0])
def test_routes_agree_in_the_dead_zone_on_its_edges_and_on_ties(gamma):
    problems = {
        name: PathInertiaProblem(min_radius=0.5, gamma=gamma, solver=name) for name in SOLVERS
    }
    tau = gamma / (2 * (1 + gamma))
    for offset in (
        0.0,
        1e-12,
        1e-9,
        1e-3,
        tau,
        tau + 1e-9,
        0.5,
        0.5 + tau,
        0.5 + tau + 1e-3,
        10,
        1e4,
    ):
        for side in (1, -1):
            # heading east: b = −x2 exactly
            assert_same(problems, np.array([[-2.0, -side * offset]]), 0.0)


@pytest.mark.parametrize("name", SOLVERS)
def test_dead_zone_is_left_by_the_sign_of_the_offset_and_to_the_left_on_a_tie(name):
    problem = PathInertiaProblem(min_radius=0.5, gamma=1.0, solver=name)
    for offset, radius in (
        (1e-6, 0.5),
        (-1e-6, -0.5),
        (0.2, 0.5),
        (-0.2, -0.5),
        (-1e-12, 0.5),  # of rounding
        (0.0, 0.5),
        (-0.0, 0.5),
    ):
        solution = problem.solve(np.array([[1.0, -offset]]), 0.0)
        assert (solution.x[0], solution.status) == (radius, Status.CLIPPED)


@pytest.mark.parametrize("gamma", [0.0, 0.2, 5.0])
def test_without_limits_the_problem_is_the_closed_form(gamma):
    problem = PathInertiaProblem(min_radius=0.5, gamma=gamma)
    for positions, heading, weights, _ in decisions(4, 100):
        offset = (
            weights @ fm.lateral_offset(positions[:, 0], positions[:, 1], heading) / weights.sum()
        )
        radius, clipped = fm.path_inertia_radius(float(offset), gamma, 0.5)
        solution = problem.solve(positions, heading, weights)
        assert solution.x[0] == pytest.approx(radius, abs=1e-13)
        assert solution.status == (Status.CLIPPED if clipped else Status.OPTIMAL)


def test_mean_condition_number_reaches_the_turning_limit_as_a_true_constraint():
    problem = PathInertiaProblem(min_radius=5.0, objective="condition-number", solver="clarabel")
    solution = problem.solve(ABEAM, NORTH)  # wants k = b/d² = 1/3
    assert (solution.x[0], solution.status) == (0.2, Status.CLIPPED)
    ahead = problem.solve(np.array([[0.0, -3.0]]), NORTH)
    assert (ahead.x[0], ahead.objective, ahead.status) == (
        pytest.approx(0, abs=1e-12),
        pytest.approx(3),
        Status.OPTIMAL,
    )


def test_a_change_costs_until_the_last_radius_is_kept():
    radii = [
        PathInertiaProblem(min_radius=0.5, change_weight=rho)
        .solve(ABEAM, NORTH, last_radius=-7.0)
        .x[0]
        for rho in (0.0, 1.0, 1e9)
    ]
    np.testing.assert_allclose(radii, [3, -2, -7], rtol=1e-7)  # (b + ρ r_last) / (1 + ρ)
    steady = PathInertiaProblem(min_radius=0.5, change_weight=1.0, objective="condition-number")
    assert steady.solve(ABEAM, NORTH, last_radius=np.inf).x[0] == pytest.approx(2 * 3 / (2 * 9 + 1))


def test_each_auv_may_have_its_own_largest_centre_distance():
    positions = np.array([[3.0, 0.0], [-4.0, 0.0]])  # offsets 3 and −4, both abeam
    solution = PathInertiaProblem(min_radius=0.5, max_center_distance=[1.5, 9.0]).solve(
        positions, NORTH
    )
    assert solution.x[0] == pytest.approx(1.5)  # within 1.5 m of 3, nearest to the mean −0.5
    with pytest.raises(ValueError, match=r"has 2 values for 1 AUVs: give one each"):
        PathInertiaProblem(min_radius=0.5, max_center_distance=[1.5, 9.0]).solve(ABEAM, NORTH)


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("objective", ["difference", "condition-number"])
def test_infeasible_is_a_status_with_advice(name, objective):
    problem = PathInertiaProblem(
        min_radius=0.5, max_center_distance=1.0, max_radius=1.5, solver=name, objective=objective
    )
    for position in (
        [0.0, -2.0],
        [3.0, 0.0],
    ):  # AUV ahead: no centre is near; AUV abeam: none on a circle small enough
        solution = problem.solve(np.array([position]), NORTH)
        assert solution.status == Status.INFEASIBLE
        assert np.isnan(
            [
                *solution.x,
                solution.objective,
                solution.primal_residual,
                solution.dual_residual,
                solution.duality_gap,
            ]
        ).all()
    assert "largest centre distance" in solution.advice


@pytest.mark.slow
def test_another_formulation_with_cones_finds_the_same_radius_or_none():
    """The centre-distance limits as second-order cones, the penalty as a norm, both sides tried: nothing derived by us."""
    problem = PathInertiaProblem(min_radius=0.5, gamma=0.7, max_center_distance=4.0, max_radius=6.0)
    for positions, heading, weights, _ in decisions(5, 15):
        normal, best = np.array([-math.sin(heading), math.cos(heading)]), (np.inf, np.nan)
        for side in (1, -1):
            r = cp.Variable()
            centers = [x + r * normal for x in positions]
            cost = sum(
                w * (1.7 * cp.sum_squares(c) - x @ x + 0.7 * side * r)
                for w, x, c in zip(weights / weights.sum(), positions, centers, strict=True)
            )
            oracle = cp.Problem(
                cp.Minimize(cost),
                [cp.norm(c) <= 4.0 for c in centers] + [side * r >= 0.5, side * r <= 6.0],
            )
            oracle.solve(solver=cp.CLARABEL)
            if oracle.status == "optimal":
                best = min(best, (float(oracle.value), float(r.value)))
        solution = problem.solve(positions, heading, weights)
        assert (solution.status == Status.INFEASIBLE) == math.isinf(best[0])
        np.testing.assert_allclose(
            solution.x[0], best[1], atol=1e-4
        )  # its duality gap is 1e-8 of the objective


@pytest.mark.parametrize("name", SOLVERS)
def test_solution_is_certified_by_its_own_residuals(name, variant):
    problem = PathInertiaProblem(min_radius=0.5, solver=name, **variant)
    for positions, heading, weights, last in decisions(6, 15):
        solution = problem.solve(positions, heading, weights, last_radius=last)
        if solution.status == Status.INFEASIBLE:
            continue
        curvature_scale = 2 * (2 * (positions**2).sum(axis=1).max() + 10)
        residuals = np.array(
            [solution.primal_residual, solution.dual_residual, solution.duality_gap]
        )
        assert (residuals >= 0).all()
        assert (residuals <= TOLERANCE * curvature_scale).all()


def test_gap_is_primal_less_dual_and_bounds_the_error():
    rng = np.random.default_rng(7)
    for _ in range(100):
        lower, upper = np.sort(rng.normal(size=2) * 3)
        program = TurnProgram(rng.normal() * 3, rng.uniform(0, 1), lower, upper)
        point = Point(
            rng.uniform(lower, upper),
            program.threshold * rng.uniform(-1, 1),
            *rng.exponential(size=2),
        )

        def cost(x, c=program):
            return 0.5 * (x - c.center) ** 2 + c.threshold * abs(x)

        def lagrangian(x, c=program, p=point):
            return (
                0.5 * (x - c.center) ** 2
                + p.sign * x
                + p.lower * (c.lower - x)
                + p.upper * (x - c.upper)
            )

        primal, dual, gap = program.certify(point)
        dual_value = minimize_scalar(lagrangian).fun
        best = least(program, (lower, upper))[0]
        step = 1e-5
        assert gap == pytest.approx(cost(point.x) - dual_value, rel=1e-6, abs=1e-9)
        assert dual == pytest.approx(
            abs(lagrangian(point.x + step) - lagrangian(point.x - step)) / (2 * step), abs=1e-6
        )
        assert primal == 0
        assert abs(point.x - best) <= math.sqrt(2 * gap) + 1e-6
        assert max(program.certify(program.optimum())) < 1e-14


def least(program, bounds):
    """Where the program is least within bounds, by search."""
    result = minimize_scalar(
        lambda x: 0.5 * (x - program.center) ** 2 + program.threshold * abs(x),
        bounds=bounds,
        method="bounded",
        options={"xatol": 1e-11},
    )
    return result.x, result.fun


@pytest.mark.parametrize("name", REDUCED)
@pytest.mark.parametrize("absolute", [True, False])
def test_every_solver_solves_programs_without_a_gap(name, absolute):
    """Dead zone included, which the turning limit hides from the problem above."""
    solve, rng = REDUCED[name](absolute), np.random.default_rng(11)
    for center in (0.0, 1e-3, 0.2, 0.31, 2.0, 40.0, 1e5):
        threshold = 0.3 if absolute else 0.0
        lower, upper = np.sort(rng.normal(size=2) * 2).tolist()
        for limits in (
            (-math.inf, math.inf),
            (lower, upper),
            (-0.01, 0.02),
            (0.0, 2.0),
            (0.3 * center - 1, 0.3 * center + 1),
        ):
            for side in (1, -1):
                program = TurnProgram(side * center, threshold, *limits).bounded()
                point = solve(program)
                assert point.x == pytest.approx(
                    least(program, program[2:])[0], abs=TOLERANCE * program.scale
                )


def test_from_an_uneven_gap_the_better_end_is_taken():
    rng, chosen = np.random.default_rng(12), set()
    for _ in range(300):
        sides = [(-9.0, -rng.uniform(0.1, 2)), (rng.uniform(0.1, 2), 9.0)]
        program = TurnProgram(rng.normal() * 0.5, rng.uniform(0, 1), -9.0, 9.0)
        x = program.optimum().x
        if sides[0][1] < x < sides[1][0]:
            best = min(sides, key=lambda side, program=program: least(program, side)[1])
            assert program.choose_side(x, sides) == best
            chosen.add(sides.index(best))
    assert chosen == {0, 1}


def test_a_point_outside_its_limits_says_by_how_much():
    assert TurnProgram(0.0, 0.0, 1.0, 2.0).certify(Point(2.5, 0.0, 0.0, 0.0)).primal == 0.5


class Wrong:
    """A solver that is off by a given amount."""

    def __init__(self, by):
        self.by = by

    def __call__(self, program):
        point = program.optimum()
        return point._replace(x=point.x + self.by)


@pytest.mark.parametrize(
    ("by", "status"),
    [(1e-9, Status.OPTIMAL), (1e-3, Status.INACCURATE), (np.nan, Status.SOLVER_FAILED)],
)
def test_a_solver_is_not_believed(by, status):
    problem = PathInertiaProblem(min_radius=0.5, gamma=1.0)
    object.__setattr__(problem, "compiled", Wrong(by))
    solution = problem.solve(ABEAM, NORTH)
    assert solution.status == status
    if status == Status.SOLVER_FAILED:
        assert solution.x[0] == 2.75  # the closed form's
        assert "closed form" in solution.advice


def test_interior_point_is_called_inaccurate_below_what_it_reaches():
    problem = PathInertiaProblem(min_radius=0.5, gamma=1.0, solver="clarabel", tolerance=1e-13)
    assert problem.solve(ABEAM, NORTH).status == Status.INACCURATE


def test_an_error_inside_cvxpy_is_a_status(monkeypatch):
    problem = PathInertiaProblem(min_radius=0.5, gamma=1.0, solver="cvxpy-osqp")

    def fail(*_, **__):
        raise cp.error.SolverError("no luck")

    monkeypatch.setattr(cp.Problem, "solve", fail)
    assert problem.solve(ABEAM, NORTH).status == Status.SOLVER_FAILED


def test_a_problem_that_would_be_rebuilt_each_time_is_refused(monkeypatch):
    monkeypatch.setattr(cp.Problem, "is_dcp", lambda *_, **__: False)
    with pytest.raises(RuntimeError, match="not DPP"):
        PathInertiaProblem(min_radius=0.5, solver="cvxpy-clarabel")


@pytest.mark.parametrize("name", REDUCED)
def test_an_answer_does_not_depend_on_the_decisions_before_it(name):
    used, rng = REDUCED[name](True), np.random.default_rng(8)
    for _ in range(30):
        program = TurnProgram(
            rng.normal() * rng.choice([1e-9, 3, 1e3, 1e5]),
            0.25,
            *[(0.0, 2.0), (-0.5, 0.5)][rng.integers(2)],
        ).bounded()
        assert used(program) == REDUCED[name](True)(program)  # to the last bit, multipliers too


@pytest.mark.parametrize("name", ["cvxpy-osqp", "cvxpy-clarabel"])
def test_a_kept_cvxpy_program_answers_as_a_new_one(name):
    used = PathInertiaProblem(min_radius=0.5, gamma=0.7, solver=name)
    for positions, heading, weights, _ in decisions(8, 6):
        fresh = PathInertiaProblem(min_radius=0.5, gamma=0.7, solver=name)
        answers = [one.solve(positions, heading, weights).x[0] for one in (used, fresh)]
        assert answers[0] == answers[1]


def test_what_cvxpy_reads_is_the_sum_over_auvs_as_printed(variant):
    """Its own value at any turn, less that at another: what does not depend on the turn is out."""
    problem = PathInertiaProblem(min_radius=0.5, **variant)
    by_curvature, unit, radii = "objective" in variant, 2.5, np.array([-3.0, 0.6, 7.0])
    free = {name: value for name, value in variant.items() if not name.startswith("max")}
    for decision in decisions(13, 6):
        positions, heading, weights, last = decision
        geometry = positions, heading, weights / weights.sum(), last
        told = problem._sum(problem._criterion(*geometry), *geometry)
        printed = PrintedProgram(len(positions), problem.objective, problem.gamma)
        printed._tell(told, TurnProgram(2.0, 0.1, -9.0, 9.0), unit)
        values = []
        for turn in 1 / radii if by_curvature else radii:
            for variable in printed.problem.variables():
                variable.value = (abs(turn) if variable.name() == "size" else turn) / unit
            values.append(printed.problem.objective.value * told.bend * unit**2)
        expected = stated(free, decision, radii)
        np.testing.assert_allclose(np.diff(values), np.diff(expected), rtol=1e-9)


@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_are_silent(name, capfd, variant):
    problem = PathInertiaProblem(min_radius=0.5, solver=name, **variant)
    for positions, heading, weights, last in decisions(9, 5):
        problem.solve(positions, heading, weights, last_radius=last)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("scale", [1e-3, 1e3, 1e6])
def test_routes_agree_at_any_scale(scale):
    problems = {
        name: PathInertiaProblem(min_radius=0.5 * scale, max_radius=9 * scale, solver=name)
        for name in DIRECT
    }
    for positions, heading, weights, _ in decisions(10, 20):
        solutions = [
            problem.solve(scale * positions, heading, weights) for problem in problems.values()
        ]
        np.testing.assert_allclose(
            [s.x[0] / scale for s in solutions], solutions[0].x[0] / scale, atol=TOLERANCE * 10
        )


def test_weights_are_relative_and_a_weightless_auv_counts_only_in_limits():
    problem, positions = PathInertiaProblem(min_radius=0.5), np.array([[3.0, 0.0], [9.0, 0.0]])
    assert problem.solve(positions, NORTH).x[0] == pytest.approx(6)
    assert problem.solve(positions, NORTH, np.array([2.0, 4.0])).x[0] == pytest.approx(7)
    assert problem.solve(positions, NORTH, np.array([5.0, 0.0])).x[0] == pytest.approx(3)
    limited = PathInertiaProblem(min_radius=0.5, max_center_distance=4.0)
    assert limited.solve(positions, NORTH, np.array([5.0, 0.0])).x[0] == pytest.approx(5)


@pytest.mark.parametrize("weights", [None, np.zeros(0)])
def test_without_auvs_there_is_nothing_to_solve(weights):
    assert (
        PathInertiaProblem(min_radius=0.5).solve(np.zeros((0, 2)), 0.0, weights).status
        == Status.NO_TARGETS
    )


def test_when_no_auv_has_weight_there_is_nothing_to_solve():
    assert (
        PathInertiaProblem(min_radius=0.5).solve(ABEAM, 0.0, np.zeros(1)).status
        == Status.NO_TARGETS
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", DIRECT)
def test_what_is_not_finite_is_a_status(bad, name):
    problem = PathInertiaProblem(min_radius=0.5, change_weight=1.0, solver=name)
    two = np.array([[1.0, 2.0], [bad, 0.0]])
    assert problem.solve(two, 0.0).status == Status.INVALID_INPUT
    assert problem.solve(two, 0.0, np.array([1.0, 0.0])).status == Status.INVALID_INPUT
    assert problem.solve(ABEAM, bad).status == Status.INVALID_INPUT
    if not bad < 0:
        assert problem.solve(ABEAM, 0.0, np.array([bad])).status == Status.INVALID_INPUT
    if np.isnan(bad):
        assert problem.solve(ABEAM, 0.0, last_radius=bad).status == Status.INVALID_INPUT


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"min_radius": 0.0}, r"min_radius must be positive \[m\], got 0.0"),
        ({"max_radius": math.nan}, r"max_radius must be positive \[m\], got nan"),
        ({"max_radius": 0.2}, r"max_radius 0.2 m is below min_radius 0.5 m: no turn is left"),
        ({"tolerance": -1.0}, r"tolerance must be positive, got -1.0"),
        ({"gamma": -1.0}, r"gamma must be zero or positive and finite, got -1.0"),
        (
            {"change_weight": math.inf},
            r"change_weight must be zero or positive and finite, got inf",
        ),
        ({"max_center_distance": [3.0, -1.0]}, r"max_center_distance must be positive \[m\], got"),
    ],
)
def test_bad_settings_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        PathInertiaProblem(**{"min_radius": 0.5} | options)


def test_bad_weights_and_last_radius_are_named():
    problem = PathInertiaProblem(min_radius=0.5)
    with pytest.raises(ValueError, match=r"weights must be zero or positive, got \[-1.0\]"):
        problem.solve(ABEAM, 0.0, np.array([-1.0]))
    with pytest.raises(ValueError, match="there are 2 weights for 1 AUVs"):
        problem.solve(ABEAM, 0.0, np.ones(2))
    with pytest.raises(ValueError, match="last_radius must not be zero"):
        problem.solve(ABEAM, 0.0, last_radius=0.0)
