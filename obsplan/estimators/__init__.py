"""Estimators, one file each, as CasADi expressions, and one line in `ESTIMATORS`."""

from obsplan.estimators.ekf import Ekf
from obsplan.estimators.estimator import Estimator, Process

ESTIMATORS = {"ekf": Ekf}

__all__ = ["ESTIMATORS", "Ekf", "Estimator", "Process"]
