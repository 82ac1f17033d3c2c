"""What a sweep compares: each variant is an experiment, trained by one method with its settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product

from lacoloco.pipelines.chains.experiments import METHODS
from lacoloco.pipelines.chains.stage_configs import Settings
from lacoloco.pipelines.errors import StageError

TABLE_1 = "table-1"
"""Name of the comparison that the paper's Table I is, beside those of the experiments."""
TABLE_1_OF: Mapping[str, tuple[str, ...]] = {
    "solo12": ("solo12-synthetic", "solo12-dog"),
    "h1": ("h1-synthetic",),
}
"""Robot -> the experiments of its rows in Table I."""
TABLE_1_SEED = 10
"""First seed of the table: the recipes were developed with smaller ones."""


@dataclass(frozen=True)
class Variant:
    """One row of a comparison.

    Attributes:
        name: of the row; letters, digits, ``-``, ``_``, ``.``.
        experiment: a key of ``EXPERIMENTS``.
        method: a key of ``METHODS``.
        settings: fields of the stages' configs.
        compared: whether it is told from the others by its settings. Else its policies are those of
            its method.
    """

    name: str
    experiment: str
    method: str
    settings: Settings = field(default_factory=dict)
    compared: bool = False


def of_methods(experiment: str, methods: Iterable[str], settings: Settings) -> list[Variant]:
    """One variant per method."""
    return [Variant(method, experiment, method, settings) for method in methods]


def of_table_1(
    robot: str, methods: Iterable[str], settings: Mapping[str, Settings]
) -> list[Variant]:
    """The rows of the paper's Table I of a robot: each of its experiments by each method.

    Args:
        robot: A key of ``TABLE_1_OF``.
        methods: Keys of ``METHODS``.
        settings: Experiment -> settings of its stages.
    """
    return [
        Variant(f"{name}.{method}", name, method, settings.get(name, {}), compared=True)
        for name, method in product(experiments_of_table_1(robot), methods)
    ]


def experiments_of_table_1(robot: str) -> tuple[str, ...]:
    """The experiments of a robot in Table I.

    Raises:
        StageError: the paper has none of this robot.
    """
    if robot not in TABLE_1_OF:
        raise StageError(f"{TABLE_1} --robot {robot}: the paper has {' and '.join(TABLE_1_OF)}")
    return TABLE_1_OF[robot]


def chosen_methods(text: str) -> list[str]:
    """The methods in ``all`` or in names separated by commas.

    Raises:
        StageError: a name that is no method.
    """
    names = (
        list(METHODS)
        if text == "all"
        else [name.strip() for name in text.split(",") if name.strip()]
    )
    unknown = [name for name in names if name not in METHODS]
    if unknown or not names:
        raise StageError(f"--methods {text}: use all, or some of {', '.join(METHODS)}")
    return list(dict.fromkeys(names))
