"""Two examples of every verb and sub-command, shown below its help; a test parses each of them."""

from __future__ import annotations

EXAMPLES = {
    "generate": ("lacoloco generate", "lacoloco generate --robot h1 --preset smoke --run try"),
    "retarget": ("lacoloco retarget", "lacoloco retarget walk.bvh --trim 2s:10s --mirror"),
    "motions": ("lacoloco motions list", "lacoloco motions show clips.h5"),
    "motions list": ("lacoloco motions list", "lacoloco motions list mine --json"),
    "motions show": ("lacoloco motions show", "lacoloco motions show clips.h5"),
    "motions plot": (
        "lacoloco motions plot mine",
        "lacoloco motions plot clips.h5 --out clips.png",
    ),
    "motions import": (
        "lacoloco motions import walk.csv --robot solo12 --run mine",
        "lacoloco motions import clips/ --robot g1/ --joints legs --source-fps 30",
    ),
    "motions export": (
        "lacoloco motions export mine --to clips",
        "lacoloco motions export clips.h5 --to clips --format csv --fps 30",
    ),
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
    "runs list": ("lacoloco runs list", "lacoloco runs list --json"),
    "runs show": ("lacoloco runs show quickstart", "lacoloco runs show solo12-synthetic"),
    "runs verify": ("lacoloco runs verify", "lacoloco runs verify quickstart"),
    "runs clean": ("lacoloco runs clean", "lacoloco runs clean quickstart --yes"),
    "runs plot": (
        "lacoloco runs plot quickstart",
        "lacoloco runs plot quickstart --out curves.pdf",
    ),
    "runs coverage": (
        "lacoloco runs coverage",
        "lacoloco runs coverage --run quickstart --latents 1024",
    ),
    "runs publish": (
        "lacoloco runs publish quickstart mydog",
        "lacoloco runs publish runs/quickstart/train-low/0001 mydog-low",
    ),
    "runs report": ("lacoloco runs report quickstart", "lacoloco runs report --out RESULTS.md"),
    "runs page": ("lacoloco runs page", "lacoloco runs page quickstart --out quickstart.html"),
    "robots": ("lacoloco robots list", "lacoloco robots check mydog/"),
    "robots list": ("lacoloco robots list", "lacoloco robots list --json"),
    "robots show": ("lacoloco robots show go2", "lacoloco robots show mydog/ --json"),
    "robots check": ("lacoloco robots check", "lacoloco robots check mydog/ --figure mydog.png"),
    "robots import": (
        "lacoloco robots import go1.xml --name go1",
        "lacoloco robots import mydog.urdf --name mydog --to .",
    ),
    "bench": ("lacoloco bench train", "lacoloco bench retarget walk.bvh"),
    "bench sim": ("lacoloco bench sim", "lacoloco bench sim --robot go2 --task walk"),
    "bench train": ("lacoloco bench train", "lacoloco bench train --robot go2 --preset smoke"),
    "bench contacts": ("lacoloco bench contacts", "lacoloco bench contacts --robot go2"),
    "bench experts": ("lacoloco bench experts", "lacoloco bench experts --robot go2 --episodes 64"),
    "bench motions": ("lacoloco bench motions", "lacoloco bench motions --hours 1"),
    "bench retarget": ("lacoloco bench retarget", "lacoloco bench retarget walk.bvh --robot h1"),
    "bench gpu": ("lacoloco bench gpu", "lacoloco bench gpu --minutes 5 --out copies"),
    "doctor": ("lacoloco doctor", "lacoloco doctor --json"),
}
"""Verb, or verb and sub-command -> two command lines."""


def epilog(verb: str) -> str:
    """What stands below the help of a verb; a blank line keeps the lines apart."""
    lines = EXAMPLES.get(verb, ())
    return "\n\n".join(["Examples:", *lines]) if lines else ""
