"""The front door: the `lacoloco` command. One file per verb."""
