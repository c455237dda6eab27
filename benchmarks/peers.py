"""What the comparisons with OR-Tools and PyVRP (extra `peers`) share."""

from __future__ import annotations

from typing import Any


def guided_search(seconds: float, first: str = "PATH_CHEAPEST_ARC") -> Any:
    """Return OR-Tools' parameters of guided local search for so many seconds from the first solution of that strategy."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = getattr(routing_enums_pb2.FirstSolutionStrategy, first)
    parameters.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    parameters.time_limit.FromMilliseconds(int(1000 * seconds))
    return parameters


def ortools_route(manager: Any, model: Any, found: Any, vehicle: int = 0) -> list[int]:
    """Return the nodes of a vehicle's route in a solution of OR-Tools, from its start up to the last before its end."""
    nodes, at = [], model.Start(vehicle)
    while not model.IsEnd(at):
        nodes.append(manager.IndexToNode(at))
        at = found.Value(model.NextVar(at))
    return nodes


def pyvrp_routes(found: Any) -> list[list[int]]:
    """Return the clients of each route in a result of PyVRP, numbered from 1."""
    return [[stop.idx + 1 for stop in route if stop.is_client()] for route in found.best.routes()]
