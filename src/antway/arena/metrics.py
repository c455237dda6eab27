"""Measures of an episode from its trace, measures of a policy over many episodes, and significance of differences.

Outcome, time, length, smallest clearance and cycle times of an episode are in its `EpisodeResult`.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, stdtrit

from antway import checks
from antway.errors import BadParameter
from antway.world.robots import body_gap
from antway.world.trace import Trace

DISCOMFORT = 0.2  # m; a smaller gap between robot and obstacle counts as discomfort
RESAMPLES = 2000  # number of resamples of the bootstrap
PAIRS = 10  # least number of pairs of episodes for a significant difference
Z95 = 1.959963984540054  # 97.5 % quantile of the standard normal distribution
Interval = tuple[float, float]
Scores = dict[str, NDArray[np.float64]]  # of each policy, on the same episodes in the same order


# Measures of one episode


def gaps(trace: Trace) -> NDArray[np.float64]:
    """Return the distances between the edges of the robot and of each obstacle at each `t`, float64[N + 1, K], m."""
    body = trace.task.robot, trace.xy[:, None, :], trace.heading[:, None]
    return body_gap(*body, trace.obstacle_xy) - trace.obstacle_radius


def discomfort(trace: Trace) -> float:
    """Return the total time in s of the control steps that end less than 0.2 m from an obstacle."""
    if not len(trace.obstacle_id):
        return 0.0
    return float(np.diff(trace.t)[gaps(trace)[1:].min(axis=1) < DISCOMFORT].sum())


def jerk(trace: Trace) -> float:
    """Return the root mean square of the robot's jerk, m/s^3, by second differences of its velocity."""
    whole = trace.velocity[1:-1]  # the last step may be cut short
    if len(whole) < 3:
        return 0.0
    return float(np.sqrt((np.diff(whole, n=2, axis=0) ** 2).sum(axis=1).mean())) / trace.task.robot.dt**2


def side_changes(trace: Trace) -> int:
    """Return how often the robot changed the side on which it would pass an obstacle.

    The side is the sign of the cross product of the vector to the obstacle and the relative velocity. It counts while the two
    approach each other within 3 m and would pass at least 0.1 m off centre at constant velocities.
    """
    side_changes, steps = 0, np.diff(trace.t)[:, None, None]
    offset = (trace.obstacle_xy - trace.xy[:, None, :])[:-1]
    relative = trace.velocity[1:, None, :] - np.diff(trace.obstacle_xy, axis=0) / steps
    speed = np.hypot(relative[..., 0], relative[..., 1])
    cross = relative[..., 0] * offset[..., 1] - relative[..., 1] * offset[..., 0]
    ahead = (relative * offset).sum(axis=2) > 0.0
    counts = ahead & (np.hypot(offset[..., 0], offset[..., 1]) < 3.0) & (np.abs(cross) >= 0.1 * speed)
    for k in range(counts.shape[1]):
        moments = np.flatnonzero(counts[:, k])
        side = np.sign(cross[moments, k])
        same = np.diff(moments) <= 5  # steps; after a longer pause it counts as another encounter
        side_changes += int((same & (np.diff(side) != 0)).sum())
    return side_changes


# Measures of a policy, over rows of the results (antway.arena.store.Row) or anything with the same fields


def wilson(count: int, total: int) -> Interval:
    """Return Wilson's 95 % interval of a rate.

    Wilson: Probable inference, the law of succession, and statistical inference, JASA 1927.

    Examples
    --------
    >>> [round(end, 3) for end in wilson(0, 100)]
    [0.0, 0.037]
    """
    total = checks.integer("total", total, low=0)
    count = checks.integer("count", count, low=0, high=total)
    if total == 0:
        return 0.0, 1.0
    p, n, z = count / total, float(total), Z95
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (0.0 if count == 0 else middle - half), (1.0 if count == total else middle + half)


