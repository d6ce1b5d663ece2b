"""A three-axis satellite on reaction wheels: the attitude control system of the paper's Fig 6."""
