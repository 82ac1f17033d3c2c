"""One training over several processes, started by ``torchrun``: what they agree on. With one
process nothing happens.

Every process has its share of the worlds and of each batch, and its own seed. Gradients (rsl_rl's
own reduction), normalisers (rsl_rl's synchronise themselves), advantages, learning rate and the
constraints' scales are those of all, so that all have the same weights after every step. NCCL
between GPUs, gloo between CPUs.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, TypeVar

import torch
from rsl_rl.utils import reduce_gradients_in_buckets
from torch import distributed

Shared = TypeVar("Shared")

BUCKET_MB = 25.0
"""Most that is sent in one message; rsl_rl's default."""
SEED_STEP = 15_485_863
"""Between the seeds of two processes: far more than the few consecutive seeds that one of them
uses, and more than any seed of an evaluation's episodes, so that no process trains on those.
"""


def wanted(environment: Mapping[str, str] = os.environ) -> int:
    """Number of processes that torchrun was asked for; 1 without it."""
    return int(environment.get("WORLD_SIZE", "1"))


@contextmanager
def group(device: str) -> Iterator[None]:
    """Join the group that torchrun's environment describes, and on ``cuda`` take the GPU of this
    process's place.
    """
    if wanted() == 1:
        yield
        return
    on_gpu = device.startswith("cuda")
    if on_gpu:
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("nccl" if on_gpu else "gloo", timeout=timedelta(minutes=10))
    try:
        yield
    finally:
        distributed.destroy_process_group()


def size() -> int:
    """Number of processes."""
    return distributed.get_world_size() if distributed.is_initialized() else 1


def rank() -> int:
    """Number of this process; the first one, 0, writes the files."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def settings() -> dict[str, int] | None:
    """What rsl_rl's algorithms want to know, ``multi_gpu_cfg``; None when this process is alone."""
    return None if size() == 1 else {"global_rank": rank(), "world_size": size()}


def share(count: int) -> int:
    """This process's part of a number of worlds or rows.

    Raises:
        ValueError: it cannot be shared equally.
    """
    if count % size():
        raise ValueError(f"{count} cannot be shared equally by {size()} processes")
    return count // size()


def own_seed(seed: int) -> int:
    """Another seed for every process; the first one keeps ``seed``."""
    return seed + SEED_STEP * rank()


def average(tensor: torch.Tensor) -> torch.Tensor:
    """Mean over all processes of a tensor that every one of them has; the tensor itself when there
    is one.
    """
    if size() == 1:
        return tensor
    total = tensor.clone()
    distributed.all_reduce(total)
    return total / size()


def maximum(tensor: torch.Tensor) -> torch.Tensor:
    """Largest value over all processes, element by element."""
    if size() == 1:
        return tensor
    largest = tensor.clone()
    distributed.all_reduce(largest, distributed.ReduceOp.MAX)
    return largest


def mean_and_std(values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean and (unbiased) standard deviation of the values (n,) of all processes, whose n may
    differ.
    """
    if size() == 1:
        return values.mean(), values.std()
    sums = torch.stack((values.sum(), torch.full_like(values.sum(), float(len(values)))))
    distributed.all_reduce(sums)
    mean = sums[0] / sums[1]
    squares = (values - mean).square().sum()
    distributed.all_reduce(squares)
    return mean, (squares / (sums[1] - 1.0)).sqrt()


def average_gradients(parameters: Iterable[torch.nn.Parameter]) -> None:
    """Replace every gradient by its mean over all processes."""
    if size() > 1:
        reduce_gradients_in_buckets(parameters, size(), BUCKET_MB)


def copy_from_first(*modules: torch.nn.Module) -> None:
    """Give every process the first one's parameters and buffers."""
    if size() == 1:
        return
    for module in modules:
        for tensor in module.state_dict().values():
            distributed.broadcast(tensor, src=0)


def from_first(value: Shared | None) -> Any:
    """The first process's value (anything that can be pickled), wherever this is called; others
    pass None.
    """
    if size() == 1:
        return value
    box: list[Any] = [value]
    distributed.broadcast_object_list(box, src=0)
    return box[0]


def any_process(flag: bool, device: str) -> bool:
    """Whether any process raises the flag: all of them then do what follows from it at the same
    moment.
    """
    if size() == 1:
        return flag
    return bool(maximum(torch.tensor(float(flag), device=device)))


def wait_for_all() -> None:
    """Wait until every process has come here."""
    if size() > 1:
        distributed.barrier()