def bootstrap(values: ArrayLike, tail: float = 0.025) -> Interval:
    """Return the percentile interval of the mean of `values`, float[N], over 2000 resamples; NaN without values.

    Efron: Bootstrap methods, Annals of Statistics 1979. For paired episodes, pass the differences. `tail` is the share of
    resamples beyond each end; by default the interval is of 95 %.
    """
    sample, tail = checks.array("values", values, (None,), finite=False), checks.number("tail", tail, low=0.0, high=0.5)
    if not len(sample):
        return math.nan, math.nan
    rng, n = np.random.default_rng(0), len(sample)
    at_once = max(2**18 // n, 1)  # resamples; all at once would fill gigabytes
    drawn = (rng.integers(0, n, (min(at_once, RESAMPLES - done), n)) for done in range(0, RESAMPLES, at_once))
    means = np.concatenate([sample[rows].mean(axis=1) for rows in drawn])
    low, high = np.quantile(means, (tail, 1.0 - tail))
    return float(low), float(high)


def mean_interval(values: ArrayLike) -> Interval:
    """Return the 95 % interval of the mean of `values`, float[N]: below ten by Student's t, else by `bootstrap`; NaN below two.

    Percentile intervals of few values are too narrow, by the factor by which the normal distribution is narrower than Student's
    t and the sample's spread than the true one. Their tails are chosen to make up for both (Hesterberg: What teachers should
    know about the bootstrap, The American Statistician 2015). They stay within the values, which below ten is too little.
    """
    sample = checks.array("values", values, (None,), finite=False)
    n = len(sample)
    if n < 2:
        return math.nan, math.nan
    if n < PAIRS:
        mean, half = float(sample.mean()), -float(stdtrit(n - 1, 0.025) * sample.std(ddof=1)) / math.sqrt(n)
        return mean - half, mean + half
    return bootstrap(sample, float(ndtr(stdtrit(n - 1, 0.025) * math.sqrt(n / (n - 1)))))


def time_ratio(time: ArrayLike, bound: ArrayLike) -> NDArray[np.float64]:
    """Return times divided by the clairvoyant optimum, which moves on a grid, so that less than 1 is possible."""
    return _ratio("time", time, "bound", bound)


def path_ratio(length: ArrayLike, shortest: ArrayLike) -> NDArray[np.float64]:
    """Return lengths divided by the shortest path among the walls."""
    return _ratio("length", length, "shortest", shortest)


def _ratio(name: str, value: ArrayLike, of: str, base: ArrayLike) -> NDArray[np.float64]:
    """Return value / base, NaN where either is NaN; neither may be below 0."""
    above, below = (checks.array(n, v, (None,), finite=False) for n, v in ((name, value), (of, base)))
    for n, v in ((name, above), (of, below)):
        if (v < 0.0).any():
            raise BadParameter(n, float(v[v < 0.0][0]), ">= 0, or NaN where there is none")
    if len(above) != len(below):
        raise BadParameter(f"{of}.shape", below.shape, f"that of {name}, {above.shape}")
    with np.errstate(divide="ignore", invalid="ignore"):
        return above / below


def real_difference(a: ArrayLike, b: ArrayLike) -> tuple[float, Interval, bool]:
    """Return the mean of a - b over paired episodes, its 95 % interval, and whether it is significant (at least ten pairs)."""
    one = checks.array("a", a, (None,))
    difference = one - checks.array("b", b, one.shape)
    n, (low, high) = len(difference), mean_interval(difference)
    return float(difference.mean()) if n else math.nan, (low, high), n >= PAIRS and not low <= 0.0 <= high


def scored_by_all(scores: Scores) -> NDArray[np.bool_]:
    """Tell in which of the N episodes every policy has a score, bool[N]; policies without any score do not count.

    If no policy has any score, there is no such episode.
    """
    known = np.isfinite(np.array(list(scores.values()), ndmin=2))
    common: NDArray[np.bool_] = known[known.any(axis=1)].all(axis=0) & known.any()
    return common


def ranks(scores: Scores, *, most: bool = True) -> list[tuple[str, float, int]]:
    """Rank policies by their mean score on the same episodes; those whose difference is not significant share a rank.

    Parameters
    ----------
    scores : mapping of policy to float64[N]
        Scores of the same N episodes in the same order, or NaN. Two policies are compared where both have a score.
    most : bool
        Whether more is better.

    Returns
    -------
    list of (policy, mean, rank)
        Best first, policies without any score last. The mean is of the episodes in which every policy has a score
        (`scored_by_all`), NaN if there is none. The rank is 1 plus the number of policies that are significantly better.

    Examples
    --------
    >>> ranks({"a": np.ones(50), "b": np.zeros(50), "c": np.ones(50)})
    [('a', 1.0, 1), ('c', 1.0, 1), ('b', 0.0, 3)]
    """
    sign = 1.0 if most else -1.0
    rank, common = dict.fromkeys(scores, 1), scored_by_all(scores)
    for one, other in combinations(scores, 2):
        both = np.isfinite(scores[one]) & np.isfinite(scores[other])
        mean, _, real = real_difference(scores[one][both], scores[other][both])
        rank[other if sign * mean > 0.0 else one] += real
    never = {name for name, mine in scores.items() if not np.isfinite(mine).any()}
    mean_of = {name: float(mine[common].mean()) if common.any() else math.nan for name, mine in scores.items()}
    order = sorted(scores, key=lambda name: (name in never, rank[name], np.nan_to_num(-sign * mean_of[name]), name))
    return [(name, mean_of[name], rank[name]) for name in order]
