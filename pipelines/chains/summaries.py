"""What came out of a stage, in one line."""

from __future__ import annotations

from collections.abc import Callable
from statistics import fmean, stdev
from typing import Any


def summarise(verb: str, metrics: dict[str, Any]) -> str:
    """The few metrics of a stage that a person wants to see, in one line."""
    return SUMMARIES[verb](metrics)


def _evaluated(metrics: dict[str, Any]) -> str:
    """Mean and sample spread over the seeds of every method or variant; never the best seed in
    their place.
    """
    lines = []
    for name in metrics["summary"]:
        rows = [row for row in metrics["rows"] if row.get("variant", row["method"]) == name]
        error, violation, falls = (
            [row[key] for row in rows]
            for key in ("ee_error_mean_m", "contact_violation_pct", "falls_pct")
        )
        spread = f" +- {100 * stdev(error):.1f}" if len(rows) > 1 else ""
        seeds = f"mean of {len(rows)} seeds" if len(rows) > 1 else f"seed {rows[0]['seed']}"
        lines.append(
            f"{name}, {seeds}: error {100 * fmean(error):.1f}{spread} cm, "
            f"violation {fmean(violation):.2f} %, falls {fmean(falls):.2f} %"
        )
    return "; ".join(lines)


SUMMARIES: dict[str, Callable[[dict[str, Any]], str]] = {
    "generate": lambda m: (
        f"{m['clips']} clips, {m['seconds']:.0f} s; walking error {m['walk_error_mean']:.3f} m/s "
        f"and {m.get('walk_yaw_error_mean', float('nan')):.3f} rad/s, "
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
    "eval": _evaluated,
    "export": lambda m: f"low.onnx, high.onnx; largest difference {m['max_abs_difference']:.1g}",
    "play": lambda m: str(m["html"]),
}
