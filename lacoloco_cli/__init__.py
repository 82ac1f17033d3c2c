"""The front door: the `lacoloco` command. One file per verb."""

import os

# torch's idle threads would otherwise spin on the cores that the physics needs in between.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
