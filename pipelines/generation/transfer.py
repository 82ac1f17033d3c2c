"""An expert that begins as another task's: networks that see the same but for the command."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from lacoloco.pipelines.errors import StageError
from lacoloco.pipelines.sim.state import Term

FIRST = "mlp.0.weight"
BIAS = "mlp.0.bias"
MEAN, STD = "obs_normalizer._mean", "obs_normalizer._std"


def transferred(
    mine: Mapping[str, torch.Tensor],
    theirs: Mapping[str, torch.Tensor],
    terms: tuple[Term, ...],
    other_terms: tuple[Term, ...],
) -> dict[str, torch.Tensor]:
    """A network's state with another one's weights, blind to its own command.

    The other's command counts as zero from now on: what the first layer makes of a zero goes into
    its bias. Statistics of the observation come from the other network for what both see, and stay
    this one's for its command.

    Args:
        mine: State of the network, warmed up on its own observations.
        theirs: State of the network that it begins as.
        terms: Layout of its observation.
        other_terms: Layout of the other's.

    Raises:
        StageError: The two see other things besides one command each, or are of other sizes.
    """
    columns, shared, commands = _columns(terms, other_terms)
    state = {name: value.clone() for name, value in theirs.items()}
    for name in state:
        if name.startswith("obs_normalizer.") and state[name].dim() == 2:
            state[name] = mine[name].clone()
            state[name][:, columns] = theirs[name][:, shared]
    weight = torch.zeros_like(mine[FIRST])
    if weight.shape[0] != theirs[FIRST].shape[0]:
        raise StageError("an expert can only begin as one with networks of the same widths")
    weight[:, columns] = theirs[FIRST][:, shared]
    # rsl_rl divides by the standard deviation plus this.
    told_nothing = (0.0 - theirs[MEAN][0, commands]) / (theirs[STD][0, commands] + 1e-2)
    state[FIRST] = weight
    state[BIAS] = theirs[BIAS] + theirs[FIRST][:, commands] @ told_nothing
    return state


def _columns(
    terms: tuple[Term, ...], other_terms: tuple[Term, ...]
) -> tuple[list[int], list[int], list[int]]:
    """Columns that both see, here and there, and the other's that only it sees."""
    here, there = _slices(terms), _slices(other_terms)
    both = [name for name in here if name in there and len(here[name]) == len(there[name])]
    if [term.name for term in terms if term.name in there] != [
        term.name for term in other_terms if term.name in here
    ]:
        raise StageError("an expert can only begin as one that sees the same but for its command")
    columns = [i for name in both for i in here[name]]
    shared = [i for name in both for i in there[name]]
    commands = [i for name, own in there.items() if name not in here for i in own]
    return columns, shared, commands


def _slices(terms: tuple[Term, ...]) -> dict[str, range]:
    found, start = {}, 0
    for term in terms:
        found[term.name] = range(start, start + term.size)
        start += term.size
    return found
