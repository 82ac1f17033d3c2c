"""`lacoloco run --set STAGE.path.to.field=value`: settings for the stages of a chain."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from lacoloco_cli.overrides import OverrideError, apply_overrides

if TYPE_CHECKING:
    from lacoloco.pipelines.chains.experiments import Experiment

METHOD_FIELDS = {"train-low": ("cat", "ase.discriminator")}
"""Fields that the method decides, by which artifacts are found again."""


def stage_settings(
    assignments: Sequence[str], experiment: Experiment, preset: str
) -> dict[str, dict[str, Any]]:
    """Read settings of a chain, and check every one before anything starts.

    Args:
        assignments: `"STAGE.path.to.field=value"`.
        experiment: Whose stages they are for.
        preset: Of all stages.

    Returns:
        Stage -> dotted path -> value, as the field's annotation reads it.

    Raises:
        OverrideError: A stage that the chain does not have or a key that the stage does not have
            (the nearest is named), a field that the method decides, or a wrong type.
        StageError: Unknown preset.
    """
    from lacoloco.pipelines.chains.stage_configs import stages_of

    stages = stages_of(experiment)
    asked: dict[str, dict[str, str]] = {}
    for assignment in assignments:
        target, equals, value = assignment.partition("=")
        stage, dot, path = (part.strip() for part in target.partition("."))
        if not equals or not dot or not path:
            raise OverrideError(f"--set {assignment}: write it as STAGE.path.to.field=value")
        if stage not in stages:
            near = difflib.get_close_matches(stage, stages, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise OverrideError(
                f"--set {assignment}: no stage {stage!r} here; {hint}stages: {', '.join(stages)}"
            )
        if path in METHOD_FIELDS.get(stage, ()):
            raise OverrideError(
                f"--set {assignment}: the method decides that; use --disc and --cat, or --methods"
            )
        asked.setdefault(stage, {})[path] = value
    return {stage: _read(experiment, stage, preset, values) for stage, values in asked.items()}


def _read(
    experiment: Experiment, stage: str, preset: str, values: Mapping[str, str]
) -> dict[str, Any]:
    """A stage's values, read together: what fits together may take two."""
    from lacoloco.pipelines.chains.stage_configs import config_of

    try:
        # the method changes values only, so that any serves to read a field's type
        config = config_of(experiment, stage, preset=preset, method="drail-cat")
        config = apply_overrides(config, [f"{path}={value}" for path, value in values.items()])
    except OverrideError as error:
        told = str(error).removeprefix("--set ")
        raise OverrideError(f"--set {stage}.{told}") from error
    return {path: attrgetter(path)(config) for path in values}
