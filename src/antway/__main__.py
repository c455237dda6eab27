"""The command `antway`, and `python -m antway`: all is loaded within, so that Ctrl-C is quiet then too."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and exit with its status, 130 where Ctrl-C ends it."""
    try:
        from antway.cli import main as run

        run()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(130)


if __name__ == "__main__":
    main()
