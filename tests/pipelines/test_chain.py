"""The stages one after the other, in their smallest size and in this process."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import onnxruntime
import pytest
import torch

from lacoloco.datasets.artifact import read_artifact
from lacoloco.datasets.clip import load_clips
from lacoloco.datasets.store import RunStore
from lacoloco.pipelines import evaluate, export, generate, switching, train_high, train_low
from lacoloco.pipelines import play as playback
from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.evaluation import rollout
from lacoloco.pipelines.evaluation.policy_coverage import policy_coverage
from lacoloco.pipelines.exporting import onnx_files
from lacoloco.pipelines.exporting.controller import Controller, Safety, Sensors, rotation
from lacoloco.pipelines.learn.latents import project
from lacoloco.pipelines.policies import load_policies, motions_of
from lacoloco.pipelines.sim.env import LeggedEnv
from lacoloco.pipelines.sim.hierarchical_env import LatentSteeredEnv
from lacoloco.pipelines.sim.randomisation import NO_RANDOMISATION
from lacoloco.pipelines.sim.tasks import load_task
from lacoloco.pipelines.stage import StageContext
from lacoloco.robots.registry import load_robot


def context_in(folder, **options):
    return StageContext(RunStore(folder), "chain", **options)


def walk_the_chain(folder, robot):
    """Run every stage on the smoke preset."""
    context = context_in(folder, seed=1)
    made = generate.run(generate.smoke(), context, robot=robot, retrain=True)
    low = train_low.run(train_low.smoke(), context, motions=[made.artifact])
    high = train_high.run(train_high.smoke(), context, low=low.artifact)
    return SimpleNamespace(context=context, made=made, low=low, high=high, robot=robot)


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    return walk_the_chain(tmp_path_factory.mktemp("runs"), "solo12")


@pytest.fixture(scope="module")
def exported(chain):
    return export.run(export.PRESETS["smoke"](), chain.context, policy=chain.high.artifact)


def test_clips_are_clean_and_as_many_as_asked_for(chain):
    """Bug B14: no resets, no jumps, no pushes in what is imitated."""
    clips = load_clips(chain.made.artifact)
    assert [(clip.skill, clip.weight) for clip in clips] == [("walk", 1.0)] * 3 + [
        ("reach", 9.0)
    ] * 2
    for clip in clips:
        assert clip.frames == 11
        assert not clip.joint_vel[0].any(), "nothing else shows how one begins"
        assert clip.fps == 50.0
        clip.validate()
        moved = np.diff(clip.joint_pos, axis=0) * clip.fps
        said = 0.5 * (clip.joint_vel[1:] + clip.joint_vel[:-1])
        assert np.abs(moved - said).max() < 0.25 * np.abs(said).max() + 0.5
        assert np.linalg.norm(np.diff(clip.root_pos, axis=0), axis=1).max() < 0.05
    assert chain.made.metrics["clips"] == 5


def test_experts_are_trained_once(chain):
    experts = chain.context.store.all("chain", "experts")
    generate.run(generate.smoke(), chain.context, robot="solo12")
    assert chain.context.store.all("chain", "experts") == experts
    generate.run(generate.smoke(), chain.context, robot="solo12", retrain=True)
    assert len(chain.context.store.all("chain", "experts")) == len(experts) + 1


def test_an_expert_that_falls_is_not_recorded(chain, solo12):
    def collapse(obs):
        return torch.full((len(obs), 12), 30.0)

    config = replace(generate.smoke(), seconds=1.0)
    with pytest.raises(StageError, match=r"walk expert fell in \d+ of \d+"):
        generate.record(solo12, "walk", collapse, 3, config, chain.context)


def test_every_stage_leaves_its_artifact_its_log_and_no_checkpoint(chain):
    for stage in ("experts", "train-low", "train-high"):
        folder = chain.context.store.newest("chain", stage).parent
        logged = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
        assert len(logged) >= 2
        assert not list(folder.glob("*.checkpoint.h5"))
        assert not chain.context.store.partials("chain", stage)


def test_the_lineage_goes_back_to_the_experts(chain):
    low, high = (read_artifact(each.artifact) for each in (chain.low, chain.high))
    assert [p.locate(chain.high.artifact) for p in high.parents] == [chain.low.artifact]
    assert [p.locate(chain.low.artifact) for p in low.parents] == [chain.made.artifact]
    assert low.metadata["method"] == high.metadata["method"] == "drail-cat"
    assert (low.seed, high.seed) == (1, 1)
    assert low.config["ase"]["discriminator"] == "drail"


def test_a_high_level_carries_its_low_level_unchanged(chain):
    _, low = load_policies(chain.low.artifact, "low")
    _, both = load_policies(chain.high.artifact, "low", "high")
    obs, z = torch.randn(5, 46), project(torch.randn(5, 7))
    assert torch.equal(low["low"](obs, z), both["low"](obs, z))
    assert both["high"](torch.randn(5, 44)).shape == (5, 7)


def test_figures_are_plain_numbers(chain):
    for result in (chain.made, chain.low, chain.high):
        json.dumps(result.metrics)
    assert {"samples", "samples_per_second", "encoder_cosine"} <= set(chain.low.metrics)
    assert {"untrained_error", "trained_error"} <= set(chain.high.metrics)
    assert chain.low.metrics["samples"] == 16 * 8 * 3


def test_coverage_is_measured_at_the_end_and_counts_every_latent_once(chain):
    shares = [chain.low.metrics[f"coverage_{name}"] for name in ("walk", "reach", "fall", "stand")]
    assert sum(shares) == pytest.approx(1.0)
    assert all(share * 16 == int(share * 16) for share in shares)


def test_evaluation_of_the_chain(chain):
    config = evaluate.EvalConfig(episodes=4, selection_episodes=2, worlds=4)
    result = evaluate.run(config, chain.context, policies=[chain.high.artifact])
    (row,) = result.metrics["rows"]
    assert row["method"] == "drail-cat"
    assert 0.0 < row["ee_error_mean_m"] < 5.0
    assert read_artifact(result.artifact).arrays["0/error"].shape == (4,)


def test_an_interrupted_low_level_is_resumed_from_where_it_was(chain, tmp_path, monkeypatch):
    """The stage as a whole: same weights as without the interruption, also after the training."""
    context = context_in(tmp_path, seed=1)
    motions = [chain.made.artifact]

    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(train_low, "save_policies", interrupt)
        with pytest.raises(KeyboardInterrupt):
            train_low.run(train_low.smoke(), context, motions=motions)
    with monkeypatch.context() as patch:
        patch.setattr(train_low.LowTrainer, "iterate", interrupt)
        resumed = train_low.run(train_low.smoke(), replace(context, resume=True), motions=motions)
    ours, theirs = (read_artifact(path) for path in (resumed.artifact, chain.low.artifact))
    assert ours.data_hash == theirs.data_hash
    assert resumed.metrics["encoder_cosine"] == chain.low.metrics["encoder_cosine"]


def test_motions_of_two_robots_are_refused(chain, tmp_path, h1, make_motions):
    from lacoloco.datasets.clip import Clip, save_clips

    names = h1.joint_names
    still = Clip.from_poses(
        "still", 50.0, names, np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1)), np.zeros((3, 19))
    )
    other = save_clips(
        tmp_path / "h1.h5", [still], robot=("h1", h1.model_hash()), config={}, seed=0
    )
    with pytest.raises(StageError, match="h1, solo12"):
        train_low.load_motions([chain.made.artifact, other])


@pytest.mark.slow
def test_h1_walks_the_same_chain(tmp_path):
    chain = walk_the_chain(tmp_path, "h1")
    _, policies = load_policies(chain.high.artifact, "low", "high")
    assert policies["low"].head.sizes == {"policy": 70, "latent": 7}
    assert policies["high"].head.sizes == {"policy": 58}


def test_export_agrees_with_torch_and_says_so(exported):
    assert exported.metrics["max_abs_difference"] <= onnx_files.TOLERANCE
    artifact = read_artifact(exported.artifact, "lacoloco/export")
    folder = exported.artifact.parent
    assert {path.name for path in folder.iterdir()} == {"artifact.h5", *artifact.metadata["files"]}
    beside = json.loads((folder / "policy.json").read_text())
    hashes = beside.pop("sha256")
    assert set(hashes) == {"low.onnx", "high.onnx", "robot.xml", "controller.py"}
    for role in ("low", "high"):
        assert beside == metadata_of(folder / f"{role}.onnx")


def metadata_of(path):
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return json.loads(session.get_modelmeta().custom_metadata_map["lacoloco"])


def test_exported_metadata_is_all_a_robot_needs(exported):
    metadata = metadata_of(exported.artifact.parent / "low.onnx")
    spec = load_robot("solo12")
    assert metadata["joint_names"] == list(spec.joint_names)
    assert metadata["default_joint_pos"] == list(spec.default_joint_pos)
    assert metadata["joint_stiffness"] == [4.0] * 12
    assert metadata["joint_damping"] == [0.2] * 12
    assert metadata["effort_limits"] == [3.0] * 12
    assert metadata["action_scale"] == 1.5
    assert (metadata["control_dt"], metadata["decision_dt"]) == (0.02, 0.1)
    assert metadata["robot_model_sha256"] == spec.model_hash()
    low = metadata["levels"]["low"]
    assert all(term["meaning"] for term in low["observation_terms"])
    stops = [term["slice"] for term in low["observation_terms"]]
    assert stops[0][0] == 0
    assert all(a[1] == b[0] for a, b in zip(stops[:-1], stops[1:], strict=True))
    assert stops[-1][1] == low["inputs"]["observation"] == 46


def test_difference_beyond_the_tolerance_is_an_error(chain, exported, monkeypatch):
    _, policies = load_policies(chain.high.artifact, "high")
    monkeypatch.setattr(onnx_files, "TOLERANCE", -1.0)
    recorded = (np.zeros((2, 44), np.float32),)
    with pytest.raises(StageError, match="high.onnx"):
        onnx_files.largest_difference(
            policies["high"],
            exported.artifact.parent / "high.onnx",
            recorded,
            2,
            0,
        )


def test_the_exported_controller_acts_as_the_simulated_robot(chain, exported):
    """Two decisions of the simulation, step by step, against the folder's own controller."""
    controller = Controller(exported.artifact.parent, Safety(rise_s=0.0, stand_s=0.0, slew=1e6))
    _, policies = load_policies(chain.high.artifact, "low", "high")
    task = load_task(load_robot("solo12"), "reach")
    task = replace(task, noise=0.0, randomisation=NO_RANDOMISATION)
    base = LeggedEnv(load_robot("solo12"), task, 1, seed=0)
    env = LatentSteeredEnv(base, policies["low"], 7)
    step, targets, commands = base.physics.step, [], []

    def watched(joints):
        targets.append(joints[0].numpy())
        commands.append(controller.step(sensors(base.physics), base.command[0].numpy(), 0.0))
        step(joints)

    base.physics.step = watched
    for _ in range(2):
        env.step(project(policies["high"](env.observe())))
    assert len(commands) == 2 * controller.policy["latent_hold_steps"]
    np.testing.assert_allclose([command.position for command in commands], targets, atol=1e-4)


