"""Whole jobs, made of the verbs: a check of one log against another, and the demonstration."""
