"""What to do about a fault while the loop is closed: feed-forward, rescaling, redundancy,
allocation. Every policy is a pure `init` and `step` inside the simulated loop."""
