"""Whether a filter knows how wrong it is, in words: NEES by the truth, NIS by its own ranges."""

import numpy as np
from jaxtyping import Float

from formulations.consistency import mean_interval
from obsplan.ranged import ALARM, Nis, Ranged
from obsplan.report.words import percent
from obsplan.run import Run

TELLING = 4.0  # mean NEES, 2 if consistent, of errors sqrt(2) times too large: to be told apart
INSIDE = 5.991  # NEES on the 95 % ellipse: chi-square with 2 degrees
BY_CHANCE = 1e-3  # probability of so few changes of sign, below which they are no chance
MOST_BEACONS = 3  # told one by one


def nees_clause(nees: Float[np.ndarray, " samples"], mean: float | None, samples: float) -> str:
    """Whether errors are what the filter says, as far as so many independent ones tell."""
    if mean is None or not np.isfinite(samples):
        return ""
    low, high = mean_interval(samples, degrees=2)
    evidence = f"about {samples:.0f} independent error{'s' if round(samples) != 1 else ''}"
    if low <= mean <= high and high > TELLING:
        return f"whether its filter is consistent cannot be told (NEES {mean:.3g} of {evidence})"
    chance = f"NEES {mean:.3g}; chance allows {low:.1f} to {high:.1f} for {evidence}"
    if low <= mean <= high:
        return f"filter consistent ({chance})"
    word = "overconfident" if mean > high else "cautious"
    inside = percent(float(np.mean(nees[np.isfinite(nees)] <= INSIDE)))
    return f"filter {word} ({chance}; inside its 95 % ellipse {inside} of the time)"


def filter_notes(run: Run) -> list[str]:
    """Say which ranges filters rejected and why, whether the others fit, and what they announced.

    Of a simulation in which all were taken and fit, nothing is said of them.
    """
    notes = []
    if run.ranged is not None:
        for i, name in enumerate(run.names):
            notes += _range_notes(name, run.ranged.of(auv=i), always=run.is_replay)
    return [*notes, *_hidden_notes(run), *run.announcements]


def _hidden_notes(run: Run) -> list[str]:
    """What filters found out at last besides positions, headings and speeds."""
    notes = []
    for name, states in run.hidden.items():
        told = [
            f"{state} {one['value']:.3g} ± {one['sigma']:.2g} {one['unit']}".removesuffix(" 1")
            for state, one in states.items()
        ]
        notes.append(f"{name}: its filter found, at the end, {', '.join(told)}.")
    return notes


def _range_notes(name: str, own: Ranged, *, always: bool) -> list[str]:
    nis = own.nis
    fits = nis is None or nis.is_inside
    if not own.fate.size or (fits and not own.rejected and not always):
        return []
    clauses = [_rejections(own)]
    if nis is not None:
        which = "those taken" if own.rejected else "they"
        clauses.append(f"{which} {_fit(nis)}{_odd_beacons(own)}")
        clauses += _lasting(own)
    notes = [f"{name}: {'; '.join(clauses)}."]
    if own.alarms:
        notes.append(_alarm(name, own, replayed=always))
    return notes


def _alarm(name: str, own: Ranged, *, replayed: bool) -> str:
    """That something is wrong, how it shows, and where to look for it."""
    nis, found = own.nis, f"rejected {percent(own.share_rejected)} of its ranges"
    if own.share_rejected <= ALARM and nis is not None:
        found = f"misses its ranges by {np.sqrt(nis.mean):.1f} times what it expects"
    calibrate = ", or by --calibrate whether ranges are too long or too short in proportion"
    return (
        f"Alarm: the filter of {name} {found}. Something that it counts on is wrong: look at "
        "headings, first estimate, beacons, units, speed of sound and noise"
        f"{calibrate if replayed else ''}."
    )


def _rejections(own: Ranged) -> str:
    """How many ranges came, and how many were rejected for what."""
    came = own.fate.size
    if not own.rejected:
        return f"all of its {came} ranges were taken"
    reasons = ", ".join(f"{count} {fate.words}" for fate, count in own.rejected.items())
    count = sum(own.rejected.values())
    return f"of {came} ranges {count} {'was' if count == 1 else 'were'} rejected ({reasons})"


def _lasting(own: Ranged) -> list[str]:
    """Beacons whose innovations keep their sign for longer than chance allows."""
    runs = {own.beacons[b]: own.of(beacon=b).runs for b in own.heard}
    lasting = [name for name, one in runs.items() if one.z < 0 and one.p < BY_CHANCE]
    if not lasting:
        return []
    more = f" and {len(lasting) - MOST_BEACONS} more" if len(lasting) > MOST_BEACONS else ""
    named = f"{', '.join(lasting[:MOST_BEACONS])}{more}"
    return [f"those of {named} keep their sign, as by a bias or an error of the track that lasts"]


def _fit(nis: Nis) -> str:
    """Whether ranges differ from what was expected as far as the filter allows for."""
    if nis.is_inside:
        word = "as"
    else:
        word = "more than" if nis.mean > nis.high else "less than"
    chance = f"chance allows {nis.low:.2f} to {nis.high:.2f} for {nis.samples}"
    return f"scatter {word} its filter expects (NIS {nis.mean:.3g}; {chance})"


def _odd_beacons(own: Ranged) -> str:
    """Beacons whose ranges scatter more than expected, the worst first."""
    if len(own.heard) < 2:
        return ""
    per_beacon = [(own.beacons[b], own.of(beacon=b).nis) for b in own.heard]
    odd = [(name, nis.mean) for name, nis in per_beacon if nis and nis.mean > nis.high]
    odd.sort(key=lambda one: -one[1])
    if not odd:
        return ""
    named = ", ".join(f"{name} (NIS {mean:.3g})" for name, mean in odd[:MOST_BEACONS])
    more = f" and {len(odd) - MOST_BEACONS} more" if len(odd) > MOST_BEACONS else ""
    return f", the most those of {named}{more}"
