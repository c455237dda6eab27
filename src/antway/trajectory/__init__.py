"""From a path to a motion: shortcuts, speed profiles, nonlinear programs."""
