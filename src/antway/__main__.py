"""The command `antway`, and `python -m antway`: all is loaded within, so that Ctrl-C is quiet then too."""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Run the command line and exit with its status, 130 where Ctrl-C ends it."""
    try:
        from antway.cli import main as run

        run()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(130)
    finally:
        # All is done, and the status known. CPython kills itself by the signal if that came while a string was executed, as
        # imports do: to execute another makes it forget that. And nothing disturbs it while it takes itself down.
        exec("")
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    main()
