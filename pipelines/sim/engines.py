"""Which physics engine a device gets."""

from __future__ import annotations

import os
from collections.abc import Callable

import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.sim.physics import Physics, PhysicsRequest

ENGINE_VARIABLE = "LACOLOCO_PHYSICS"
"""Environment variable; ``warp`` forces MuJoCo Warp on the CPU."""


def make_physics(request: PhysicsRequest, device: str = "cpu") -> Physics:
    """Build the engine for a device: MuJoCo's native batch engine on the CPU, MuJoCo Warp on a GPU.

    ``LACOLOCO_PHYSICS=warp`` takes Warp on the CPU too, where it is some ten times slower: for
    tests.

    Raises:
        StageError: the device has no engine, or what it needs is not there.
    """
    engines: dict[str, Callable[[PhysicsRequest, str], Physics]] = {"cpu": _batch, "cuda": _warp}
    kind = device.split(":")[0]
    if kind not in engines:
        raise StageError(f"--device {device}: no physics engine for it; use --device cpu or cuda")
    disturbances = request.disturbances
    engine = "cuda" if _forced_to_warp() or disturbances.engine == "warp" else kind
    if engine == "cuda" and disturbances.of_physics:
        raise StageError(
            "disturbances of motors, floors, loads and readings run on MuJoCo's own engine only;"
            f" use --device cpu without {ENGINE_VARIABLE}, and no other engine beside them"
        )
    return engines[engine](request, device)


def _forced_to_warp() -> bool:
    wanted = os.environ.get(ENGINE_VARIABLE, "")
    if wanted not in ("", "warp"):
        raise StageError(f"{ENGINE_VARIABLE}={wanted}: set it to warp, or unset it")
    return wanted == "warp"


def _batch(request: PhysicsRequest, device: str) -> Physics:
    if request.disturbances.of_physics:
        from lacoloco.pipelines.sim.disturbances.engine import DisturbedBatch

        return DisturbedBatch(request)
    from lacoloco.pipelines.sim.mujoco_cpu import BatchPhysics

    return BatchPhysics(request)


def _warp(request: PhysicsRequest, device: str) -> Physics:
    if device.startswith("cuda") and not torch.cuda.is_available():
        raise StageError(f"--device {device}: torch finds no CUDA device; use --device cpu")
    try:
        from lacoloco.pipelines.sim.mujoco_warp import WarpPhysics
    except ModuleNotFoundError as error:
        raise StageError(
            f"--device {device}: {error.name} is missing; pip install 'lacoloco[gpu]'"
        ) from error
    return WarpPhysics(request, device)
