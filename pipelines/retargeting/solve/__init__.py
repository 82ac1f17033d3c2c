"""The programs of both modes, and their solvers.

Mode clip has one function that solves: `interior_point.solve_stretch` takes a stretch of frames and
gives its variables, or None. `clip_problem` calls it and nothing else of the solver. The solver's
own files are `interior_point`, `barrier`, `clip_model`, `null_space` and `banded`. Another solver
with the same function can take their place.
"""
