"""Why (4.6) prints that a heading perturbation leaves the range unchanged: angles in degrees.

With the heading in degrees, as state and as output, the Gramian is D W D with D = diag(1, 1, π/180)
and W that of radians whose heading output is in degrees. Near the AUV little is left of the
coupling of heading into position, and its condition number is least at the turn rate of the
printed Gramian. The thesis turns and adds angles in degrees, (3.13) and (4.7).
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Integer
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from formulations.gramian.range import DEGREE, range_gramians
from formulations.metrics import condition_number
from obsplan.planning.fallback import two_thirds_turn
from obsplan.report.style import AID, plain_decades
from obsplan.thesis import claims
from obsplan.thesis.drawing import draw_tracks, guide, panels
from obsplan.thesis.flights import fly, random_starts, scenario
from obsplan.thesis.horizon import HALF_WIDTH, RAN_AWAY, STARTS, settled
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import interval
from obsplan.vehicles import Unicycle

if TYPE_CHECKING:
    import xarray as xr

POSES = 4000
FAR = 20.0  # [m]; a wider square of poses than HALF_WIDTH
TURN_RATES = 11
CNA = Unicycle(speed=1.0, min_turn_radius=0.5)  # thesis chapter 5
# How many units of the heading a radian is: radians, degrees, and others to see the trend.
UNITS = (0.1, 1.0, 2.0, 5.0, 10.0, 20.0, 1.0 / DEGREE, 200.0, 1000.0)
# of the poses, for 95 % intervals: the same decision nearly always, nearly never
MOSTLY, HARDLY = 0.9, 0.1
CONTROLS = {
    "state alone": "the state alone in degrees, its output in radians",
    "shuffled": "the printed choice of another pose",
}
GRAMIANS = {
    "exact": "Heading in radians",
    "degrees": "Heading in degrees",
    "thesis": "As printed in (4.6)",
}

MARK = "#0072B2"

Choices = Integer[np.ndarray, " M"]


def choice(W: Float[np.ndarray, "K M 3 3"]) -> Choices:
    """Index of the turn rate whose Gramian has the least condition number, at each pose."""
    return condition_number(W).argmin(axis=0)


def in_unit(
    x: Float[np.ndarray, "M 2"], per_radian: float, *, output: bool = True
) -> Float[np.ndarray, "K M 3 3"]:
    """Return D W D: Gramians with the heading in a unit of which a radian has so many.

    Positions [m] are the aid vehicle's relative to the AUV, in its body frame. Without ``output``
    the heading's measurement stays in radians.
    """
    unit = 1.0 / per_radian
    variances = (unit**2 if output else 1.0, 1.0)
    D = np.diag([1.0, 1.0, unit])
    return D @ gramians(x, variances=variances) @ D


def gramians(
    x: Float[np.ndarray, "M 2"],
    variant: str = "exact",
    variances: tuple[float, float] = (1.0, 1.0),
) -> Float[np.ndarray, "K M 3 3"]:
    """Return the Gramians of the thesis's vehicle and horizon at each turn rate, in radians."""
    limit = CNA.max_turn_rate
    return range_gramians(
        x,
        0.0,
        turn_rates=np.linspace(limit, -limit, TURN_RATES),
        speed=CNA.speed,
        horizon=two_thirds_turn(CNA),
        variant=variant,
        variances=variances,
    )


def in_body_frame(seed: int, half_width: float) -> Float[np.ndarray, "M 2"]:
    """Relative positions [m], ahead and to the left of the heading, at random poses."""
    starts = random_starts(POSES, seed, half_width)
    s, b = claims.offsets(np.array([[start.x, start.y, start.heading] for start in starts]))
    return np.column_stack([s, -b])


def compute(*, runs: int, seed: int) -> "xr.Dataset":
    """How often each unit chooses as the printed Gramian does, and flights from random starts."""
    import xarray as xr

    x, afar = in_body_frame(seed, HALF_WIDTH), in_body_frame(seed, FAR)
    printed = choice(gramians(x, variant="thesis"))
    printed_afar = choice(gramians(afar, variant="thesis"))
    same = [float((choice(in_unit(x, unit)) == printed).mean()) for unit in UNITS]
    state_alone = choice(in_unit(x, 1.0 / DEGREE, output=False))
    control = [
        float((state_alone == printed).mean()),
        float((np.roll(printed, 1) == printed).mean()),
    ]
    share_afar = float((choice(in_unit(afar, 1.0 / DEGREE)) == printed_afar).mean())
    starts = random_starts(min(runs, STARTS), seed, HALF_WIDTH)
    rates = f"planner.turn_rates={TURN_RATES}"
    flown = [
        fly(
            scenario("fixed-auv", "gramian", f'planner.gramian="{name}"', rates, "duration=60.0"),
            starts,
        )
        for name in GRAMIANS
    ]
    tracks = xr.concat(flown, dim=xr.DataArray(list(GRAMIANS), dims="gramian", name="gramian"))
    explained = {"units": "1", "long_name": "share of poses with the printed Gramian's turn rate"}
    return tracks.assign(
        share=("unit", same, explained),
        control_share=("control", control, explained),
        share_afar=((), share_afar, explained),
    ).assign_coords(unit=list(UNITS), control=list(CONTROLS))


