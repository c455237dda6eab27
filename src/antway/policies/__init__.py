"""Policies that drive a robot: the paper's, antway's, and the guard that stands behind either."""
