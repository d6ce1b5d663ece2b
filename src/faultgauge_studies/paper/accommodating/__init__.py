"""What the paper leaves to future work: accommodation based on the estimate."""
