"""How large a number may be that describes a world: one table, so that no arithmetic on it overflows or takes for ever."""

from __future__ import annotations

MAX_SPEED = 1000.0  # m/s; no obstacle and no robot may be faster
MIN_SPEED = 1e-9  # m/s; an obstacle that is slower says so by 0
MAX_PLACE = 1e10  # m; coordinates of points lie within this, a little beyond the farthest origin that a map may have
MAX_TIME = 1e9  # s; no motion, delay or horizon may be longer
MAX_STAY = 60.0  # s; for which a robot is to stand at its goal
MIN_PERIOD = 1e-6  # s; of control and of sensors, but for the 0 that says: at once
MAX_CLOCK = 1e12  # s; times of observations lie within this, counted from wherever a clock begins
MAX_ANGLE = 1e6  # rad, rad/s; headings and turn rates
MAX_TRACKS = 10_000  # obstacles that an observation may hold
MAX_DEPTH = 32  # brackets within brackets, and parts of a dotted key, of a TOML file
MAX_LISTS = 1_000_000  # lists and tables of a TOML or JSON file
