"""The command `antway`, and `python -m antway`: all is loaded within, so that Ctrl-C is quiet then too."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from typing import Any

_AGAIN = 0.05  # s


def _interrupt_again(ignored: Any) -> None:
    """Interrupt once more a little later where an interrupt came while a compiler called Python: it ignores errors."""
    if isinstance(ignored.exc_value, KeyboardInterrupt):
        again = threading.Timer(_AGAIN, _thread.interrupt_main)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(ignored)


def main() -> None:
    """Run the command line and exit with its status, 130 where Ctrl-C ends it."""
    sys.unraisablehook = _interrupt_again
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
