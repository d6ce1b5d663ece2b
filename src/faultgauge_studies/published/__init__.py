"""Public benchmarks of nonlinear system identification, beside published results and peers."""
