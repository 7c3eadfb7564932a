"""Figures 2.1, A.1, A.2 and (4.6) in degrees: they agree, and do not where they are broken on purpose."""

import numpy as np
import pytest

from obsplan.thesis import ITEMS, baselines, degrees


def agrees(name):
    item = ITEMS[name]
    return item.found(item.compute(runs=2, seed=3)).agrees


@pytest.mark.parametrize("name", ["figA.1", "figA.2"])
def test_ranges_tell_what_the_thesis_says(name):
    assert agrees(name)


@pytest.mark.parametrize("name", ["figA.1", "figA.2"])
def test_ranges_of_another_speed_of_sound_do_not(monkeypatch, name):
    heard = baselines.came
    monkeypatch.setattr(
        baselines, "came", lambda run: heard(run)._replace(slant=1.1 * heard(run).slant)
    )
    assert not agrees(name)


def test_planar_ranges_are_of_slant_ranges_and_depths_and_slant_ranges_are_not_planar():
    item = ITEMS["fig2.1"]
    data = item.compute(runs=2, seed=3)
    np.testing.assert_allclose(data.planar**2 + data.height**2, data.slant**2, rtol=1e-12)
    assert item.found(data).agrees
    assert not item.found(data.assign(planar=data.slant)).agrees


def test_image_of_a_single_beacon_stays_until_the_auv_turns(monkeypatch):
    monkeypatch.setattr(baselines, "TURNED", baselines.LEG)
    assert not agrees("figA.2")


def test_position_of_exact_ranges_is_exact_and_its_covariance_that_of_the_bearings():
    known = np.array([[-100.0, -100.0], [250.0, -100.0], [75.0, 350.0]])
    place, sigma = np.array([40.0, 120.0]), np.array([1.0, 2.0, 3.0])
    away = place - known
    ranges = np.hypot(*away.T)
    found, covariance, misfit = baselines.fix(known, ranges, sigma, (0.0, 0.0))
    np.testing.assert_allclose(found, place, atol=1e-5)  # where the solver ends
    assert misfit < 1e-9
    bearings = away / ranges[:, None]
    information = sum(np.outer(u, u) / s**2 for u, s in zip(bearings, sigma, strict=True))
    np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-5)


def test_degrees_explain_the_printed_gramian(monkeypatch):
    monkeypatch.setattr(degrees, "POSES", 400)
    assert agrees("eq4.6")
    monkeypatch.setattr(degrees, "DEGREE", 1.0)  # a radian called a degree
    assert not agrees("eq4.6")
