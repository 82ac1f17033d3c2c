"""The parts of the stage track: a policy that follows clips in simulation."""
