"""What a run of the API executes: the command line, at low priority, ended when its server ends.

``python -m server.run_child ARGUMENTS...`` is ``snakeslam ARGUMENTS...`` with stdin as the leash.
"""

import contextlib
import os
import runpy
import signal
import sys
import threading

from snakeslam.runtime.process.priority import set_lowest_priority


def _end_with_server() -> None:
    """Wait for the end of stdin, which comes when the server is gone however it went."""
    with contextlib.suppress(OSError):  # Without a stdin to wait for there is no server either.
        while os.read(0, 1024):
            pass
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> None:
    """Run the command line in this process."""
    # Ctrl-C reaches the whole terminal group; the server decides when a run ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_lowest_priority()
    threading.Thread(target=_end_with_server, name="leash", daemon=True).start()
    sys.argv[0] = "snakeslam"
    runpy.run_module("snakeslam", run_name="__main__")


if __name__ == "__main__":
    main()
