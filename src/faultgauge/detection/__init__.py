"""Residuals, calibration, estimates and events."""
