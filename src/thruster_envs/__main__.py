"""``python -m thruster_envs``: the command ``thruster-envs``."""

import sys

from thruster_envs.commands import main

if __name__ == "__main__":
    sys.exit(main())
