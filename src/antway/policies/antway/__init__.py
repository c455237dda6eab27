"""Policy `antway`: ants in space and time."""
