"""A tour as plain data, for JSON on the command line, the page, and files."""

from __future__ import annotations

from typing import Any

from antway.tours.plan import TourPlan


def tour_record(tour: TourPlan) -> dict[str, Any]:
    """Return `tour` as numbers, strings and lists.

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Grid, plan_tour
    >>> tour = plan_tour(Grid(np.zeros((1, 9), dtype=bool)), (0.5, 0.5), [(8.5, 0.5), (3.5, 0.5)], cycles=10)
    >>> [visit["name"] for visit in tour_record(tour)["routes"][0]["visits"]]
    ['stop 1', 'stop 0']
    """
    task = tour.task
    routes = [
        {
            "length": route.length,
            "duration": route.duration,
            "visits": [
                {
                    "stop": stop,
                    "name": task.names[stop],
                    "xy": task.stops[stop].tolist(),
                    "arrival": float(route.arrival[n]),
                    "waiting": float(route.waiting[n]),
                    "window": task.windows[stop].tolist(),
                    "service": float(task.service[stop]),
                }
                for n, stop in enumerate(route.order.tolist())
            ],
            "legs": [plan.xy(task.grid).tolist() for plan in route.legs],
        }
        for route in tour.routes
    ]
    return {
        "length": tour.length,
        "duration": tour.duration,
        "cost": tour.cost,
        "bound": tour.bound,
        "gap": tour.gap,
        "feasible": tour.feasible,
        "lateness": tour.lateness,
        "collected": tour.collected,
        "skipped": list(tour.skipped),
        "elapsed": tour.elapsed,
        "routes": routes,
    }
