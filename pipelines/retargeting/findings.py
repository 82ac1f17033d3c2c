"""What a person should know of a clip: a name for scripts, and one line for people."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that is odd about a recording, or about what was made of it.

    Attributes:
        name: `frame_count`, `few_frames`, `frame_rate`, `sides_swapped`, `jump`, `mended`,
            `unlike`, `unsolved`, `nothing_stands`, `not_carried`, `body_contact` or `self_contact`.
        text: What was found, and which option helps.
    """

    name: str
    text: str
