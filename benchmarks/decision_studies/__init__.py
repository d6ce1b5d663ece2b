"""How well the bank decides: named faults, honest silence, undeclared faults, error, coverage."""
