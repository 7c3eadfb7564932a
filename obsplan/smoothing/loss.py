"""Losses that keep gross outliers from pulling a track: their costs and weights."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from obsplan.quantities import check_choices
from obsplan.types import ObsplanError

GEMAN_MCCLURE, HUBER, SQUARES = "geman-mcclure", "huber", "squares"
# where a loss departs from the squares [standard deviations]: Huber's is 95 % efficient, Geman's
# and McClure's 94 %
SCALES = {GEMAN_MCCLURE: 4.0, HUBER: 1.345, SQUARES: np.inf}
STEEPER = 2.0  # by how much a loss becomes less convex from one step to the next


@dataclass(frozen=True, kw_only=True)
class Loss:
    r"""Loss of a residual r, in standard deviations.

    Squares: :math:`r^2/2`. Huber's: the same up to the scale c, then straight. Geman's and
    McClure's: :math:`\tfrac12 μ c^2 r^2 / (μ c^2 + r^2)`; it is convex for a large ``convexity`` μ,
    which is lowered step by step to 1 (graduated non-convexity, Yang et al. 2020, eq. 12).
    """

    kind: Literal["geman-mcclure", "huber", "squares"] = GEMAN_MCCLURE
    scale: float = SCALES[GEMAN_MCCLURE]  # c [standard deviations]
    convexity: float = 1.0

    def __post_init__(self) -> None:
        check_choices(self)

    def cost(self, r: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Loss of each residual."""
        c = self.scale
        if self.kind == HUBER:
            return np.where(np.abs(r) <= c, 0.5 * r**2, c * np.abs(r) - 0.5 * c**2)
        if self.kind == SQUARES:
            return 0.5 * r**2
        wide = self.convexity * c**2
        return 0.5 * wide * r**2 / (wide + r**2)

    def weight(self, r: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Weight of each residual's square that has the loss's slope; at most 1."""
        c = self.scale
        if self.kind == HUBER:
            return c / np.maximum(np.abs(r), c)
        if self.kind == SQUARES:
            return np.ones_like(r)
        wide = self.convexity * c**2
        return (wide / (wide + r**2)) ** 2

    def convex(self, r: Float[np.ndarray, " n"]) -> "Loss":
        """The loss made convex for these residuals, of which none is nan."""
        if self.kind != GEMAN_MCCLURE or not r.size:
            return self
        most = float(np.max(r**2))
        return Loss(kind=self.kind, scale=self.scale, convexity=max(1.0, 3 * most / self.scale**2))

    @property
    def steeper(self) -> "Loss":
        """The next one on the way to the loss that is meant."""
        nearer = max(1.0, self.convexity / STEEPER)
        return Loss(kind=self.kind, scale=self.scale, convexity=nearer)


def loss_of(kind: str, scale: float | None) -> Loss:
    """A loss by name; ``scale`` None is its usual one.

    Raises
    ------
    ObsplanError
        An unknown name, or a scale that is not positive.
    """
    if kind not in SCALES:
        raise ObsplanError(f'loss: "{kind}" is none: give one of {", ".join(sorted(SCALES))}')
    usual = SCALES[kind] if scale is None else scale
    if not usual > 0:
        raise ObsplanError(f"scale: {scale} must be positive [standard deviations]: correct it")
    return Loss(kind=kind, scale=float(usual))  # pyright: ignore[reportArgumentType]
