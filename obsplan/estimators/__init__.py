"""Estimators, one file each, as CasADi expressions ``predict`` and ``update``."""

from obsplan.estimators.ekf import Ekf

ESTIMATORS = {"ekf": Ekf}

__all__ = ["ESTIMATORS", "Ekf"]
