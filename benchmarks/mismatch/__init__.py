"""Plants that are not their models: simulated here, apart from faultgauge's own simulator."""
