"""The chains of stages, quickstart and the paper's experiments: the only place where stages
meet.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from lacoloco.pipelines.chains.experiments import (
    EXPERIMENTS,
    FOLLOWS,
    METHODS,
    STAGES,
    Experiment,
    known,
)
from lacoloco.pipelines.stage import StageContext, StageResult


@dataclass(frozen=True)
class Outcome:
    """One stage of a chain: how long it took [s], what came out in one line, and where it is."""

    stage: str
    seconds: float
    figures: str
    artifact: Path


def run(
    name: str,
    context: StageContext,
    *,
    preset: str = "laptop",
    method: str = "drail-cat",
    seeds: int = 1,
    mocap: Sequence[Path] = (),
    from_scratch: bool = False,
) -> list[Outcome]:
    """Run an experiment from nothing to an evaluated, exported and rendered policy.

    Where the experiment may start from a published low level of this method, and there is one, only
    a new high level is trained: skills once, tasks in minutes.

    With ``context.resume``, stages that are complete in this run are kept and the unfinished one
    goes on.

    Args:
        name: a key of ``EXPERIMENTS``.
        context: run, first seed, device.
        preset: preset of every stage.
        method: a key of ``METHODS``.
        seeds: trainings, from ``context.seed`` upwards; the best one is exported and played.
        mocap: files to retarget instead of the bundled sample; they need the whole chain.
        from_scratch: run the whole chain even where a published low level would do.

    Raises:
        StageError: unknown experiment, preset or method.
    """
    experiment = known(EXPERIMENTS, name, "experiment")
    known(METHODS, method, "method")
    chain = _Chain(experiment, context, preset, method, list(mocap))
    low = None if from_scratch or mocap else published_low(experiment, method)
    if low is not None:
        context.progress.say(
            f"starting from the published low level {low.stem}; --from-scratch trains another one"
        )
    return list(chain.run(range(context.seed, context.seed + seeds), low))


def published_low(experiment: Experiment, method: str) -> Path | None:
    """The published policy whose low level an experiment may start from, None where none was
    trained by this method.
    """
    from lacoloco.datasets import published
    from lacoloco.datasets.artifact import read_header

    found = [path for name in experiment.start_from if (path := published.find(name)) is not None]
    return next(
        (path for path in found if read_header(path).metadata.get("method") == method), None
    )


def make_motions(
    name: str, context: StageContext, *, preset: str, mocap: Sequence[Path] = ()
) -> list[Path]:
    """The motions that an experiment's low level learns from; those that are there already are
    kept.

    Raises:
        StageError: unknown experiment or preset.
    """
    chain = _resuming(name, context, preset, mocap=mocap)
    learn_from = chain.experiment.learn_from
    needed = {*learn_from, *(FOLLOWS[maker] for maker in learn_from if maker in FOLLOWS)}
    makers = [maker for maker in chain.experiment.makers if maker in needed]
    made = {
        maker: chain.stage(maker, chain.context, **chain.sources(maker)).artifact
        for maker in makers
    }
    return [made[maker] for maker in learn_from]


def train_both(name: str, context: StageContext, *, preset: str, method: str) -> Path:
    """Both levels of one method and seed on the run's newest motions; a level that is there already
    is kept.

    Returns:
        The high level's artifact.

    Raises:
        StageError: unknown experiment, preset or method.
        ArtifactError: the run has no motions.
    """
    chain = _resuming(name, context, preset, method)
    motions = [chain.newest(maker) for maker in chain.experiment.learn_from]
    low = chain.stage("train-low", chain.context, motions=motions)
    return chain.stage("train-high", chain.context, low=low.artifact).artifact


def evaluate(name: str, context: StageContext, *, preset: str, policies: Sequence[Path]) -> Outcome:
    """Evaluate high levels of several methods and seeds together, one row each.

    Raises:
        StageError: unknown experiment or preset.
    """
    return _resuming(name, context, preset).stage("eval", context, policies=list(policies))


def _resuming(
    name: str,
    context: StageContext,
    preset: str,
    method: str = "drail-cat",
    mocap: Sequence[Path] = (),
) -> _Chain:
    experiment = known(EXPERIMENTS, name, "experiment")
    known(METHODS, method, "method")
    return _Chain(experiment, replace(context, resume=True), preset, method, list(mocap))


class _Chain:
    """Runs one experiment's stages in order, feeding each the newest artifacts of those before
    it.
    """

    def __init__(
        self,
        experiment: Experiment,
        context: StageContext,
        preset: str,
        method: str,
        mocap: list[Path],
    ) -> None:
        self.experiment, self.context, self.preset, self.method, self.mocap = (
            experiment,
            context,
            preset,
            method,
            mocap,
        )

    def run(self, seeds: range, published: Path | None = None) -> Iterator[Outcome]:
        """All stages in order; with a ``published`` low level, only what comes after it."""
        makers = () if published is not None else self.experiment.makers
        for maker in makers:
            yield self.stage(maker, self.context, **self.sources(maker))
        policies = []
        for seed in seeds:
            context, low = replace(self.context, seed=seed), published
            if low is None:
                motions = [self.newest(maker) for maker in self.experiment.learn_from]
                trained = self.stage("train-low", context, motions=motions)
                yield trained
                low = trained.artifact
            high = self.stage("train-high", context, low=low)
            policies.append(high.artifact)
            yield high
        evaluation = self.stage("eval", self.context, policies=policies)
        yield evaluation
        best = self._best(evaluation.artifact, policies)
        yield self.stage("export", self.context, policy=best)
        for source in (*(self.newest(maker) for maker in makers), best):
            yield self.stage("play", self.context, source=source)

    def sources(self, maker: str) -> dict[str, Any]:
        """What a stage that makes motions takes."""
        if maker == "generate":
            return {"robot": self.experiment.robot}
        if maker in FOLLOWS:
            return {"motions": [self.newest(FOLLOWS[maker])]}
        return {"robot": self.experiment.robot, **({"sources": self.mocap} if self.mocap else {})}

    def stage(self, verb: str, context: StageContext, **inputs: Any) -> Outcome:
        """Run one stage; with ``context.resume``, keep it where it is complete and go on where it
        is not.
        """
        module = import_module(f"lacoloco.pipelines.{STAGES[verb]}")
        config = self._config(module, verb)
        done = (
            self._done(verb, context.seed)
            if context.resume and verb not in ("play", "eval", "export")
            else None
        )
        begin = time.monotonic()
        if done is not None:
            return Outcome(verb, 0.0, "kept", done)
        label = f"{self.method}-seed{context.seed}" if verb in ("train-low", "train-high") else ""
        # What takes long in generate, and has checkpoints, is the training of its experts.
        worked_in = "experts" if verb == "generate" else verb
        unfinished = bool(context.store.partials(context.run, worked_in, label))
        result: StageResult = module.run(
            config, replace(context, resume=context.resume and unfinished), **inputs
        )
        return Outcome(
            verb, time.monotonic() - begin, headline(verb, result.metrics), result.artifact
        )

    def _config(self, module: Any, verb: str) -> Any:
        config = known(module.PRESETS, self.preset, "preset")()
        config = replace(config, **self.experiment.settings.get(verb, {}))
        if verb == "train-low":
            discriminator, constrained = METHODS[self.method]
            config = replace(
                config, cat=constrained, ase=replace(config.ase, discriminator=discriminator)
            )
        if verb == "eval":
            config = replace(config, episodes=min(config.episodes, self.experiment.episodes))
        if verb == "train-high" and self.experiment.decisions is not None:
            config = replace(config, decisions=min(config.decisions, self.experiment.decisions))
        return config

    def _done(self, verb: str, seed: int) -> Path | None:
        from lacoloco.datasets.artifact import read_header

        for path in reversed(self.context.store.all(self.context.run, verb)):
            header = read_header(path)
            trained = verb in ("train-low", "train-high")
            if not trained or (
                header.seed == seed and header.metadata.get("method") == self.method
            ):
                return path
        return None

    def newest(self, verb: str) -> Path:
        """The run's newest artifact of a stage."""
        return self.context.store.newest(self.context.run, verb)

    def _best(self, evaluation: Path, policies: list[Path]) -> Path:
        from lacoloco.datasets.artifact import read_header

        best = read_header(evaluation).metadata["best"]["policy"]
        return next(path for path in policies if str(path) == best)


