"""antway: robot path planning among moving obstacles. The public names; each is imported when first used."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from antway.version import __version__

if TYPE_CHECKING:
    from antway.ants.front import alternatives as alternatives
    from antway.ants.front import pareto as pareto
    from antway.ants.gridpath import explore as explore
    from antway.ants.tsp import load_tsp as load_tsp
    from antway.ants.tsp import solve_tsp as solve_tsp
    from antway.errors import AntwayError as AntwayError
    from antway.errors import BadInput as BadInput
    from antway.errors import BadMap as BadMap
    from antway.errors import BadParameter as BadParameter
    from antway.errors import BadScenario as BadScenario
    from antway.errors import CellBlocked as CellBlocked
    from antway.errors import InvalidPlan as InvalidPlan
    from antway.errors import OutOfBounds as OutOfBounds
    from antway.errors import TooLarge as TooLarge
    from antway.grid import Grid as Grid
    from antway.grid import Moves as Moves
    from antway.maps import load_costs as load_costs
    from antway.maps import load_map as load_map
    from antway.maps import load_scen as load_scen
    from antway.maps import save_map as save_map
    from antway.planning import PLANNERS as PLANNERS
    from antway.planning import Budget as Budget
    from antway.planning import Plan as Plan
    from antway.planning import Problem as Problem
    from antway.planning import Status as Status
    from antway.planning import TimedPath as TimedPath
    from antway.planning import plan as plan
    from antway.planning import solve as solve
    from antway.search.batch import solve_many as solve_many
    from antway.search.distance_field import distance_field as distance_field
    from antway.search.sipp import sipp as sipp
    from antway.tours.plan import plan_tour as plan_tour
    from antway.tours.time_windows import load_tsptw as load_tsptw
    from antway.tours.time_windows import solve_tsptw as solve_tsptw
    from antway.trajectory.smooth import smooth as smooth
    from antway.verify import check_plan as check_plan
    from antway.verify_drive import check_motion as check_motion
    from antway.verify_episode import check_episode as check_episode
    from antway.verify_tour import check_tour as check_tour
    from antway.verify_tsptw import check_tsptw as check_tsptw
    from antway.view.notebook import show as show
    from antway.view.notebook import to_dataframe as to_dataframe
    from antway.world.episode import EpisodeResult as EpisodeResult
    from antway.world.episode import Outcome as Outcome
    from antway.world.episode import run as run
    from antway.world.policy import POLICIES as POLICIES
    from antway.world.policy import Command as Command
    from antway.world.policy import Decision as Decision
    from antway.world.policy import Observation as Observation
    from antway.world.policy import Policy as Policy
    from antway.world.policy import RobotSpec as RobotSpec
    from antway.world.policy import Task as Task
    from antway.world.policy import Tracks as Tracks
    from antway.world.policy import make_policy as make_policy
    from antway.world.scenario import Scenario as Scenario
    from antway.world.scenario import load_scenario as load_scenario
    from antway.world.world import World as World

_HOME = {
    "errors": "AntwayError BadInput BadMap BadParameter BadScenario CellBlocked InvalidPlan OutOfBounds TooLarge",
    "grid": "Grid Moves",
    "maps": "load_costs load_map load_scen save_map",
    "planning": "PLANNERS Budget Plan Problem Status TimedPath plan solve",
    "search.distance_field": "distance_field",
    "search.batch": "solve_many",
    "search.sipp": "sipp",
    "ants.gridpath": "explore",
    "ants.front": "alternatives pareto",
    "tours.plan": "plan_tour",
    "tours.time_windows": "load_tsptw solve_tsptw",
    "trajectory.smooth": "smooth",
    "verify": "check_plan",
    "verify_episode": "check_episode",
    "verify_drive": "check_motion",
    "verify_tour": "check_tour",
    "verify_tsptw": "check_tsptw",
    "ants.tsp": "load_tsp solve_tsp",
    "view.notebook": "show to_dataframe",
    "world.world": "World",
    "world.scenario": "Scenario load_scenario",
    "world.episode": "EpisodeResult Outcome run",
    "world.policy": "POLICIES Command Decision Observation Policy RobotSpec Task Tracks make_policy",
}
_WHERE = {name: f"antway.{module}" for module, names in _HOME.items() for name in names.split()}
__all__ = ["__version__", *_WHERE]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'antway' has no attribute {name!r}")
    value = getattr(importlib.import_module(_WHERE[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
