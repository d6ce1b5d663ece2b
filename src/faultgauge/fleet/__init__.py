"""The verbs for many units at once: a model for each, and what the fleet tells of its next one.

Importing this loads nothing heavy: a worker of Dask sets the numeric libraries up first.
"""
