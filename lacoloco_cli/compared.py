"""What `lacoloco run` is asked to compare, from its options: one variant, several methods, a
file of variants, or the paper's table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lacoloco_cli.failures import UserError
from lacoloco_cli.stage_settings import stage_settings
from lacoloco_cli.sweep_file import read_sweep

if TYPE_CHECKING:
    from lacoloco.pipelines.chains.stage_configs import Settings
    from lacoloco.pipelines.chains.variants import Variant


@dataclass(frozen=True)
class Compared:
    """The options of `lacoloco run` that say what is trained.

    Attributes:
        overrides: `"STAGE.path.to.field=value"` of all variants.
        preset: Of all stages.
        method: Of `--disc` and `--cat`.
        methods: `all`, or names separated by commas.
        robot: Another robot than the experiment's; of `table-1` the one whose rows are made.
        sweep: A file of variants.
    """

    overrides: Sequence[str]
    preset: str
    method: str
    methods: str | None = None
    robot: str | None = None
    sweep: Path | None = None

    def variants(self, name: str) -> list[Variant]:
        """What is compared in an experiment, or in `table-1`.

        Raises:
            UserError: Options that contradict each other, or a file that cannot be used.
            StageError: An unknown method or preset; a robot that the table does not have.
            RobotError: No such robot.
        """
        from lacoloco.pipelines.chains import variants
        from lacoloco.pipelines.chains.experiments import EXPERIMENTS
        from lacoloco.robots.registry import load_robot

        if self.sweep and (self.methods or name == variants.TABLE_1):
            other = "--methods" if self.methods else name
            raise UserError(f"--sweep {self.sweep}: not with {other}; its variants name a method")
        if name == variants.TABLE_1:
            return self._table_1()
        load_robot(self.robot or EXPERIMENTS[name].robot)
        if self.sweep:
            return read_sweep(
                self.sweep, name, method=self.method, preset=self.preset, common=self.overrides
            )
        settings = stage_settings(self.overrides, EXPERIMENTS[name], self.preset)
        methods = variants.chosen_methods(self.methods or self.method)
        return variants.of_methods(name, methods, settings)

    def _table_1(self) -> list[Variant]:
        from lacoloco.pipelines.chains import variants

        if self.robot is None:
            raise UserError(f"{variants.TABLE_1}: say whose, --robot solo12 or --robot h1")
        names = variants.experiments_of_table_1(self.robot)
        settings = {name: self._settings_of(name, names) for name in names}
        return variants.of_table_1(
            self.robot, variants.chosen_methods(self.methods or "all"), settings
        )

    def _settings_of(self, name: str, others: Sequence[str]) -> Settings:
        """The overrides whose stage the experiment has; those of no experiment are refused."""
        from lacoloco.pipelines.chains.experiments import EXPERIMENTS
        from lacoloco.pipelines.chains.stage_configs import stages_of

        every = {stage for one in others for stage in stages_of(EXPERIMENTS[one])}
        here = stages_of(EXPERIMENTS[name])
        fitting = [
            one
            for one in self.overrides
            if (stage := one.partition(".")[0].strip()) in here or stage not in every
        ]
        typed = ["eval.protocol=fresh", *fitting]
        return stage_settings(typed, EXPERIMENTS[name], self.preset)
