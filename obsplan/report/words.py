"""Numbers as people say them."""

from obsplan.run import Run


def metres(value: float) -> str:
    """A length to three figures or so."""
    return f"{value:.2f} m" if value < 10 else f"{value:.1f} m" if value < 100 else f"{value:.0f} m"


def moment(run: Run, k: int) -> str:
    """When a sample was taken; the start lasts until the first range has come, or for 2 % of the mission."""
    start = 0.02
    if k <= max(run.scenario.ping_every, start * run.time.size):
        return "at the start"
    longest = 600.0  # [s]; more are told in minutes
    return (
        f"after {run.time[k]:.0f} s"
        if run.time[k] <= longest
        else f"after {run.time[k] / 60:.1f} min"
    )


def percent(share: float) -> str:
    """A share in whole percent."""
    return f"{100 * share:.0f} %"
