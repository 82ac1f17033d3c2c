"""Two examples of every verb, shown below its help; a test parses each of them."""

from __future__ import annotations

EXAMPLES = {
    "generate": ("lacoloco generate", "lacoloco generate --robot h1 --preset smoke --run try"),
    "retarget": ("lacoloco retarget", "lacoloco retarget walk.bvh --trim 2s:10s --mirror"),
    "motions": ("lacoloco motions list", "lacoloco motions show clips.h5"),
    "track": ("lacoloco track", "lacoloco track --motions clips.h5 --preset smoke"),
    "train-low": (
        "lacoloco train-low --disc drail --cat",
        "lacoloco train-low --motions clips.h5 --seeds 3",
    ),
    "train-high": (
        "lacoloco train-high",
        "lacoloco train-high --low solo12-synthetic-low --run mine",
    ),
    "eval": ("lacoloco eval", "lacoloco eval --policy solo12-synthetic --episodes 512"),
    "switching": (
        "lacoloco switching",
        "lacoloco switching --policy solo12-synthetic --out switching.png",
    ),
    "export": ("lacoloco export", "lacoloco export --policy solo12-synthetic --run robot"),
    "play": (
        "lacoloco play solo12-synthetic",
        "lacoloco play solo12-synthetic --video walk.mp4 --speed 0.5",
    ),
    "explore": (
        "lacoloco explore solo12-synthetic-low",
        "lacoloco explore solo12-synthetic --port 8080",
    ),
    "run": ("lacoloco run quickstart", "lacoloco run solo12-synthetic --seeds 3 --resume"),
    "runs": ("lacoloco runs list", "lacoloco runs page quickstart"),
    "robots": ("lacoloco robots list", "lacoloco robots check mydog/"),
    "bench": ("lacoloco bench train", "lacoloco bench retarget walk.bvh"),
    "doctor": ("lacoloco doctor", "lacoloco doctor --json"),
}
"""Verb -> two command lines."""


def epilog(verb: str) -> str:
    """What stands below the help of a verb; a blank line keeps the lines apart."""
    lines = EXAMPLES.get(verb, ())
    return "\n\n".join(["Examples:", *lines]) if lines else ""
