"""Equation error: each equation fitted on its own, its instruments and what it is worth."""
