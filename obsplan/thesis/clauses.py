"""Claims in clauses, each a mark of missions between bounds, judged by the share of seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsplan.thesis.montecarlo import interval, judged

Numbers = dict[str, np.ndarray]  # marks by name, each by seed


@dataclass(frozen=True, kw_only=True)
class Clause:
    """Part of what a figure claims: a mark, and between which bounds it must be."""

    text: str
    mark: str
    above: float = -np.inf
    below: float = np.inf

    def holds(self, numbers: Numbers) -> np.ndarray:
        """Whether it does, by seed."""
        values = numbers[self.mark]
        return (values > self.above) & (values < self.below)


def verdict(clauses: Sequence[Clause], numbers: Numbers) -> bool | None:
    """True if every clause holds in most seeds, at 95 %; False if none does; None between."""
    judgements = [judged(float(held.mean()), held.size) is True for held in each(clauses, numbers)]
    return True if all(judgements) else None if any(judgements) else False


def each(clauses: Sequence[Clause], numbers: Numbers) -> list[np.ndarray]:
    """Whether each clause holds, by seed."""
    return [clause.holds(numbers) for clause in clauses]


def turned_over(assumed: float, share: float, n: int) -> bool:
    """Whether a share of n is on the other side of a half, and apart from it at 95 %."""
    low, high = interval(share, n)
    fell = share < 0.5 <= assumed and high < assumed
    rose = assumed < 0.5 < share and low > assumed
    return bool(fell or rose)
