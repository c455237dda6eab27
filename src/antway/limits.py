"""Limits of the numbers that describe a world, so that no computation overflows or takes for ever."""

from __future__ import annotations

MAX_SPEED = 1000.0  # m/s; no obstacle and no robot may be faster
MIN_SPEED = 1e-9  # m/s; least speed of a moving obstacle, besides 0
MAX_PLACE = 1e10  # m; limit of coordinates, slightly beyond the farthest origin of a map
MAX_ORIGIN = 1e6  # m; limit of an episode's map; 5e6 m off, floats are 1e-9 m apart, as the tolerances at walls are
MAX_TIME = 1e9  # s; no motion, delay or horizon may be longer
MAX_AHEAD = 1e3  # s; limit of how far ahead the policies antway and paper look
MAX_STAY = 60.0  # s; limit of the time for which a robot is to stand at its goal
MIN_PERIOD = 1e-6  # s; least period of control and sensors; sensors may have 0, which means every control cycle
MAX_CLOCK = 1e12  # s; limit of the times of observations, from any zero of the clock
MAX_ANGLE = 1e6  # rad, rad/s; limit of headings and turn rates
MAX_TRACKS = 10_000  # limit of obstacles in an observation
MAX_DEPTH = 32  # limit of nested brackets, and of parts of a dotted key in a TOML file
MAX_PAGE_SEED = 2**53 - 1  # limit of seeds on the live pages: JavaScript rounds greater integers
MAX_LISTS = 1_000_000  # limit of lists and tables in a TOML or JSON file
MAX_TABLES = 30_000  # limit of the headed tables in a TOML file, each of which takes a hundred times its bytes
