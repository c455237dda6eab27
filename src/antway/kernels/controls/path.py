"""Where a sequence of controls leads, and whether that is another path than the one that is shown."""

from __future__ import annotations

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.controls.lookup import at_goal
from antway.kernels.controls.motion import motion_state, step
from antway.kernels.controls.problem import ControlProblem

_ALIKE = 0.3  # m; two paths that are nowhere farther apart count as the same
_LEAST = 1.0  # s; paths are compared only if both last for this time
_COMPARED = 8  # number of times at which they are compared


@bare_kernel
def path_of(controls: Floats, problem: ControlProblem, began: float, path: Floats) -> None:
    """Write to `path`, float64[S + 1, 3], t, x and y from the start of a sequence on; where it reaches the goal it stays."""
    at, arrived = motion_state(problem.start), False
    path[0, 0], path[0, 1], path[0, 2] = began, at.x, at.y
    for k in range(len(controls)):
        if not arrived:
            at = step(at, controls[k, 0], controls[k, 1], problem.limits, problem.dt)
            arrived = at_goal(problem.field, at)
        path[k + 1, 0], path[k + 1, 1], path[k + 1, 2] = began + (k + 1) * problem.dt, at.x, at.y


@inner_kernel
def _at(path: Floats, t: float, dt: float) -> tuple[float, float]:
    """Return the x and y at a time within a path whose rows are dt s apart."""
    row = min(max((t - path[0, 0]) / dt, 0.0), len(path) - 1.001)
    i = int(row)
    u = row - i
    return path[i, 1] + u * (path[i + 1, 1] - path[i, 1]), path[i, 2] + u * (path[i + 1, 2] - path[i, 2])


@bare_kernel
def same_path(controls: Floats, problem: ControlProblem, began: float, shown: Floats, path: Floats) -> bool:
    """Tell whether a sequence that begins to act at `began` s leads along `shown`; if not, `shown` becomes where it leads.

    `shown` and `path`, which is memory, are as in `path_of`; times are infinite in `shown` if there is no path yet.
    """
    path_of(controls, problem, began, path)
    last = len(path) - 1
    start, end = max(shown[0, 0], began), min(shown[last, 0], path[last, 0])
    alike: bool = end >= start + _LEAST
    for i in range(_COMPARED):
        if alike:
            t = start + (end - start) * i / (_COMPARED - 1)
            (x, y), (shown_x, shown_y) = _at(path, t, problem.dt), _at(shown, t, problem.dt)
            alike = (x - shown_x) * (x - shown_x) + (y - shown_y) * (y - shown_y) < _ALIKE * _ALIKE
    if not alike:
        for k in range(last + 1):
            shown[k, 0], shown[k, 1], shown[k, 2] = path[k, 0], path[k, 1], path[k, 2]
    return alike
