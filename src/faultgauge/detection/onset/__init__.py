"""In hindsight: when the faults of a whole log began, windows of change, their evidence."""
