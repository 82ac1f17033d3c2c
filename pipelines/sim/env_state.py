"""The state of an environment: what a checkpoint keeps, so that the next step is what it would have
been.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

from lacoloco.pipelines.sim.physics import WorldParameters

if TYPE_CHECKING:
    from lacoloco.pipelines.sim.env import LeggedEnv

_TENSORS = ("steps", "action", "command", "_resample_at", "_push_at")


def state_of(env: LeggedEnv) -> dict[str, Any]:
    """Everything that makes the next step what it is."""
    tensors = {key: getattr(env, key) for key in _TENSORS}
    return {
        "physics": env.physics.state_dict(),
        "parameters": env.parameters.columns(),
        "generator": env.generator.get_state(),
        "feet": env.feet.state_dict(),
        "diverged_total": env.diverged_total,
        **({} if env.guide is None else {"guide": env.guide.state_dict()}),
        **({} if env.sensors is None else {"sensors": env.sensors.state_dict()}),
        **({} if env.readings is None else {"readings": env.readings.state_dict()}),
        **tensors,
    }


def restore_state(env: LeggedEnv, state: dict[str, Any]) -> None:
    """Restore :func:`state_of`."""
    columns = {name: values.to(env.device) for name, values in state["parameters"].items()}
    env.parameters = WorldParameters(**columns)
    env.physics.set_parameters(env.parameters)
    env.physics.load_state_dict(state["physics"])
    env.generator.set_state(state["generator"])
    env.feet.load_state_dict(state["feet"])
    env.diverged_total = torch.as_tensor(state["diverged_total"], device=env.device)
    for key in _TENSORS:
        setattr(env, key, state[key].to(env.device))
    if env.guide is not None:
        env.guide.load_state_dict(state["guide"])
    if env.sensors is not None:
        env.sensors.load_state_dict(state["sensors"])
    if env.readings is not None:
        env.readings.load_state_dict(state["readings"])
    env._read()
