"""The simulated place: a static map, moving obstacles, a robot with a sensor, and the episode they play."""
