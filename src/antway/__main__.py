"""The command `antway`, and `python -m antway`. `main` imports everything, so that Ctrl-C is quiet from the start."""

from __future__ import annotations

import _thread
import signal
import sys
import time
from types import FrameType
from typing import Any

_AGAIN = 0.05  # s; delay before an interrupt is repeated
_MAIN_THREAD = _thread.get_ident()  # this module is imported by the thread that runs the command line
# Modules that an exception must not leave at any line: half of an import turns it into other errors or crashes, LLVM's objects
# are freed twice, and compiled kernels that unpickle their constants return a result beside it.
_DELICATE = ("_frozen_importlib", "importlib._bootstrap", "llvmlite.", "numba.core.serialize")


def _repeat() -> None:
    """Interrupt the main thread shortly, also where it waits in a call of the operating system."""
    time.sleep(_AGAIN)
    signal.pthread_kill(_MAIN_THREAD, signal.SIGINT)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, or repeat the interrupt shortly after it came within a delicate module."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).startswith(_DELICATE):
            _thread.start_new_thread(_repeat, ())
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _interrupt_again(ignored: Any) -> None:
    """Repeat an interrupt shortly after it came in a callback of the compiler, which ignores exceptions."""
    if isinstance(ignored.exc_value, KeyboardInterrupt):
        _thread.start_new_thread(_repeat, ())
    else:
        sys.__unraisablehook__(ignored)


def main() -> None:
    """Run the command line and exit with its status, or 130 after Ctrl-C."""
    sys.unraisablehook = _interrupt_again
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where interrupts are ignored
            signal.signal(signal.SIGINT, _interrupt)
        from antway.cli import main as run

        run()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)  # noqa: T201
        sys.exit(130)
    finally:
        # Everything is done, and the status is known. CPython kills itself by the signal if that came while a string was
        # executed, as imports do; executing another string resets this. Further signals are ignored during shutdown.
        exec("")
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    main()
