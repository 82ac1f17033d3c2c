"""`python -m lacoloco_cli`, for those who start the command otherwise, such as torchrun."""

from lacoloco_cli.main import app

app(prog_name="lacoloco")
