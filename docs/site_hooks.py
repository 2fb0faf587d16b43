"""What the site's navigation takes from the folder: every decision, by its number."""

from pathlib import Path
from typing import Any


def on_config(config: Any) -> Any:
    """Add the decisions to the navigation."""
    folder = Path(config["docs_dir"])
    found = sorted((folder / "decisions").glob("*.md"))
    config["nav"].append({"Decisions": [path.relative_to(folder).as_posix() for path in found]})
    return config
