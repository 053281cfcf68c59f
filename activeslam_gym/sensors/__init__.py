"""Sensors: what measures the true world, chosen by ``scenario.sensor``, and their models, which planners ask."""
