"""The paper's case study, from excitation to fault estimates, as `faultgauge reproduce` runs it."""
