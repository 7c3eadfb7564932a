"""Options of a study beside a reference: against scipy's test and Holm's rule by hand."""

import numpy as np
import pytest
from scipy.stats import wilcoxon

from obsplan.thesis.paired import FEWEST, compare, seeds, table

RNG = np.random.default_rng(8)
NOISE = RNG.lognormal(size=12)
ERRORS = {
    ("a", "reference"): NOISE,
    ("a", "half"): NOISE * 0.5 * RNG.lognormal(sigma=0.05, size=12),
    ("a", "as good"): NOISE * RNG.lognormal(sigma=0.3, size=12),
    ("b", "reference"): 2.0 * NOISE,
    ("b", "half"): NOISE,
}


def compared():
    return compare(ERRORS, lambda case: (case[0], "reference"))


def test_ratios_are_seed_by_seed_and_to_the_reference_of_the_same_mission():
    told = compared()
    assert told["b", "half"].ratio == pytest.approx(0.5)
    np.testing.assert_allclose(told["b", "half"].ratios, 0.5)
    assert told["a", "half"].ratio == pytest.approx(0.5, rel=0.1)
    assert np.isnan(told["a", "reference"].p)
    assert not told["a", "reference"].differs


def test_chances_are_signed_rank_tests_corrected_by_holm():
    told = compared()
    tested = [case for case in ERRORS if case[1] != "reference"]
    raw = {c: wilcoxon(np.log(ERRORS[c] / ERRORS[c[0], "reference"])).pvalue for c in tested}
    least, middle, greatest = sorted(tested, key=lambda case: raw[case])
    expected = {least: 3 * raw[least]}
    expected[middle] = max(expected[least], 2 * raw[middle])
    expected[greatest] = max(expected[middle], raw[greatest])
    for case in tested:
        assert told[case].p == pytest.approx(min(1.0, expected[case]))
    assert [case[1] for case in tested if told[case].differs] == ["half", "half"]


def test_no_study_has_fewer_seeds_than_can_tell_a_difference():
    """Of n pairs with one sign the two-sided chance is 2^(1 - n)."""
    assert 2.0 ** (1 - FEWEST) < 0.05 < 2.0 ** (2 - FEWEST)
    assert len(seeds(2, 5)) == FEWEST
    assert seeds(100, 7) == range(7, 27)


def test_table_tells_spread_and_chance_of_each_case():
    heading, *rows = table(("mission", "option"), compared())
    assert heading == ["mission", "option", "RMS error [m]", "to the reference"]
    first, median, third = np.quantile(NOISE, [0.25, 0.5, 0.75])
    assert rows[0] == [
        "a", "reference", f"{median:.2f} [{first:.2f}, {third:.2f}]", "the reference"
    ]  # fmt: skip
    assert rows[4][3].startswith("0.50 [0.50, 0.50] times, p ")
