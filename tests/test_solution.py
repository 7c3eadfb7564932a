"""What every solver returns: a status that tells the user what to do, and numbers only where there is a solution."""

import numpy as np
import pytest

from formulations import Solution, Status


@pytest.mark.parametrize("status", Status)
def test_every_status_has_a_label_for_files_and_a_sentence_of_advice(status):
    assert status.label == status.name.lower().replace("_", "-")
    assert len(status.advice.split()) >= 5


def test_codes_are_those_that_compiled_functions_and_files_carry():
    assert [(status.value, status.label) for status in Status][:8] == [
        (0, "optimal"),
        (1, "clipped"),
        (2, "inaccurate"),
        (3, "infeasible"),
        (4, "unobservable"),
        (5, "no-targets"),
        (6, "invalid-input"),
        (7, "solver-failed"),
    ]


def test_a_missing_solution_carries_its_status_and_no_number():
    missing = Solution.missing(Status.INFEASIBLE, n=3)
    assert missing.status == Status.INFEASIBLE
    assert missing.x.shape == (3,)
    assert np.isnan(
        [
            *missing.x,
            missing.objective,
            missing.primal_residual,
            missing.dual_residual,
            missing.duality_gap,
        ]
    ).all()


def test_advice_is_the_solvers_own_where_it_knows_more_and_general_elsewhere():
    own = {Status.INFEASIBLE: "widen the corridor"}
    infeasible, optimal = (
        Solution(x=np.zeros(1), objective=0.0, status=status, remedies=own)
        for status in (Status.INFEASIBLE, Status.OPTIMAL)
    )
    assert infeasible.advice == "widen the corridor"
    assert optimal.advice == Status.OPTIMAL.advice


@pytest.mark.parametrize("status", Status)
def test_general_advice_names_no_option_that_only_one_planner_has(status):
    for option in ("closed form", "largest radius", "centre distance", "fatrop", "IPOPT"):
        assert option not in status.advice
