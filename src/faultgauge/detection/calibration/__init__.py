"""What healthy logs say of a model: noise, discrepancy, alarm level, doubts."""
