"""Which of the policies that a low-level training passes through is kept: the one that steers best,
not the last.

The skills drift while the discriminator is satisfied: within half a million samples the latents
that reach may fall from 25 to 12 %, and those that fall rise from 0 to 7 %. So the policy is
examined now and then, as in an early stopping, by what a high level will ask of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from functools import cached_property
from typing import Any

from rsl_rl.models import MLPModel

from lacoloco.datasets.motion_library import MotionLibrary
from lacoloco.pipelines.evaluation.robustness import latent_switching_robustness
from lacoloco.pipelines.evaluation.skill_coverage import SkillCoverage
from lacoloco.pipelines.policies import Head, Policy
from lacoloco.robots.spec import RobotSpec

FALLS_WEIGHT = 4.0
"""What a fall counts against a latent that shows another skill than the clips would: it ends an
episode.
"""
SKILLS = ("walk", "reach", "stand", "fall")
OTHER_SEED = 3_000_017
"""Added to the seed for the episodes in which the chosen policy is measured again."""


class Selection:
    """Examines a training's actor and remembers the best one."""

    def __init__(
        self, spec: RobotSpec, motions: MotionLibrary, head: Head, *, latents: int, seed: int
    ) -> None:
        """Examine with ``latents`` held latents, and as many episodes; no random number of the
        training is used up.
        """
        self.spec, self.motions, self.head, self.latents, self.seed = (
            spec,
            motions,
            head,
            latents,
            seed,
        )
        self.chosen: dict[str, Any] = {}
        """``actor``: state of the best actor so far, ``metrics``: its metrics, ``samples``: when it
        was seen.
        """

    @cached_property
    def coverage(self) -> SkillCoverage:
        """What counts the skills."""
        return SkillCoverage(
            self.spec,
            self.motions,
            latents=self.latents,
            seed=self.seed,
            observation=self.head.observation,
        )

    def measure(self, actor: MLPModel) -> dict[str, float]:
        """The actor's skill coverage."""
        return self.coverage.measure(Policy(self.head, actor))

    def examine(self, actor: MLPModel, samples: int) -> dict[str, float]:
        """Skill coverage, robustness and the ``score`` of both; keeps the actor if none was
        better.
        """
        metrics = self.measure(actor)
        metrics |= latent_switching_robustness(
            self.spec, Policy(self.head, actor), worlds=self.latents, seed=self.seed
        )
        metrics["score"] = score(metrics)
        if not self.chosen or metrics["score"] <= self.chosen["metrics"]["score"]:
            self.chosen = {
                "actor": deepcopy(actor.state_dict()),
                "metrics": dict(metrics),
                "samples": samples,
            }
        return metrics

    def confirm(self, actor: MLPModel) -> dict[str, float]:
        """The chosen policy's metrics with other latents, robots and pushes than it was chosen by:
        the least score of many is too good to be true.

        Returns:
            As :meth:`examine`; with ``chosen_after``, the samples after which the policy was seen,
            and ``chosen_score``, the score that it was chosen by.
        """
        seed = self.seed + OTHER_SEED
        other = Selection(self.spec, self.motions, self.head, latents=self.latents, seed=seed)
        samples, score = self.chosen["samples"], self.chosen["metrics"]["score"]
        metrics = other.examine(self.best(actor), samples)
        return metrics | {"chosen_after": float(samples), "chosen_score": score}

    def best(self, actor: MLPModel) -> MLPModel:
        """A copy of ``actor`` with the chosen weights; its own where nothing was examined yet."""
        best = deepcopy(actor)
        if self.chosen:
            best.load_state_dict(self.chosen["actor"])
        return best.eval()


def score(metrics: Mapping[str, float]) -> float:
    """How far the skills are from the clips' own shares (total variation, 0 to 1), the share of the
    clips' moments in whose cell no latent comes (0 to 1), and ``FALLS_WEIGHT`` per fall under
    latent switching.
    """
    clips = {name: metrics.get(f"clips_{name}", 0.0) for name in SKILLS}
    apart = sum(abs(metrics[f"coverage_{name}"] - clips[name]) for name in SKILLS) / 2.0
    lost = 1.0 - metrics["coverage_cells"]
    return apart + lost + FALLS_WEIGHT * metrics["switching_fall_rate"]
