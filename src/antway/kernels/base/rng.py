"""A counter-based random generator (splitmix64), whose state is a uint64[1] array.

Steele, Lea, Flood: Fast splittable pseudorandom number generators, OOPSLA 2014. Streams of different ants or threads come
from `stream(seed, index)`, so results depend on neither the number of threads nor the order in which they run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel

State = NDArray[np.uint64]
GAMMA = np.uint64(0x9E3779B97F4A7C15)  # increment of the state, an odd constant derived from the golden ratio


@kernel
def mix(z: np.uint64) -> np.uint64:
    """Mix 64 bits (the output function of splitmix64)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel
def stream(seed: np.uint64, index: np.uint64) -> np.uint64:
    """Return the start state of stream `index` of `seed`."""
    return mix(np.uint64(seed) + mix(np.uint64(index) + GAMMA))


def make_state(seed: int, index: int) -> State:
    """Return the state of a generator at the start of stream `index` of `seed`."""
    return np.array([stream(np.uint64(seed), np.uint64(index))], np.uint64)


@kernel
def next_bits(state: State) -> np.uint64:
    """Step `state` and return 64 random bits."""
    state[0] += GAMMA
    return mix(state[0])


@kernel
def uniform(state: State) -> float:
    """Step `state` and return a float64 in [0, 1)."""
    return float(next_bits(state) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def below(state: State, n: int) -> int:
    """Step `state` and return an integer in [0, n) (n < 2**31; bias below 2**-32)."""
    return int(((next_bits(state) >> np.uint64(32)) * np.uint64(n)) >> np.uint64(32))
