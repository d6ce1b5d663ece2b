"""From logs to a fitted model."""
