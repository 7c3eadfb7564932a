"""What follows from the states of AUVs and filters: first values and estimates, process noise."""

import numpy as np
from jaxtyping import Float

from obsplan.estimators.hidden import DEPTH
from obsplan.scenario.scenario import Scenario
from obsplan.vehicles import STATES, State, States

BASIC = len(STATES)


def own(states: States) -> list[State]:
    """The components a state has besides `STATES`."""
    return [*states.values()][BASIC:]


def first_truth(
    scenario: Scenario, survey: Float[np.ndarray, "auvs 4"]
) -> Float[np.ndarray, "auvs n"]:
    """True states at time 0, from the survey's."""
    return _widened(survey, [state.start for state in own(scenario.truth_states)])


def noise(
    scenario: Scenario, states: States, *, assumed: bool = False
) -> Float[np.ndarray, "auvs n"]:
    """Standard deviations of the states' random walks per square root of a second.

    They are the truth's, or those that the filter assumes.
    """
    return _widened(scenario.process_noise(assumed=assumed), [state.walk for state in own(states)])


def first_covariance(scenario: Scenario, states: States) -> Float[np.ndarray, "auvs n n"]:
    """Covariance of the first estimates of some states."""
    nothing = np.zeros((len(scenario.table.auv), BASIC))
    basic = scenario.first_estimates(nothing, nothing)[1]
    P = np.zeros((len(basic), len(states), len(states)))
    P[:, :BASIC, :BASIC] = basic
    P[:, range(BASIC, len(states)), range(BASIC, len(states))] = [
        state.sigma**2 for state in own(states)
    ]
    return P


def first_mean(
    scenario: Scenario, truth: Float[np.ndarray, "auvs n"], error: Float[np.ndarray, "auvs n"]
) -> Float[np.ndarray, "auvs m"]:
    """The filters' first means.

    A state that the AUV has is the truth plus a standard normal error times its sigma, unless it is
    given. A state that only the filter has begins at its ``start``.
    """
    basic = scenario.first_estimates(truth[:, :BASIC], error[:, :BASIC])[0]
    mean = _widened(basic, [state.start for state in own(scenario.filter_states)])
    names = [*scenario.truth_states]
    for i, (name, state) in enumerate(scenario.filter_states.items()):
        if name == DEPTH:
            mean[:, i] = scenario.depths[0]
        elif i >= BASIC and name in names:
            mean[:, i] = truth[:, names.index(name)] + state.sigma * error[:, names.index(name)]
    return mean


def _widened(
    basic: Float[np.ndarray, "auvs 4"], values: list[float]
) -> Float[np.ndarray, "auvs n"]:
    """Rows of the four, and the same values after each."""
    return np.hstack([basic, np.tile(np.array(values, dtype=float), (len(basic), 1))])
