"""Names that fields of stored configs had in earlier versions.

An artifact keeps the config that made it, under the names of its time. A change that renames or
removes a field of a config adds a row here, so that those artifacts keep loading with the same
values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacoloco.datasets.errors import ArtifactError


def _as_stored(value: Any) -> Any:
    return [_as_stored(item) for item in value] if isinstance(value, list | tuple) else value


class Removed:
    """An option that is gone, because it is always as its neutral values say.

    Args:
        neutral: Stored values that mean what happens today without the option. An artifact that
            holds another value was made by something that can no longer be done; it is refused.
    """

    def __init__(self, *neutral: Any) -> None:
        """Compare values as JSON keeps them: tuples are lists there."""
        self.neutral = [_as_stored(value) for value in neutral]

    def allows(self, value: Any) -> bool:
        """Whether a stored value means what happens today."""
        return _as_stored(value) in self.neutral


New = str | Removed | None

CONFIG: dict[str, dict[str, New]] = {
    # Clips began after so many seconds; the experts that the artifact holds do not depend on it.
    "GenerateConfig": {"lead_in": None, "settle": "transient_s"},
    # Moved into robot.toml; the Solo12's and the H1's numbers are what they were.
    "TrainLowConfig": {
        "fall_tilt": Removed(1.05),
        "rehearsal": "long_horizon_fraction",
        "rehearsal_from": "long_horizon_from",
        "second_chances": "restart_probability",
        # A pair for a schedule that no training used; the one value is `exploration_std`.
        "std": Removed((0.05, 0.05)),
        "std_between": None,
        "settle": "kl_anneal",
        "warm_start": "bc_steps",
        "beginnings": "bc_clip_start_fraction",
        "head_start": "critic_warmup",
    },
    "TrainHighConfig": {
        "fall_tilt": Removed(1.05),
        "approach": Removed(0.0),
        "settle": "kl_anneal",
        "head_start": "critic_warmup",
        "force_price": "contact_force_penalty",
        "price_ramp": "contact_force_penalty_ramp",
        "near": "near_target_fraction",
        "clean": "noise_free_fraction",
        "second_chances": "restart_probability",
        "rematch_from": "replay_failed_from",
        # How a training began; the policies that the artifact holds do not depend on it.
        "hindsight": None,
    },
    "PpoConfig": {
        "entropy": Removed(0.0),
        "deterministic_share": "greedy_fraction",
        "spell": "noise_hold_steps",
        "bold_share": "high_noise_fraction",
    },
    "LatentConfig": {
        "wander": "random_walk_step_size",
        "wander_steps": "random_walk_steps",
        "jump": "resample_probability",
    },
    "AseConfig": {"anchor": "labelled_encoder_weight"},
    "TrackerConfig": {
        "standing_speed": Removed(0.8),
        "standing": "standing_start_fraction",
        "stopping": "stop_fraction",
    },
    "TrackConfig": {"paces": "speed_factors"},
    "RecordingConfig": {
        "settle_s": "transient_s",
        "before_loss_s": "before_termination_s",
        "shortest_s": "min_segment_s",
    },
}
"""Name of the config class today -> {old dotted field: new dotted field}.

`None` in place of the new field: the option is gone, and no value of it mattered. `Removed(...)`:
it is gone, and only these values are still what happens. Fields of a nested config may stand under
the name of the nested class (`PpoConfig`), which serves every config that contains it.
"""


def translated(schema: str, stored: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of one config under today's names; those that have no row stay as they are.

    Args:
        schema: Name of the config class.
        stored: Its fields as an artifact keeps them; nested configs are mappings.

    Raises:
        ArtifactError: An option was removed, and the stored value is not one of its neutral ones.
    """
    result = _copied(stored)
    for old, new in CONFIG.get(schema, {}).items():
        *groups, name = old.split(".")
        holder = _at(result, groups)
        if holder is None or name not in holder:
            continue
        value = holder.pop(name)
        if isinstance(new, Removed) and not new.allows(value):
            usual = " or ".join(repr(one) for one in new.neutral)
            raise ArtifactError(
                f"{schema}.{old} = {value!r}: this option was removed; only {usual} can be read"
            )
        if isinstance(new, str):
            *groups, name = new.split(".")
            _made(result, groups).setdefault(name, value)
    return result


def _at(tree: dict[str, Any], groups: list[str]) -> dict[str, Any] | None:
    for group in groups:
        inner = tree.get(group)
        if not isinstance(inner, dict):
            return None
        tree = inner
    return tree


def _made(tree: dict[str, Any], groups: list[str]) -> dict[str, Any]:
    for group in groups:
        tree = tree.setdefault(group, {})
    return tree


def _copied(tree: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: _copied(value) if isinstance(value, Mapping) else value for key, value in tree.items()
    }
