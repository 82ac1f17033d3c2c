"""How recordings are retargeted, and which of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from lacoloco.datasets.config_values import Form, Length, Text, Within, check_config
from lacoloco.datasets.mocap import UpAxis
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.retargeting.mocap.reading import Reading
from lacoloco.pipelines.retargeting.mocap.skeleton_maps import SkeletonMap, load_map, shipped_maps
from lacoloco.pipelines.retargeting.mocap.trim import check_trim
from lacoloco.pipelines.retargeting.solve.clip_problem import ClipWeights

Mode = Literal["paper", "clip"]
SCALES = Form(r"|auto|none|[\d.]+(e[+-]?\d+)?", "auto, none, a positive factor, or nothing")


@dataclass(frozen=True)
class RetargetConfig:
    """How recordings are retargeted, and which part of them.

    Attributes:
        mode: "clip" solves all frames together, feet planted where the paws stand; "paper" solves
            the paper's program frame by frame and sets the result on the ground.
        scale: "auto" fits the animal to the robot, a number does so with this factor, "none" leaves
            it in its own size (paper); empty: what suits the mode.
        posture_weight: alpha of the paper, m^2/rad^2; for mode "paper".
        clip: Weights of mode "clip".
        map: File with a map from joints to frames of the robot; empty: the one that comes with
            lacoloco and fits the joints of the file.
        up_axis: Axis of the files that points up; empty: the map's.
        unit: Metres per unit of the files; 0: the map's.
        source_fps: Frames per second of the files; 0: those that they name.
        trim: Which part of each file, `START:END` in frames or, with s, in seconds.
        select: Name or file of a selection, which says which files are used and which part of each.
        fps: Frames per second of the clips; 0: those of each file.
        mirror: Retarget the mirror image.
        bend: 1/m of the animal by which its course is bent to the left, after mirroring.
        augment: Each file gives six clips: itself, its mirror image, and both on courses bent to
            either side by `augment_bends`: animals turn little where they are recorded.
        augment_bends: 1/m; the mirror image is bent by their opposites.
        swap_sides: Left and right are exchanged in the files.
        skill: Skill of the clips.
        licence: Licence of the files; that of the bundled sample is known.
        pictures: Draw a report of each clip beside the artifact.
    """

    mode: Mode = "clip"
    scale: Annotated[str, SCALES] = ""
    posture_weight: Annotated[float, Within(0, 1000)] = 0.005
    clip: ClipWeights = field(default_factory=ClipWeights)
    map: Text = ""
    up_axis: Literal["", "x", "y", "z", "-x", "-y", "-z"] = ""
    unit: Annotated[float, Within(0, 1000)] = 0.0
    source_fps: Annotated[float, Within(0, 10_000)] = 0.0
    trim: Text = ""
    select: Text = ""
    fps: Annotated[float, Within(0, 10_000)] = 0.0
    mirror: bool = False
    bend: Annotated[float, Within(-100, 100)] = 0.0
    augment: bool = False
    augment_bends: Annotated[tuple[float, ...], Length(0, 100), Within(-100, 100)] = (1.5, -1.0)
    swap_sides: bool = False
    skill: Text = "dog"
    licence: Text = ""
    pictures: bool = True

    def check(self) -> None:
        """Refuse what no file could be read with.

        Raises:
            ConfigError: The message names the field.
            StageError: The message names the option.
        """
        check_config(self)
        check_trim(self.trim)
        if self.trim and self.select:
            raise StageError("--trim: a selection has trims of its own; leave one of the two out")
        self.reading(shipped_maps()[0])

    def reading(self, skeleton: SkeletonMap, trim: str = "") -> Reading:
        """How a file with this skeleton is read, but for the pairs of its limbs.

        Raises:
            StageError: Unknown axis.
        """
        axes = ("x", "y", "z", "-x", "-y", "-z")
        if self.up_axis and self.up_axis not in axes:
            raise StageError(f"--up-axis {self.up_axis}: use one of {', '.join(axes)}")
        up_axis: UpAxis = self.up_axis or skeleton.up_axis
        return Reading(
            up_axis=up_axis,
            unit=self.unit or skeleton.unit,
            source_fps=self.source_fps,
            trim=self.trim or trim,
            fps=self.fps,
            mirror=self.mirror,
            bend=self.bend,
            swap_sides=self.swap_sides,
        )

    def variants(self) -> tuple[tuple[str, bool, float], ...]:
        """How each file is used: what is added to its name, whether mirrored, and how far bent."""
        if not self.augment:
            return (("", False, 0.0),)
        bent = [
            (f"{side}_bend{sign * bend:+g}", mirror, sign * bend)
            for bend in self.augment_bends
            for side, mirror, sign in (("", False, 1), ("_mirror", True, -1))
        ]
        return (("", False, 0.0), ("_mirror", True, 0.0), *bent)

    def maps(self) -> tuple[SkeletonMap, ...]:
        """The maps to choose from.

        Raises:
            StageError: The file named in `map` is none.
        """
        return (load_map(Path(self.map)),) if self.map else shipped_maps()

    def key(self) -> RetargetConfig:
        """What of it changes a clip, once its part of the file and the maps are known."""
        return replace(self, trim="", select="", map="", augment=False, augment_bends=())
