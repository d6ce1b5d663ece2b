"""From the bank to probabilities, intervals, a status and the faults that are named."""
