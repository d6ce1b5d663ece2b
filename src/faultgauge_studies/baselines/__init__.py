"""Black-box models to compare with: one file each, all the same `begin`/`step` (baseline.py)."""
