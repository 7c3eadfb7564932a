r"""What a Gramian counts of a range: the share of what one would tell that surely comes.

.. math:: w(r) = p(r) \, σ^2(0) / σ^2(r),

with the probability p that the range arrives and the standard deviation σ that grows with distance
(`formulations.model.ranging`). It is 1 where neither depends on the distance and none is lost.
"""

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.casadi import of_each, symbol
from ..model.ranging import EDGE, NUMBERS, Form, Law, Ranging, arrival, law, variance


def counts(form: Form) -> bool:
    """Whether the share is not 1 everywhere."""
    return form.growing or form.lossy


def share(law: Law, r2: Any) -> Any:
    """Share by the squared range, an expression."""
    return arrival(law, r2, edge=EDGE) * law.sigma**2 / variance(law, r2)


def shares(ranging: Ranging, r2: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """`share` of an array."""
    return of_each(_share(ranging.form), np.array(ranging.numbers), r2)[0]


@cache
def _share(form: Form) -> ca.Function:
    numbers, r2 = symbol("law", NUMBERS), symbol("r2")
    return ca.Function("share", [numbers, r2], [share(law(form, numbers), r2)])
