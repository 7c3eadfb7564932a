"""Figures 2.1, A.1 and A.2: the geometry of a range, and what ranges of one or more beacons tell.

Each is drawn from a mission of a shipped scenario, by ranges as they were measured. Positions are
found from them by least squares alone, without a filter.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from formulations.consistency import mean_interval
from formulations.model.ranging import law_of, variance
from obsplan.report.style import AID, FAINT, colour
from obsplan.run import Run
from obsplan.scenario import load
from obsplan.scenario.beacons import law_told
from obsplan.simulation import simulate
from obsplan.thesis.drawing import panels
from obsplan.thesis.item import Finding, Item

if TYPE_CHECKING:
    import xarray as xr

SURE = 0.999  # probability of the band that holds what is consistent
STEEP = 1.5  # horizontal over vertical distance of the range that Figure 2.1 shows
SHOWN = 37  # round of ranges that Figure A.1 shows
TURNED = 26  # ranges until the AUV is well on its second leg
LEG = 14  # ranges on its first leg
FEWEST = 3  # ranges of which two unknowns are found, and a misfit
ALIKE, APART = 4.0, 9.0  # differences of misfit: two standard deviations, three
CIRCLES = (1, 6, 24)  # ranges of which Figure A.2 shows the circles
AUV, BEACON, IMAGE = colour(0), colour(1), colour(3)

Points = Float[np.ndarray, "n 2"]


class Ranges(NamedTuple):
    """Ranges that came to a mission's only AUV, a column for each time."""

    time: Float[np.ndarray, " k"]  # [s]
    auv: Float[np.ndarray, "k 2"]  # where it was [m]
    height: Float[np.ndarray, "b k"]  # of each beacon above the AUV [m]
    slant: Float[np.ndarray, "b k"]  # [m]
    sigma: Float[np.ndarray, "b k"]  # [m]

    @property
    def planar(self) -> Float[np.ndarray, "b k"]:
        """Planar ranges [m] by slant ranges and heights; 0 where the height is longer."""
        return np.sqrt(np.maximum(self.slant**2 - self.height**2, 0.0))

    @property
    def planar_sigma(self) -> Float[np.ndarray, "b k"]:
        """Their standard deviations [m], to first order."""
        return self.sigma * self.slant / np.maximum(self.planar, self.sigma)


def came(run: Run) -> Ranges:
    """The rounds in which all beacons were heard, at the ends of their pings."""
    scenario, beacons = run.scenario, run.scenario.beacons
    law = law_of(law_told(scenario.planner_sensor, scenario.planner_ranging))
    at = np.isfinite(run.ranges[:, 0]).all(axis=0)
    slant = run.ranges[:, 0, at]
    up = scenario.depths[at, 0] - np.array([[beacon.depth] for beacon in beacons])
    sigma = np.sqrt(variance(law, slant**2))
    return Ranges(run.time[at], run.true[0, at, :2], up, slant, sigma)


def fix(
    known: Points,
    ranges: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
    guess: Any,
    least_east: float = -np.inf,
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, "2 2"], float]:
    """Position [m] at these ranges of known positions by least squares, its covariance, the misfit.

    The misfit is the weighted sum of squares. The nearest solution to the guess is found, not west
    of ``least_east`` [m].
    """
    from scipy.optimize import least_squares

    def residuals(p: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " n"]:
        return (np.hypot(*(p - known).T) - ranges) / sigma

    bounds = (least_east, -np.inf), (np.inf, np.inf)
    fit = least_squares(residuals, guess, bounds=bounds)
    return fit.x, np.linalg.inv(fit.jac.T @ fit.jac), float(2.0 * fit.cost)


