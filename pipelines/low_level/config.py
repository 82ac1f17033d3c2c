"""What a low level's training is told."""

from __future__ import annotations

from dataclasses import dataclass, field

from lacoloco.pipelines.learn.ase import AseConfig
from lacoloco.pipelines.learn.latents import LatentConfig
from lacoloco.pipelines.learn.networks import NetworkConfig
from lacoloco.pipelines.learn.ppo import PpoConfig
from lacoloco.pipelines.learn.skill_embedding import WindowConfig


@dataclass(frozen=True)
class TrainLowConfig:
    """Low-level training.

    Attributes:
        cat: constrain the foot forces (Constraints as Terminations).
        cat_ramp: shares of the training between which the constraint rises to full strength.
        clip_share: share of resets that start inside a clip.
        episode_s: seconds until a time-out. Far shorter than the original's 10 s: a policy that
            cannot walk yet leaves a clip's motion within tenths of a second, and only just after a
            reset can it learn to stay in it longer.
        rehearsal: share of the worlds that live as they will under a high level:
            ``low_level.REHEARSAL_S`` from a standing start, with latents that wander, slowly in
            some worlds and fast in others.
        rehearsal_from: share of the training after which they do. A beginner that falls at every
            change learns to stand.
        randomisation: factor on the spread of masses, centres of mass and friction; evaluation is
            at 1.
        second_chances: share of falls after which the world is put back to shortly before, again
            and again.
        push: how hard the robot is pushed, where it is at all [m/s, rad/s]; evaluation pushes with
            0.25.
        push_every_s: seconds between two pushes.
        std: exploration std at the start and at the end, in raw action units (x action scale =
            rad).
        std_between: shares of the training between which it falls from the first to the second.
        settle: what the KL target falls to, as a share of itself, and the shares of the training
            between which it does. At full stride the skills go round in circles: 94 % of the
            latents walk, half a million samples later 27 %.
        warm_start: gradient steps of behaviour cloning on actions inferred from the clips, before
            everything else; 0 begins with a random network and meaningless latents, as the paper
            does.
        beginnings: share of the cloned windows that start where a clip begins. Everything a high
            level does begins standing, and one moment in five hundred of a clip is too little to
            learn from.
        head_start: share of the training in which critic, discriminator and encoder learn alone.
            What was cloned is precise to a fraction of the exploration std, and the first
            advantages of an untrained critic would undo it.
        windows: what a latent describes while the clips are cloned.
        skill_shares: skill name -> share of demonstrations and clip resets; empty: by duration.
        coverage_every: samples between two measurements of the deterministic skill coverage (0:
            only at the end).
        coverage_latents: latents held in each of them.
        choose_from: share of the training after which every policy measured may be the one that is
            kept (``selection.py``); the constraint should be in force by then.
    """

    worlds: int = 512
    samples: int = 6_000_000
    cat: bool = True
    cat_ramp: tuple[float, float] = (0.3, 0.5)
    clip_share: float = 0.7
    episode_s: float = 2.0
    rehearsal: float = 0.5
    rehearsal_from: float = 0.3
    randomisation: float = 1.5
    second_chances: float = 0.9
    push: float = 0.3
    push_every_s: tuple[float, float] = (1.0, 3.0)
    std: tuple[float, float] = (0.05, 0.05)
    std_between: tuple[float, float] = (0.4, 0.9)
    settle: tuple[float, float, float] = (0.1, 0.6, 1.0)
    warm_start: int = 3000
    beginnings: float = 0.2
    head_start: float = 0.03
    windows: WindowConfig = field(default_factory=WindowConfig)
    skill_shares: tuple[tuple[str, float], ...] = ()
    coverage_every: int = 250_000
    coverage_latents: int = 256
    choose_from: float = 0.8
    latents: LatentConfig = field(default_factory=LatentConfig)
    ppo: PpoConfig = field(
        default_factory=lambda: PpoConfig(
            horizon=16,
            epochs=4,
            minibatches=2,
            gamma=0.98,
            desired_kl=0.02,
            learning_rate=5e-5,
            min_learning_rate=1e-6,
        )
    )
    networks: NetworkConfig = field(default_factory=NetworkConfig)
    ase: AseConfig = field(default_factory=AseConfig)