def sensors(physics):
    """What sensors and state estimation would say of the only world."""
    qpos, qvel = physics.qpos[0].numpy(), physics.qvel[0].numpy()
    return Sensors(
        time=0.0,
        joint_pos=qpos[7:],
        joint_vel=qvel[6:],
        base_quat=qpos[3:7],
        base_ang_vel=qvel[3:6],
        base_pos=qpos[:3],
        base_lin_vel=rotation(qpos[3:7]).T @ qvel[:3],
    )


def test_a_rollout_is_recorded_step_by_step(chain):
    recorded = rollout.record_reach(chain.high.artifact, seconds=0.3, episodes=2, seed=3)
    assert recorded.qpos.shape == (2, 15, 19)
    assert recorded.steering.shape == (2, 15, 7)
    assert recorded.low_obs.shape == (30, 46)
    assert recorded.high_obs.shape == (6, 44)
    assert recorded.robot == "solo12"
    # A latent is held for five steps; the target stays; the robot moves.
    assert np.array_equal(recorded.steering[:, 0], recorded.steering[:, 4])
    assert not np.array_equal(recorded.steering[:, 4], recorded.steering[:, 5])
    assert (recorded.target == recorded.target[:, :1]).all()
    assert not np.array_equal(recorded.qpos[:, 0], recorded.qpos[:, 14])
    # Observations are listed step by step, all episodes of a step together.
    joints = recorded.low_obs.reshape(15, 2, 46)[:, :, 10:22]
    assert np.array_equal(joints.swapaxes(0, 1), recorded.qpos[:, :, 7:])
    assert np.array_equal(recorded.latent.reshape(15, 2, 7).swapaxes(0, 1), recorded.steering)


