"""How commands take the name of a file."""

from __future__ import annotations

from pathlib import Path

import click

# What cannot be read is bad input, which the command says once the others are done: click would
# call it wrong usage, before anything is done
PATH = click.Path(readable=False, path_type=Path)
