"""An RO-Crate 1.1 of a folder: what each file is, its hash, and what made it.

https://www.researchobject.org/ro-crate/1.1/: one file of JSON-LD beside the data.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skinlab.text import json_text

FILE = "ro-crate-metadata.json"
_FORMATS = {
    ".csv": "text/csv",
    ".json": "application/json",
    ".toml": "application/toml",
    ".html": "text/html",
    ".parquet": "application/vnd.apache.parquet",
}


def ro_crate(
    folder: Path,
    files: Mapping[str, str],
    *,
    name: str,
    description: str,
    date: str,
    versions: Mapping[str, str],
    licence: str,
) -> str:
    """Return the text of ro-crate-metadata.json for files of this folder, each with its meaning.

    `date` is ISO 8601.
    """
    graph: list[dict[str, Any]] = [
        {
            "@id": FILE,
            "@type": "CreativeWork",
            "about": {"@id": "./"},
            "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": name,
            "description": description,
            "datePublished": date,
            "license": {"@id": "#licence"},
            "hasPart": [{"@id": file} for file in files],
            "mentions": [{"@id": "#run"}],
        },
        {"@id": "#licence", "@type": "CreativeWork", "name": "Licence", "description": licence},
        {
            "@id": "#skinlab",
            "@type": "SoftwareApplication",
            "name": "skinlab",
            "softwareVersion": versions.get("skinlab", ""),
            "softwareRequirements": ", ".join(f"{k} {v}" for k, v in versions.items()),
        },
        {
            "@id": "#run",
            "@type": "CreateAction",
            "name": "skinlab study",
            "endTime": date,
            "instrument": {"@id": "#skinlab"},
            "result": [{"@id": file} for file in files],
        },
    ]
    for file, meaning in files.items():
        path = folder / file
        with path.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
        graph.append(
            {
                "@id": file,
                "@type": "File",
                "name": file,
                "description": meaning,
                "encodingFormat": _FORMATS.get(path.suffix, "application/octet-stream"),
                "contentSize": str(path.stat().st_size),
                "sha256": digest,
            }
        )
    whole = {"@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph}
    return json_text(whole) + "\n"
