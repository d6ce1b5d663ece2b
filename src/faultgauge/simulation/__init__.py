"""Integrators and free runs."""