def headline(verb: str, metrics: dict[str, Any]) -> str:
    """The few figures of a stage that a person wants to see, in one line."""
    return HEADLINES[verb](metrics)


HEADLINES: dict[str, Callable[[dict[str, Any]], str]] = {
    "generate": lambda m: (
        f"{m['clips']} clips, {m['seconds']:.0f} s; walking error {m['walk_error_mean']:.3f} m/s, "
        f"reaching error {100 * m['reach_error_mean']:.1f} cm"
    ),
    "retarget": lambda m: f"{m['frames_per_second']:.0f} frames/s",
    "track": lambda m: (
        f"{m['segments']} segments, {100 * m['kept']:.0f} % of the clips; "
        f"speed {m['speed']:.2f} m/s (clips {m['clip_speed']:.2f})"
    ),
    "train-low": lambda m: (
        f"{m['samples'] / 1e6:.1f} M samples, {m['samples_per_second']:.0f}/s; speed "
        f"{m['speed']:.2f} m/s (clips {m['clip_speed']:.2f}), latents that walk "
        f"{100 * m['coverage_walk']:.0f} %, "
        f"reach {100 * m['coverage_reach']:.0f} %"
    ),
    "train-high": lambda m: (
        f"error {100 * m['trained_error']:.1f} cm, untrained {100 * m['untrained_error']:.1f} cm"
    ),
    "eval": lambda m: (
        f"error {100 * m['best']['ee_error_mean_m']:.1f} +- "
        f"{100 * m['best']['ee_error_std_m']:.1f} cm, "
        f"violation {m['best']['contact_violation_pct']:.2f} %, falls "
        f"{m['best']['falls_pct']:.2f} %"
    ),
    "export": lambda m: f"low.onnx, high.onnx; largest difference {m['max_abs_difference']:.1g}",
    "play": lambda m: str(m["html"]),
}
