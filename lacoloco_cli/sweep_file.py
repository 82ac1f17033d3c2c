"""The file of `lacoloco run EXPERIMENT --sweep FILE`: what is compared, one table per variant.

::

    [complete]

    [cloning-only]
    set = ["train-low.samples=24576", "train-low.critic_warmup=1"]

    [gan]
    method = "gan-cat"
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lacoloco_cli.failures import UserError
from lacoloco_cli.overrides import OverrideError
from lacoloco_cli.stage_settings import stage_settings

if TYPE_CHECKING:
    from lacoloco.pipelines.chains.variants import Variant

KEYS = ("method", "set")
NAME = re.compile(r"[A-Za-z0-9_.-]+")


def read_sweep(
    file: Path, experiment: str, *, method: str, preset: str, common: Sequence[str]
) -> list[Variant]:
    """The variants of a file, in its order; all of it is checked before anything starts.

    Args:
        file: In TOML.
        experiment: Name of the experiment that all of them are.
        method: Of variants that name none.
        preset: Of all stages.
        common: `"STAGE.path.to.field=value"` of all variants; their own come after.

    Raises:
        UserError: The file cannot be read, or says what does not exist; one line names it.
    """
    from lacoloco.pipelines.chains.experiments import EXPERIMENTS, METHODS
    from lacoloco.pipelines.chains.variants import Variant

    found: list[Variant] = []
    for name, table in _tables(file).items():
        chosen = table.get("method", method)
        if chosen not in list(METHODS):  # a list in the file cannot be looked up in a dict
            raise UserError(f"{file}: [{name}] method {chosen!r}: use one of {', '.join(METHODS)}")
        try:
            own = [*common, *table.get("set", [])]
            settings = stage_settings(own, EXPERIMENTS[experiment], preset)
        except OverrideError as error:
            raise UserError(f"{file}: [{name}] {error}") from error
        if any(one.partition(".")[0].strip() == "eval" for one in table.get("set", [])):
            raise UserError(f"{file}: [{name}] sets eval: all variants are evaluated alike; --set")
        variant = Variant(name, experiment, chosen, settings, compared=True)
        for other in found:
            if replace(other, name=name) == variant:
                raise UserError(f"{file}: [{name}] is the same as [{other.name}]; leave one out")
        found.append(variant)
    return found


def _tables(file: Path) -> Mapping[str, dict[str, Any]]:
    """Variant -> its table, of the right shape.

    Raises:
        UserError: It is not.
    """
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"--sweep {file}: cannot be read: {_reason(error)}") from error
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"--sweep {file}: is no TOML: {error}") from error
    if not tables:
        raise UserError(f"--sweep {file}: names no variant; write a table per variant, [NAME]")
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise UserError(f"{file}: {name}: write a table per variant, [NAME]")
        if not NAME.fullmatch(name):
            raise UserError(f"{file}: [{name}]: use letters, digits, '-', '_', '.'")
        if unknown := [key for key in table if key not in KEYS]:
            raise UserError(f"{file}: [{name}] {unknown[0]}: not known; use {' or '.join(KEYS)}")
        settings = table.get("set", [])
        if not isinstance(settings, list) or not all(isinstance(one, str) for one in settings):
            raise UserError(f"{file}: [{name}] set: a list of 'STAGE.path.to.field=value'")
    return tables


def _reason(error: OSError | UnicodeDecodeError) -> str:
    return (error.strerror or str(error)) if isinstance(error, OSError) else "it is no UTF-8"
