"""The verdict on a vehicle that was recorded at sea: how well it knew where it was."""

from typing import Any

import numpy as np

from obsplan.record import NO_TRUTH
from obsplan.report.consistency import nees_clause
from obsplan.report.words import metres, moment, percent
from obsplan.run import Run, position_variance


def recorded_sentence(run: Run, i: int, figures: dict[str, Any]) -> str:
    """The verdict on one AUV; on its error only where the truth is known."""
    failed = np.flatnonzero(~np.isfinite(run.mean[i]).all(axis=-1))
    if failed.size:
        when = moment(run, int(failed[0]))
        why = "where the filter's estimate stopped being a number"
        return f"{run.names[i]}: position lost {when}, {why}."
    if not run.known[i].any():
        return f"{run.names[i]}: {NO_TRUTH}, and how far off it is is not known; {_own(run, i)}."
    at = int(np.nanargmax(run.error[i]))
    worst = f"worst {metres(figures['max_error_m'])}, {moment(run, at)}"
    clauses = [
        f"position known to {metres(figures['rms_error_m'])} RMS ({worst}){_smoothed(figures)}",
        _covered(run, i),
        nees_clause(run.nees[i], figures["mean_nees"], float(run.independent_errors[i])),
    ]
    return f"{run.names[i]}: {'; '.join(clause for clause in clauses if clause)}."


def _own(run: Run, i: int) -> str:
    """What the filter says of its own error, and the smoother of its."""
    sigma = np.sqrt(position_variance(run.covariance[i]))
    mean, at = float(np.sqrt(np.mean(sigma**2))), int(sigma.argmax())
    said = f"its filter says {metres(mean)} RMS (at most {metres(sigma[at])}, {moment(run, at)})"
    if run.smoothed_covariance is not None:
        after = np.sqrt(np.mean(position_variance(run.smoothed_covariance[i])))
        said += f", and {metres(float(after))} once all ranges are known"
    return said


def _smoothed(figures: dict[str, Any]) -> str:
    after = figures.get("smoothed_rms_error_m")
    return "" if after is None else f", to {metres(after)} once all ranges are known"


def _covered(run: Run, i: int) -> str:
    """For how much of the mission the truth is known, if not for all."""
    share = float(np.mean(run.known[i]))
    return "" if share == 1 else f"the truth is known {percent(share)} of the time"
