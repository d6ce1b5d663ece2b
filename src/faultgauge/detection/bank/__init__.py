"""The hypotheses: which faults, how far the plant is from its model, where it is trusted."""
