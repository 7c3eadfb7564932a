"""Observability Gramians of any dynamics and measurement.

They are exact by forward sensitivities, or empirical by central differences.
"""

from .empirical import empirical_gramian
from .exact import ExactGramian, exact_gramian
from .samples import quadrature_weights

__all__ = ["ExactGramian", "empirical_gramian", "exact_gramian", "quadrature_weights"]
