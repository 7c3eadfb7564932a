"""Estimators, one file each, as CasADi expressions, and one line in `ESTIMATORS`."""

from obsplan.estimators.ekf import Ekf
from obsplan.estimators.estimator import Estimator, Process
from obsplan.estimators.iterated import IteratedEkf
from obsplan.estimators.second_order import SecondOrderEkf
from obsplan.estimators.sigma_point import SigmaPoint

ESTIMATORS = {
    "ekf": Ekf,
    "iterated-ekf": IteratedEkf,
    "second-order": SecondOrderEkf,
    "sigma-point": SigmaPoint,
}

__all__ = [
    "ESTIMATORS",
    "Ekf",
    "Estimator",
    "IteratedEkf",
    "Process",
    "SecondOrderEkf",
    "SigmaPoint",
]
