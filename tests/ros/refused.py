"""Run in the ROS environment: `antway ros2` with one setting after another that it refuses; prints how each of them ended.

Arguments: the settings, as ROS takes parameters.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys

from antway.cli import main


def ended(setting: str) -> tuple[object, str]:
    """Status and errors of the command with this setting."""
    sys.argv, errors, status = ["antway", "ros2", "--ros-args", "-p", setting], io.StringIO(), None
    with contextlib.redirect_stderr(errors):
        try:
            main()
        except SystemExit as end:
            status = end.code
    return status, errors.getvalue()


if __name__ == "__main__":
    print(json.dumps({setting: ended(setting) for setting in sys.argv[1:]}))
