"""Ant colonies: on the travelling salesman problem and on grids."""