def compute_geometry(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 2.1: slant ranges by two-way travel times to a surface vehicle that moves."""
    import xarray as xr

    scenario = load(
        "systems/single-beacon",
        settings=(
            'ranging.timing="two-way"',
            "ranging.turn_around=0.2",
            "cna.transducer_depth=0.0",
            "planner.interval=5.0",
            "duration=900.0",
        ),
    )
    run = simulate(scenario, seed=seed)
    found = came(run)
    at = np.isin(run.time, found.time)
    apart = np.hypot(*(run.true[0, at, :2] - run.cna[at, :2]).T)
    return xr.Dataset(
        {
            "height": ("time", found.height[0], {"units": "m"}),
            "slant": ("time", found.slant[0], {"units": "m"}),
            "planar": ("time", found.planar[0], {"units": "m"}),
            "sigma": ("time", found.planar_sigma[0], {"units": "m"}),
            "apart": ("time", apart, {"units": "m", "long_name": "true planar separation"}),
        },
        coords={"time": ("time", found.time, {"units": "s"})},
        attrs={"seed": seed},
    )


def draw_geometry(data: "xr.Dataset") -> Figure:
    """One range seen from the side, and all ranges against the true separations."""
    figure, (side, all_of_them) = panels(2, width=4.6, height=3.6)
    draw_side(
        side, data.isel(time=int(np.argmin(np.abs(data.planar - STEEP * data.height).values)))
    )
    far = 1.05 * float(data.slant.max())
    all_of_them.plot([0.0, far], [0.0, far], color=FAINT, lw=1.0, label="equal")
    for name, paint, label in (
        ("slant", BEACON, "slant range rₛ, as measured"),
        ("planar", AUV, "planar range r, of rₛ and h"),
    ):
        all_of_them.plot(data.apart, data[name], "o", ms=4, mfc="none", mec=paint, label=label)
    all_of_them.set(
        xlabel="True planar separation [m]", ylabel="Range [m]", xlim=(0.0, far), ylim=(0.0, far)
    )
    all_of_them.set_aspect("equal", adjustable="box")
    all_of_them.set_title("All ranges of the mission")
    all_of_them.legend(loc="lower right", fontsize=8)
    return figure


def draw_side(axes: Axes, one: "xr.Dataset") -> None:
    """Aid vehicle at the surface, AUV at depth, and the three distances."""
    r, h = float(one.planar), float(one.height)
    axes.axhline(0.0, color=colour(5), lw=2.0)
    axes.plot([0.0, r], [-h, 0.0], color=BEACON, lw=1.6)
    axes.plot([0.0, r], [0.0, 0.0], color=AUV, lw=2.4)
    axes.plot([0.0, 0.0], [-h, 0.0], color=FAINT, lw=1.6, ls="--")
    axes.plot(0.0, -h, marker="*", ms=13, color="black", ls="")
    axes.plot(r, 0.0, marker="s", ms=9, color=AID, ls="")
    texts = (
        ((0.45 * r, 0.0), (0, 5), f"planar range r = {r:.1f} m", "center", "bottom"),
        ((0.0, -h / 2), (-5, 0), f"depth h = {h:.1f} m", "right", "center"),
        ((r / 2, -h / 2), (6, -6), f"slant range rₛ = {float(one.slant):.1f} m", "left", "top"),
        ((0.0, -h), (0, -9), "AUV", "center", "top"),
        ((r, 0.0), (2, 8), "aid vehicle (CNA)", "left", "bottom"),
    )
    for place, offset, text, ha, va in texts:
        axes.annotate(text, place, offset, textcoords="offset points", ha=ha, va=va, fontsize=8)
    axes.set(xlim=(-0.7 * r, 1.7 * r), ylim=(-1.4 * h, 0.5 * h))
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlabel="Along the line of sight [m]", ylabel="Up [m]")
    axes.set_title(f"One range, {float(one.time):.0f} s into the mission")


def found_geometry(data: "xr.Dataset") -> Finding:
    """Planar ranges are of slant ranges and depths, to the noise; slant ranges are not planar."""
    usable = (data.planar > 2.0 * data.sigma).values  # else the root of a difference is no Gaussian
    error = (data.planar - data.apart).values[usable]
    squares = (error / data.sigma.values[usable]) ** 2
    low, high = mean_interval(error.size, degrees=1, probability=SURE)
    longer = (data.slant - data.apart).values[usable]
    taken_as_planar = float(((longer / data.sigma.values[usable]) ** 2).mean())
    return Finding(
        agrees=bool(low < squares.mean() < high < taken_as_planar),
        sentence=(
            f"Of {data.sizes['time']} slant ranges by two-way travel times, (2.10) and (2.11), and "
            f"the AUV's depth of {float(data.height[0]):g} m come planar ranges that err by "
            f"{np.sqrt((error**2).mean()):.2f} m (RMS): {squares.mean():.2f} of their variance, "
            f"where chance allows {low:.2f} to {high:.2f}. Taken as planar, the slant ranges are "
            f"{longer.mean():.1f} m too long on average, {taken_as_planar:.1f} of it. "
            f"({error.size} ranges count: those not nearly overhead, where r is lost in the noise.)"
        ),
    )


def compute_long_baseline(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure A.1: a position of each round of ranges to three moored beacons."""
    import xarray as xr

    run = simulate(load("systems/long-baseline"), seed=seed)
    found = came(run)
    known = np.array([beacon.place for beacon in run.scenario.beacons])
    fixes = [
        fix(known, ranges, sigma, known.mean(axis=0))
        for ranges, sigma in zip(found.planar.T, found.planar_sigma.T, strict=True)
    ]
    position, covariance, _ = map(np.array, zip(*fixes, strict=True))
    return xr.Dataset(
        {
            "beacon_place": (("beacon", "axis"), known, {"units": "m"}),
            "planar": (("beacon", "time"), found.planar, {"units": "m"}),
            "auv_place": (("time", "axis"), found.auv, {"units": "m"}),
            "fix": (("time", "axis"), position, {"units": "m"}),
            "covariance": (("time", "axis", "other"), covariance, {"units": "m2"}),
        },
        coords={"time": ("time", found.time, {"units": "s"})},
        attrs={"seed": seed},
    )


def draw_long_baseline(data: "xr.Dataset") -> Figure:
    """Beacons, the circles of one round of ranges where they meet, and all positions found."""
    figure, (plan, errors) = panels(2, width=5.2, height=5.0)
    one = data.isel(time=SHOWN)
    for k, (place, r) in enumerate(zip(data.beacon_place.values, one.planar.values, strict=True)):
        plan.plot(*circle(place, float(r)), color=BEACON, lw=0.9, ls="--",
                  label=None if k else "range to each at one time")  # fmt: skip
    plan.plot(*data.beacon_place.values.T, "^", ms=9, color=BEACON, label="beacon, place known")
    plan.plot(*data.auv_place.values.T, color=AUV, lw=1.2, label="AUV's survey")
    plan.plot(*data.fix.values.T, ".", ms=4, color=FAINT, label="position by least squares")
    plan.plot(*one.auv_place.values, "*", ms=12, color="black", label="AUV at that time")
    seen_from_above(plan, "Long baseline, from above")
    error = np.hypot(*(data.fix - data.auv_place).values.T)
    errors.plot(data.time, error, "o", ms=3.5, mfc="none", mec=FAINT, label="error of a position")
    spread = np.sqrt(np.trace(data.covariance.values, axis1=1, axis2=2))
    errors.plot(data.time, spread, color=AID, lw=1.2, label="its standard deviation")
    errors.set(xlabel="Time [s]", ylabel="Error of a position [m]", ylim=(0.0, None))
    errors.set_title("Error of each round's position")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def found_long_baseline(data: "xr.Dataset") -> Finding:
    """Each round gives a position, as precise as the geometry promises."""
    error = (data.fix - data.auv_place).values
    squares = np.einsum("ti,tij,tj->t", error, np.linalg.inv(data.covariance.values), error)
    low, high = mean_interval(squares.size, degrees=2, probability=SURE)
    expected = np.sqrt(np.trace(data.covariance.values, axis1=1, axis2=2).mean())
    return Finding(
        agrees=bool(low < squares.mean() < high),
        sentence=(
            f"Least squares of {data.sizes['beacon']} ranges at once, and nothing else, give a "
            f"position in each of {squares.size} rounds. They err by "
            f"{np.sqrt((error**2).sum(axis=1).mean()):.2f} m (RMS), where ranges and geometry "
            f"promise {expected:.2f} m: a mean normalised squared error of {squares.mean():.2f}, "
            f"where chance allows {low:.2f} to {high:.2f}."
        ),
    )


def compute_single_beacon(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure A.2: where a single beacon is, by more and more ranges on the AUV's way."""
    import xarray as xr

    run = simulate(load("systems/single-beacon", planner="stationary"), seed=seed)
    found, beacon = came(run), run.cna[0, :2]
    auv, ranges, sigma = (
        found.auv[:TURNED],
        found.planar[0, :TURNED],
        found.planar_sigma[0, :TURNED],
    )
    line = float(auv[:LEG, 0].mean())  # east of the first leg, which runs north
    image = np.array([2.0 * line - beacon[0], beacon[1]])
    counts = np.arange(FEWEST, TURNED + 1)
    fits = {
        side: [fix(auv[:n], ranges[:n], sigma[:n], guess, least) for n in counts]
        for side, guess, least in (("beacon", beacon, -np.inf), ("image", image, line))
    }
    return xr.Dataset(
        {
            "auv_place": (("ping", "axis"), auv, {"units": "m"}),
            "planar": ("ping", ranges, {"units": "m"}),
            "beacon_place": ("axis", beacon, {"units": "m"}),
            "fix": (
                ("side", "count", "axis"),
                np.array([[fit[0] for fit in fits[side]] for side in fits]),
                {"units": "m"},
            ),
            "misfit": (
                ("side", "count"),
                np.array([[fit[2] for fit in fits[side]] for side in fits]),
                {"units": "1"},
            ),
            "covariance": (("axis", "other"), fits["beacon"][-1][1], {"units": "m2"}),
        },
        coords={"count": counts, "side": list(fits)},
        attrs={"seed": seed},
    )


def draw_single_beacon(data: "xr.Dataset") -> Figure:
    """The AUV's way, circles of some ranges, where the beacon may be; and the misfits."""
    figure, (plan, misfits) = panels(2, width=5.2, height=5.0)
    for k, ping in enumerate(CIRCLES):
        one = data.isel(ping=ping)
        plan.plot(*circle(one.auv_place.values, float(one.planar)), color=BEACON, lw=0.9, ls="--",
                  label=None if k else "range, about where it was measured")  # fmt: skip
    plan.plot(*data.auv_place.values.T, color=AUV, lw=1.2, marker=".", ms=5, label="AUV, at ranges")
    plan.plot(*data.auv_place.values[list(CIRCLES)].T, "o", ms=7, mfc="none", mec=AUV)
    plan.plot(*data.beacon_place.values, "s", ms=8, color=AID, label="beacon")
    leg = data.sel(count=LEG)
    plan.plot(*leg.fix.sel(side="image").values, "s", ms=9, mfc="none", mec=IMAGE, mew=1.6,
              label="its image: fits the first leg as well")  # fmt: skip
    plan.plot(*data.fix.sel(side="beacon").values[-1], "x", ms=9, color=BEACON, mew=2.0,
              label="found by all ranges")  # fmt: skip
    seen_from_above(plan, "Single beacon, from above")
    for side, paint in (("beacon", AID), ("image", IMAGE)):
        misfits.plot(data["count"], data.misfit.sel(side=side), color=paint, marker="o", ms=3.5,
                     lw=1.0, label=f"fit on the side of the {side}")  # fmt: skip
    misfits.axvline(LEG, color=FAINT, lw=1.0, ls=":")
    misfits.annotate("the AUV turns", (LEG, 0.95), (-4, 0), textcoords="offset points",
                     xycoords=("data", "axes fraction"), ha="right", fontsize=8)  # fmt: skip
    misfits.set(xlabel="Ranges taken", ylabel="Misfit χ² [-]", ylim=(0.0, None))
    misfits.set_title("Which side the beacon is on")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def found_single_beacon(data: "xr.Dataset") -> Finding:
    """A straight leg leaves two places, a turn one, and that is where the beacon is."""
    rival = data.misfit.sel(side="image") - data.misfit.sel(side="beacon")
    on_leg, after = float(rival.sel(count=LEG)), float(rival.isel(count=-1))
    off = data.fix.sel(side="beacon").values[-1] - data.beacon_place.values
    square = float(off @ np.linalg.inv(data.covariance.values) @ off)
    _, high = mean_interval(1, degrees=2, probability=SURE)
    image = data.fix.sel(side="image", count=LEG).values
    return Finding(
        agrees=bool(abs(on_leg) < ALIKE and after > APART and square < high),
        sentence=(
            f"After the {LEG} ranges of a straight leg the beacon's image ({image[0]:.0f}, "
            f"{image[1]:.0f}) fits as well as its place (difference of χ² {on_leg:.1f}): one range "
            f"is a circle, and ranges from a line do not tell its sides. After {TURNED} ranges, "
            f"the last ones on the next leg, the image is out by {after:.0f}, and the beacon is "
            f"found {np.hypot(*off):.1f} m from where it is. The AUV's own track is taken as "
            "known here; in missions a filter has its dynamics."
        ),
    )


def circle(center: Float[np.ndarray, " 2"], radius: float) -> Points:
    """East and north of a circle [m], two rows."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    return center[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)])


def seen_from_above(axes: Axes, title: str) -> None:
    """A map's axes."""
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlabel="East [m]", ylabel="North [m]")
    axes.set_title(title)


GEOMETRY = Item(
    name="fig2.1",
    title="Geometry of AUV and aid vehicle",
    claim=(
        "The AUV measures its depth h and the slant range rₛ, by travel times (2.10) and the speed "
        "of sound (2.11); the planar range r follows from them."
    ),
    compute=compute_geometry,
    draw=draw_geometry,
    found=found_geometry,
)
BASELINES = (
    Item(
        name="figA.1",
        title="Long baseline localization, from above",
        claim=(
            "Distances to two or more beacons at known places combine into the vehicle's position, "
            "for example by nonlinear least squares."
        ),
        compute=compute_long_baseline,
        draw=draw_long_baseline,
        found=found_long_baseline,
    ),
    Item(
        name="figA.2",
        title="Moving long baseline localization: a single beacon",
        claim=(
            "With a single beacon the vehicle has to estimate the beacon's position by "
            "measurements that are separated in space, and needs its own dynamics."
        ),
        compute=compute_single_beacon,
        draw=draw_single_beacon,
        found=found_single_beacon,
    ),
)
