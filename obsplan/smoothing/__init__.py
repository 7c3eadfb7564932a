"""Smoothing: whole tracks by all that was measured, and errors of instruments found with them."""

from obsplan.smoothing.calibrate import Calibration, calibrate
from obsplan.smoothing.smoothed import Hidden, Smoothed, smooth

__all__ = ["Calibration", "Hidden", "Smoothed", "calibrate", "smooth"]