def test_switching_compares_with_the_motions_the_policy_was_made_of(chain, tmp_path):
    config = switching.SwitchingConfig(episodes=2, seconds=1.0)
    result = switching.run(config, chain.context, policy=chain.high.artifact)
    assert 0.0 <= result.metrics["walk_first_reach_last"] <= 1.0
    artifact = read_artifact(result.artifact, "lacoloco/switching")
    parents = [parent.locate(result.artifact) for parent in artifact.parents]
    assert parents == [chain.high.artifact, chain.made.artifact]
    assert artifact.arrays["nearest"].shape == artifact.arrays["error"].shape == (2, 50)
    assert artifact.arrays["latent"].shape == (50, 7)
    assert result.artifact.with_name("switching.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(StageError, match="episodes 0 to 1"):
        switching.run(replace(config, shown=2), chain.context, policy=chain.high.artifact)


def test_switching_needs_motions_that_are_still_there(chain, tmp_path):
    alone = tmp_path / "policy.h5"
    alone.write_bytes(chain.high.artifact.read_bytes())
    with pytest.raises(StageError, match=r"policy.h5.*--motions"):
        motions_of(alone)


def test_a_stored_low_level_is_compared_with_the_clips_it_comes_from(chain):
    """From its own artifact, and from the high level's, which carries it."""
    found = policy_coverage(chain.low.artifact, latents=4, seed=0)
    assert (found.held, tuple(found.clips.shape)) == (4, (512, 4))
    assert len(found.latents) <= 4
    again = policy_coverage(chain.high.artifact, [chain.made.artifact], latents=4, seed=0)
    assert torch.equal(found.clips, again.clips)
    assert torch.equal(found.latents, again.latents)


def test_a_low_level_alone_holds_one_latent_per_episode_or_changes_them(chain):
    held = rollout.record_low(chain.low.artifact, seconds=0.6, episodes=2, seed=3)
    assert held.qpos.shape == (2, 30, 19)
    assert held.contact.shape == (2, 30, 4)
    assert (held.steering == held.steering[:, :1]).all()
    assert not np.array_equal(held.steering[0], held.steering[1])
    again = rollout.record_low(chain.high.artifact, seconds=0.6, episodes=2, seed=3)
    assert np.array_equal(again.qpos, held.qpos), "the high level's artifact has the same low level"
    other = rollout.record_low(chain.low.artifact, seconds=0.6, episodes=2, seed=4)
    assert not np.array_equal(other.qpos, held.qpos)
    assert np.allclose(held.qpos[:, 0, :2], 0.0, atol=0.01), "from a standing start"
    changing = rollout.record_low(
        chain.low.artifact, seconds=4.0, episodes=1, seed=3, changing=True
    )
    assert len(np.unique(changing.steering[0], axis=0)) > 1


@pytest.mark.parametrize(
    ("latents", "names"),
    [
        ("", ["latent 1 of seed 9", "latent 2 of seed 9"]),
        ("5", ["latent 1 of seed 5", "latent 2 of seed 5"]),
        ("random", ["changing latents, episode 1", "changing latents, episode 2"]),
    ],
)
def test_a_low_level_is_played_without_a_high_one(chain, latents, names):
    config = playback.PlaybackConfig(episodes=2, seconds=0.2, latents=latents)
    shown = playback.record(read_artifact(chain.low.artifact), config, 9)
    assert [one.name for one in shown] == names
    assert all(one.target is None and one.latent.shape == (10, 7) for one in shown)
    steered = playback.record(read_artifact(chain.high.artifact), config, 9)
    assert (steered[0].target is None) == bool(latents), (
        "the high level steers unless told otherwise"
    )


def test_a_page_names_the_run_of_a_policy_or_the_file_that_lies_alone(chain, tmp_path):
    config = playback.PlaybackConfig(episodes=1, seconds=0.2)
    alone = tmp_path / "my-policy.h5"
    alone.write_bytes(chain.high.artifact.read_bytes())
    for path, name in ((chain.high.artifact, "chain/train-high/0001"), (alone, "my-policy")):
        (shown,) = playback.record(read_artifact(path), config)
        assert shown.note.startswith(f"{name}: ")
