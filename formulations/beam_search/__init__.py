"""Search for the turns after which AUVs know best where they are: beam search over constant turns.

Each stage of each sequence is a branching (`.branching`): what the last stage's ranges tell, the
prediction, and what ranges at the end of each turn would tell (`formulations.model.covariance`).
With a compiler the whole search is one call of machine code (`.compiled`).
"""

from .search import Link, search_manoeuvres, turn_candidates
from .selection import Violation
from .to_go import ToGo, cost_to_go

__all__ = [
    "Link",
    "ToGo",
    "Violation",
    "cost_to_go",
    "search_manoeuvres",
    "turn_candidates",
]
