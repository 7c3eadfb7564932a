"""Smoothing: whole tracks by all that was measured, and errors of instruments found with them."""

from obsplan.smoothing.smoothed import Hidden, Smoothed, smooth

__all__ = ["Hidden", "Smoothed", "smooth"]
