"""A converter of obstacles, as obstacles_converter names one."""

from __future__ import annotations

import numpy as np

from antway.world.policy import Tracks


def read(message) -> tuple[float, Tracks]:
    """Read a PolygonStamped whose points are discs with their radius in z."""
    stamp = message.header.stamp
    points = np.array([[p.x, p.y, p.z] for p in message.polygon.points], np.float64).reshape(-1, 3)
    n = len(points)
    return stamp.sec + stamp.nanosec * 1e-9, Tracks(np.arange(n), points[:, :2], np.full((n, 2), np.nan), points[:, 2])
