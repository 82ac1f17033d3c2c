"""`lacoloco runs coverage`: what of the clips' motion the latents of a low level reach."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lacoloco_cli import console
from lacoloco_cli.options import IN_A_RUN, MotionsToCompare
from lacoloco_cli.session import Session, path_text, verb
from lacoloco_cli.written_files import PICTURES, check_ending, check_output

app = typer.Typer()

PICTURE = "coverage.png"
SHOWN = 8
"""Cells that are listed."""


@verb(app, "coverage", shared=IN_A_RUN)
def coverage(
    session: Session,
    policy: Annotated[
        Path | None,
        typer.Argument(
            metavar="[POLICY]",
            help="Artifact with a low level, or a published name; default: the newest of the run.",
        ),
    ] = None,
    motions: MotionsToCompare = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="A .png, .pdf or .svg; default: coverage.png in the run, or here for a policy that"
            " is named.",
        ),
    ] = None,
    latents: Annotated[
        int, typer.Option("--latents", min=1, max=131_072, help="How many latents are held.")
    ] = 256,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of latents and moments.")] = 0,
) -> None:
    """Hold latents of a low level, and draw what they do beside what its clips show.

    Forward, lateral and yaw velocity and the height of the end effector are cut into cells. What
    counts is the share of the clips' moments in whose cell at least one latent comes.
    """
    from lacoloco.datasets.published import resolve
    from lacoloco.pipelines.evaluation.policy_coverage import policy_coverage
    from lacoloco.pipelines.plots.coverage import draw_coverage

    if policy is None and out is None:  # the one picture that belongs among the runs
        place = out = session.store.directory(session.run_name) / PICTURE
    else:
        out = out or Path(PICTURE)
        kind = check_ending("--out", out, PICTURES)
        place = check_output("--out", out, kind, session.store.root)
    if policy is None:
        policy = session.store.newest(session.run_name, "train-low")
    found = policy_coverage(
        resolve(policy),
        [resolve(one) for one in motions or ()],
        latents=latents,
        seed=seed,
        progress=session.progress,
    )
    draw_coverage(place, found)
    lost = [{"cell": cell, "share": share} for cell, share in found.lost()]
    answer = {"picture": path_text(out), **found.metrics(), "lost": lost}

    def show() -> None:
        for name in ("coverage", "clips"):
            who = f"{latents} latents" if name == "coverage" else "as many moments of the clips"
            typer.echo(
                f"{who}: reach {answer[f'{name}_cells']:.1%} of what the clips show; "
                f"{answer[f'{name}_turn_left']:.1%} turn left, "
                f"{answer[f'{name}_turn_right']:.1%} right"
            )
        rows = [[cell, f"{100.0 * share:.1f}"] for cell, share in found.lost()[:SHOWN]]
        if rows:
            console.print_table(["no latent comes near", "% of the clips"], rows)
        typer.echo(answer["picture"])

    session.answer(answer, show)
