"""The tables of names: planners, policies and suites, where each is found, and what each is in one sentence.

Help texts and the tables in docs/ are made from these. This module imports nothing, so that `antway --help` stays quick.
"""

from __future__ import annotations

from collections.abc import Iterable

PLANNERS: dict[str, str] = {
    "dijkstra": "antway.search.distance_field:dijkstra",
    "astar": "antway.search.astar:astar",
    "jps": "antway.search.jps:jps",
    "subgoals": "antway.search.subgoals:subgoals",
    "anyangle": "antway.search.anyangle:anyangle",
    "dstarlite": "antway.search.dstarlite:dstarlite",
    "ants": "antway.ants.gridpath:ants",
}

POLICIES: dict[str, str] = {
    "paper": "antway.policies.paper.policy:PaperPolicy",
    "antway": "antway.policies.antway.policy:AntwayPolicy",
    "follow": "antway.baselines.replan:Follow",
    "stop": "antway.baselines.replan:Stop",
    "replan": "antway.baselines.replan:Replan",
    "dstarlite": "antway.baselines.replan:DStarLite",
    "sipp": "antway.baselines.replan:Sipp",
    "potential-field": "antway.baselines.potential_field:PotentialField",
    "neural": "antway.baselines.neural:Neural",
    "glasius": "antway.baselines.neural:Glasius",
    "dwa": "antway.baselines.dwa:Dwa",
    "mppi": "antway.baselines.mppi:Mppi",
    "orca": "antway.baselines.orca:Orca",
    "nh-orca": "antway.baselines.orca:NhOrca",
    "oracle": "antway.baselines.oracle:Oracle",
}

NEED_PYRVO = ("orca", "nh-orca")  # policies that need a package of the extra `arena`

ROBOTS: tuple[str, ...] = (  # specifications and sources in antway.world.robots
    "holonomic",
    "inertia",
    "diff",
    "turtlebot3_burger",
    "turtlebot3_waffle",
    "turtlebot4",
    "jackal",
    "amr",
)

SHIPPED_SCENES: tuple[str, ...] = ("paper", "office", "warehouse", "rounds")

WARM: tuple[str, ...] = ("plan", "run", "robots", "tours", "baselines")  # kinds of kernels that `antway warmup` compiles

SUITES: dict[str, str] = {
    "paper": "antway.arena.environments:paper",
    "synthetic": "antway.arena.synthetic:synthetic",
    "crossing": "antway.arena.crossing:crossing",
    "encounters": "antway.arena.encounters:encounters",
    "maps": "antway.arena.environments:maps",
    "tracks": "antway.arena.environments:tracks",
    "barn": "antway.arena.environments:barn",
}
OF_FILES = ("maps", "tracks")  # suites made from a file, named as maps:FILE and tracks:FILE

ABOUT: dict[str, dict[str, str]] = {  # what each name means, for docs/guide.md
    "planners": {
        "dijkstra": "exact: Dijkstra's distance field from the start, stopped at the goal",
        "astar": "exact: A* with canonical successors, for all kinds of moves",
        "jps": "the default, exact: jump point search on open maps, A* on cluttered ones",
        "subgoals": "exact: a contraction hierarchy over the map's corners, for many queries on one map",
        "anyangle": "exact: the shortest path at any angle, by Polyanya",
        "dstarlite": "exact: D* Lite, which keeps its search when cells change",
        "ants": "an ant colony; slower than all of the above, and optimal only where its bound proves it",
    },
    "policies": {
        "paper": "the paper's Steps 1-8: a local target, and ants on the cells of the sensed window",
        "antway": "the default: predicts obstacles, plans by ants in space and time, and checks commands by a guard",
        "follow": "follows the shortest path and ignores what moves",
        "stop": "follows the shortest path and stops when an obstacle is near",
        "replan": "plans anew in each cycle, as if sensed obstacles stood still",
        "dstarlite": "the same as `replan`, by D* Lite, which keeps its search",
        "sipp": "exact search in space and time, anew in each cycle",
        "potential-field": "descends a potential in which the goal attracts and obstacles repel",
        "neural": "climbs the activity of a shunting neural network over the grid",
        "glasius": "climbs the activity of Glasius' neural network over the grid",
        "dwa": "the dynamic window approach: the best of the velocities in reach",
        "mppi": "model predictive path integral control on the robot's own dynamics",
        "orca": "optimal reciprocal collision avoidance (needs pyrvo)",
        "nh-orca": "ORCA for robots on wheels, which follow its velocities (needs pyrvo)",
        "oracle": "knows the future and drives the optimum",
    },
    "suites": {
        "paper": "the shipped scenes, with speeds and phases drawn at random",
        "synthetic": "16 x 16 m with discs that bounce: three kinds of map, three densities, turners, noise, speed",
        "crossing": "CrowdNav's circle and square: five humans steered by ORCA who do not see the robot",
        "encounters": "one meeting each: head-on, doorway, overtaking, ambush, crossing flow, standing crowd, pursuer",
        "maps": "any map file with discs that bounce, in three densities",
        "tracks": "recorded pedestrians: an ETH/UCY `obsmat.txt`, lines frame id x y, or CSV lines t,id,x,y in s and m",
        "barn": "fields of cylinders, as in BARN, with discs that move between key frames",
    },
}


def names(table: Iterable[str]) -> str:
    """Return the names in a table for a help text, those of `OF_FILES` with their file."""
    return ", ".join(f"{name}:FILE" if table is SUITES and name in OF_FILES else name for name in table)