def draw(data: "xr.Dataset") -> Figure:
    """The share over the heading's unit, and the paths of the three Gramians.

    Paths that do not settle about the AUV are orange.
    """
    figure, axes = panels(2, rows=2, width=4.2, height=3.8)
    draw_shares(axes[0], data)
    for one, (name, title) in zip(axes[1:], GRAMIANS.items(), strict=True):
        flown = data.sel(gramian=name)
        done = settled(flown)
        draw_tracks(one, flown, [AID if good else RAN_AWAY for good in done], lw=0.6)
        one.set(xlim=(-10.0, 10.0), ylim=(-10.0, 10.0))
        one.set_aspect("equal", adjustable="box")
        one.set_title(f"{title}: {done.sum()} of {done.size} settle (black)")
    return figure


def draw_shares(axes: Axes, data: "xr.Dataset") -> None:
    """Shares of each unit, its interval, and what chance gives."""
    share, unit = data.share.values, data.unit.values
    low, high = np.transpose([interval(value, POSES) for value in share])
    axes.set_xscale("log")
    plain_decades(axes.xaxis)
    axes.errorbar(unit, share, [share - low, high - share], color=AID, marker="o", ms=4, lw=0.9)
    for at, name in ((1.0, "radians"), (1.0 / DEGREE, "degrees")):
        axes.axvline(at, color=MARK, lw=0.9, ls=":", zorder=1)
        axes.annotate(
            name, (at, 0.5), xytext=(-2, 0), textcoords="offset points", color=MARK,
            rotation=90, ha="right", va="center", fontsize=8,
        )  # fmt: skip
    guide(axes, float(data.control_share.sel(control="shuffled")), "by chance")
    axes.set_title("Turn rate the same as by (4.6)")
    axes.set(
        xlabel="Units of the heading in one radian [-]",
        ylabel="Share of random poses [-]",
        ylim=(-0.03, 1.03),
    )


def found(data: "xr.Dataset") -> Finding:
    """Degrees choose as printed, radians do not, nor do the controls."""
    radian, degree = (float(data.share.sel(unit=unit)) for unit in (1.0, 1.0 / DEGREE))
    controls = data.control_share.values
    apart = max(interval(value, POSES)[1] for value in (radian, float(controls[0])))
    agrees = interval(degree, POSES)[0] > MOSTLY and apart < HARDLY
    done = {name: int(settled(data.sel(gramian=name)).sum()) for name in GRAMIANS}
    others = "; ".join(
        f"{CONTROLS[name]}: {said(value)}" for name, value in zip(CONTROLS, controls, strict=True)
    )
    return Finding(
        agrees=bool(agrees),
        sentence=(
            f"Of {POSES} random poses within ±{HALF_WIDTH:g} m of the AUV and {TURN_RATES} turn "
            "rates, the Gramian with the heading in degrees, as state and output, picks the "
            f"printed one's in {said(degree)}, the one in radians in {said(radian)} (95 % "
            f"intervals by Wilson). Controls: {others}. Of {data.sizes['start']} starts "
            f"{done['thesis']} settle on a circle about the AUV as printed, {done['degrees']} in "
            f"degrees, {done['exact']} in radians. The coupling grows with the distance: within "
            f"±{FAR:g} m degrees pick the printed turn rate in {said(float(data.share_afar))}. "
            "Near the AUV a computation in degrees decides as (4.6) does; that the thesis was "
            "computed so is likely, and not proven."
        ),
    )


def said(share: float) -> str:
    """A share of the poses and its interval, in per cent."""
    low, high = interval(share, POSES)
    return f"{100 * share:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


ITEMS = (
    Item(
        name="eq4.6",
        title="What the printed Gramian (4.6) leaves out, and degrees",
        claim=(
            "(4.6) has 0 where a perturbed heading moves the later positions and so the range; "
            "(3.13) and (4.7) have angles in degrees."
        ),
        compute=compute,
        draw=draw,
        found=found,
    ),
)
