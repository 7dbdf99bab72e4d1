"""The command ``drapery``, as ``python -m drapery`` and as the script that the wheel installs."""

import os
import signal
import sys
import sysconfig

from ._native import command


def main() -> None:
    """Does what the command line says, and ends the process with the command's exit code."""
    # Ctrl-C is the command's own business, as it is in the program.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    script = os.path.join(sysconfig.get_path("scripts"), "drapery")
    code = command(["drapery", *sys.argv[1:]], script if os.access(script, os.X_OK) else None)
    sys.stderr.flush()
    # The command's threads may still be at work, as when a process ends by itself; Python is not to wait for them.
    os._exit(code)


if __name__ == "__main__":
    main()
