"""Figures, animations and the replay page."""
