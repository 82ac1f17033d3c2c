"""`lacoloco export`: a folder that runs a policy without lacoloco."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli.options import AT_ONCE
from lacoloco_cli.policy_choice import best
from lacoloco_cli.session import Session, path_text, verb

app = typer.Typer()


@verb(app, shared=AT_ONCE)
def export(
    session: Session,
    policy: Annotated[
        Path | None,
        typer.Option(
            "--policy", help="High-level policy, or its published name; default: the run's best."
        ),
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(
            "--check",
            metavar="FOLDER",
            help="Only compare the files of an exported folder with the hashes in it.",
        ),
    ] = None,
) -> None:
    """Write a folder that runs a policy on a robot: two ONNX files, checked against torch, their
    description, the model, and a controller that needs NumPy and onnxruntime only.
    """
    import logging

    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines import export as stage

    # torch's exporter warns that torchvision, which nothing here uses, is not installed
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    if check is not None:
        hashes = stage.check(check)
        session.answer(
            {"folder": path_text(check), "sha256": hashes},
            lambda: typer.echo(f"{path_text(check)}: {len(hashes)} files belong together"),
        )
        return
    config = session.config(stage.PRESETS)
    (policy,) = session.takes(resolve(policy) if policy else best(session))
    result = stage.run(config, session.context(), policy=policy)
    onnx = {role: path_text(Path(path)) for role, path in result.metrics["onnx"].items()}
    answer = {"artifact": path_text(result.artifact), **result.metrics, "onnx": onnx}
    answer |= {"policy": path_text(policy), "folder": path_text(Path(result.metrics["folder"]))}

    def show() -> None:
        typer.echo(f"folder: {answer['folder']}")
        for role, path in onnx.items():
            typer.echo(f"{role}: {path}")
        difference = answer["max_abs_difference"]
        typer.echo(f"onnxruntime and torch differ by at most {difference:.2g}")

    session.answer(answer, show)
