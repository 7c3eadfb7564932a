"""Observability Gramians of any dynamics and measurement, and the input that makes them best.

They are exact by forward sensitivities, or empirical by central differences.
"""

from .choice import choose_input
from .empirical import empirical_gramian
from .exact import ExactGramian, exact_gramian
from .samples import quadrature_weights
from .simulated import SimulatedGramian

__all__ = [
    "ExactGramian",
    "SimulatedGramian",
    "choose_input",
    "empirical_gramian",
    "exact_gramian",
    "quadrature_weights",
]
