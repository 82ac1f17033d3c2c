"""The programs of both modes, and Ipopt, which solves them.

Mode clip has one function that solves: `stretch_solver.solve_stretch` takes a stretch of frames and
gives its variables, or None. `clip_problem` calls it and nothing else of the solver, whose own
files are `stretch_solver`, `stretch_program` and `frame_derivatives`.
"""
