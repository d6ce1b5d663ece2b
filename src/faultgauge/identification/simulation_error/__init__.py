"""Simulation error: records and windows, unknowns as one vector, the search, what it is worth."""
