"""Programs for other machines, printed from the step that runs in Python."""
