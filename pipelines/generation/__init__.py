"""The parts of the stage generate: experts and their recording."""
